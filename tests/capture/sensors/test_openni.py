"""Through the real OpenNI2 library, with sensors that a driver of the tests shows to it; see virtual_sensor.cpp."""

import gc
import os
import subprocess
import sys
import time
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from select import select
from types import SimpleNamespace

import numpy as np
import pytest

from capture.sensors import oni_file
from capture.sensors import openni as module
from capture.sensors.openni import (
    OpenNIDevice,
    Place,
    Sensor,
    devices,
    open_openni,
    openni2,
    parse,
    plugged_in,
    usb_node,
)
from capture.skeleton import SkeletonFrame
from capture.source import SilentSource
from engine_bridge.service.stage_runner import StageRunner
from puppetline.errors import SourceError

from ..devices import data_of, read

NAME = "openni:"


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.fixture
def sensor(virtual_sensors):
    """A virtual sensor that is plugged in."""
    virtual_sensors[0].plug()
    return virtual_sensors[0]


@pytest.fixture
def opened():
    """Open a device that is closed behind the test."""
    with ExitStack() as stack:
        yield lambda *place, **options: stack.enter_context(closing(OpenNIDevice(NAME, Place(*place, **options))))


def _noise(rng):
    return rng.integers(400, 4000, (480, 640), dtype=np.uint16), rng.integers(0, 255, (480, 640, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("rest", "place"),
    [
        ("", Place()),
        ("serial=A1", Place("serial", "A1")),
        ("uri=1d27/0601@1/5", Place("uri", "1d27/0601@1/5")),
        ("file=a take.oni", Place("file", "a take.oni")),
        ("file=take.oni&fast", Place("file", "take.oni", fast=True)),
        ("file=take.oni?loop", Place("file", "take.oni", loop=True)),
        ("file=take.oni&fast?loop", Place("file", "take.oni", fast=True, loop=True)),
    ],
)
def test_a_uri_says_where_pictures_come_from(rest, place):
    assert parse(NAME + rest, rest) == place


@pytest.mark.parametrize(
    "rest", ["1", "file", "file=", "uri=", "serial=1&fast", "file=a&slow", "fast", "file=a?fast=1"]
)
def test_another_uri_is_refused_with_what_there_is(rest):
    with pytest.raises(SourceError, match="expected nothing, serial=NUMBER") as caught:
        parse(NAME + rest, rest)
    assert caught.value.found == repr(rest)


def test_a_sensor_on_usb_is_a_file_that_may_be_opened_or_not():
    assert usb_node("1d27/0601@1/5") == Path("/dev/bus/usb/001/005")
    assert usb_node("virtual/0") is None


def test_sensors_are_listed_as_they_are_plugged_in_and_out(virtual_sensors):
    bindings = openni2(NAME)
    assert devices(bindings) == []
    for sensor in virtual_sensors:
        sensor.plug()
    assert devices(bindings) == ["virtual/0", "virtual/1"]
    virtual_sensors[0].unplug()
    assert devices(bindings) == ["virtual/1"]


def test_sensors_that_are_plugged_in_are_told_with_names_serial_numbers_and_what_is_wrong(virtual_sensors):
    virtual_sensors[0].plug()
    virtual_sensors[1].plug(refuses=["opening"])
    well, amiss = plugged_in(NAME)
    assert well == Sensor("Puppetline virtual sensor 0", "virtual/0", "serial-0", None)
    assert (amiss.name, amiss.uri, amiss.serial) == ("Puppetline virtual sensor 1", "virtual/1", "")
    assert amiss.trouble.found == "a sensor that does not work (the virtual sensor refuses)"
    assert virtual_sensors[0].streaming == 0


@pytest.mark.parametrize("kind", ["serial", "uri"])
@pytest.mark.parametrize("number", [0, 1])
def test_a_sensor_is_chosen_by_serial_number_or_uri(virtual_sensors, opened, kind, number):
    for sensor in virtual_sensors:
        sensor.plug()
    device = opened(kind, getattr(virtual_sensors[number], kind))
    assert device.name == f"Puppetline virtual sensor {number}"
    assert [sensor.streaming for sensor in virtual_sensors] == [2 * (number == 0), 2 * (number == 1)]


@pytest.mark.parametrize(
    ("place", "found", "expected"),
    [
        (Place(), "no sensor", "one that is plugged in"),
        (Place("serial", "7"), "sensors virtual/1", "one with the serial 7"),
        (Place("uri", "virtual/0"), "sensors virtual/1", "one with the uri virtual/0"),
    ],
)
def test_a_sensor_that_is_not_there_is_an_error_that_says_which_are(virtual_sensors, place, found, expected):
    if place != Place():
        virtual_sensors[1].plug()
    with pytest.raises(SourceError) as caught:
        OpenNIDevice(NAME, place)
    assert (caught.value.found, caught.value.expected) == (found, expected)


def test_pictures_are_what_the_sensor_sees_registered_in_step_and_not_mirrored(sensor, opened, rng):
    """The virtual sensor starts mirrored, shifted, at half the size, and with colour later than depth."""
    device = opened()
    for k in range(5):
        depth, color = _noise(rng)
        sensor.show(depth, color, 7.0 + k / 30)
        picture = read(device)
        assert picture.time == pytest.approx(7.0 + k / 30, abs=1e-6)
        assert (picture.depth.dtype, picture.color.dtype) == (np.uint16, np.uint8)
        np.testing.assert_array_equal(picture.depth, depth)
        np.testing.assert_array_equal(picture.color, color)
    assert (picture.lens.width, picture.lens.height) == (640, 480)
    assert picture.lens.focal == pytest.approx(sensor.lens.focal, rel=1e-6)


def test_what_a_sensor_cannot_do_is_said_and_the_rest_is_done(sensor, opened, rng, caplog):
    sensor.unplug()
    sensor.plug(refuses=("registration", "synchronisation", "mirror off"))
    device = opened()
    for moment in (1.0, 1.1):
        depth, color = _noise(rng)
        sensor.show(depth, color, moment)
        picture = read(device)
    assert caplog.messages == [
        "openni: Puppetline virtual sensor 0 cannot register depth to colour, so depth is a little off",
        "openni: Puppetline virtual sensor 0 takes depth and colour 5.0 ms apart",
    ]
    np.testing.assert_array_equal(picture.color, color)
    np.testing.assert_array_equal(picture.depth[:, 8:], depth[:, :-8])


def test_a_body_seen_by_the_sensor_is_where_its_joints_are(sensor, opened, render, standing):
    depth, color = render(standing, sensor.lens)
    device = opened()
    sensor.show(depth, color, 0.0)
    picture = read(device)
    pixels = np.round(picture.lens.project(standing) - 0.5).astype(int)
    at_joints = picture.depth[pixels[:, 1], pixels[:, 0]]
    assert (at_joints > 0).all()
    seen = picture.lens.unproject(pixels + 0.5, at_joints / 1000)
    hidden_by_other_bones = np.linalg.norm(seen - standing, axis=1) > 0.055
    assert hidden_by_other_bones.sum() <= 3
    skin = np.abs(np.linalg.norm(seen - standing, axis=1) - 0.05)
    assert skin[~hidden_by_other_bones].max() < 0.006


def test_waiting_for_a_picture_ends(sensor, opened):
    device = opened()
    start = time.monotonic()
    assert device.read(0.2) is None
    assert time.monotonic() - start >= 0.19


def test_a_sensor_that_refuses_is_an_error_with_its_own_words(sensor):
    sensor.unplug()
    sensor.plug(refuses=["opening"])
    with pytest.raises(SourceError, match="the virtual sensor refuses") as caught:
        OpenNIDevice(NAME, Place())
    assert "other programs" in caught.value.fix


def test_a_sensor_that_has_refused_often_opens_as_soon_as_it_does_not(sensor, opened, rng):
    """As another program lets go of it: what was closed without having been open would crash the library."""
    sensor.refuse("opening")
    for _ in range(20):
        with pytest.raises(SourceError, match="the virtual sensor refuses"):
            OpenNIDevice(NAME, Place())
        assert plugged_in(NAME)[0].trouble is not None
        gc.collect()
    sensor.refuse()
    device = opened()
    sensor.show(*_noise(rng), 1.0)
    assert read(device).time == 1.0


def test_a_sensor_that_may_not_be_opened_is_an_error_that_names_the_udev_rules(sensor, monkeypatch):
    sensor.unplug()
    sensor.plug(refuses=["opening"])
    monkeypatch.setattr(module, "usb_node", lambda uri: Path("/dev/bus/usb/001/005"))
    with pytest.raises(SourceError) as caught:
        OpenNIDevice(NAME, Place())
    assert caught.value.found == "a sensor at /dev/bus/usb/001/005 that this user may not open"
    assert "60-libopenni2-0.rules" in caught.value.fix


def test_closing_stops_the_sensor_which_then_opens_again(sensor):
    for _ in range(3):
        device = OpenNIDevice(NAME, Place())
        sensor.wait_for_streams()
        device.close()
        device.close()
        assert sensor.streaming == 0


def test_a_sensor_that_is_unplugged_is_an_error_and_comes_back_when_it_is_plugged_in(
    sensor, watch, scripted_tracker, rng
):
    for taken in (5.0, 0.5):
        watched = watch(partial(OpenNIDevice, NAME, Place()), scripted_tracker)
        sensor.show(*_noise(rng), taken)
        [frame] = watched.events()
        assert (frame.positions == np.float32(taken)).all()
        sensor.unplug()
        assert watched.error().found == "an unplugged sensor (Puppetline virtual sensor 0)"
        watched.source.close()
        unplugged = watch(partial(OpenNIDevice, NAME, Place()), scripted_tracker)
        assert unplugged.error().found == "no sensor"
        sensor.plug()


class Onlooker:
    """Stands in for a stage: keeps what is performed."""

    name, players = "onlooker", ()

    def __init__(self):
        self.events = []

    def step(self, event, _received):
        self.events.append(event)
        return []


def test_the_service_goes_on_through_unplugging_and_plugging_in(sensor, scripted_tracker, rng, monkeypatch, tmp_path):
    monkeypatch.setattr(module, "library", lambda: None)
    monkeypatch.setattr(module, "MediaPipePose", lambda: scripted_tracker)
    with closing(StageRunner("openni:", Onlooker(), tmp_path)) as line:
        stage = line.stage

        def perform_until(what):
            give_up = time.monotonic() + 10
            while not what():
                assert time.monotonic() < give_up
                readable = [fd for fd in [line.source.fileno()] if fd is not None]
                select(readable, [], [], max(0.0, min(line.due() - time.monotonic(), 0.1)))
                line.take_in()

        def frames():
            return [event for event in stage.events if isinstance(event, SkeletonFrame)]

        for count in (1, 2, 3):
            perform_until(lambda: sensor.streaming == 2)
            sensor.show(*_noise(rng), float(count))
            perform_until(lambda count=count: len(frames()) == count)
            sensor.unplug()
            perform_until(lambda: isinstance(line.source.inner, SilentSource))
            sensor.plug()
        times = [event.time for event in stage.events]
        assert times == sorted(times)
        assert [frame.positions[0, 0] for frame in frames()] == [1.0, 2.0, 3.0]
        assert line.source.counts.received == 3


@pytest.mark.usefixtures("virtual_sensors")
def test_a_recording_that_is_not_there_is_an_error_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "library", lambda: None)
    with pytest.raises(SourceError, match=rf"found {tmp_path}/take.oni, which cannot be read \(No such file"):
        open_openni("openni:file=take.oni", "file=take.oni", tmp_path)


def test_two_sensors_give_pictures_side_by_side(virtual_sensors, opened, rng):
    for sensor in virtual_sensors:
        sensor.plug()
    both = [opened("uri", sensor.uri) for sensor in virtual_sensors]
    shown = [_noise(rng) for _ in both]
    for sensor, pictures in zip(virtual_sensors, shown, strict=True):
        sensor.show(*pictures, 1.0)
    for device, (depth, color) in zip(both, shown, strict=True):
        picture = read(device)
        np.testing.assert_array_equal(picture.depth, depth)
        np.testing.assert_array_equal(picture.color, color)


@pytest.fixture(scope="session")
def recording(record, _virtual_sensors, tmp_path_factory):
    """A recording of ten pictures, made by OpenNI2's recorder as NiViewer makes it, mirrored; and the pictures."""
    [sensor, _] = _virtual_sensors
    sensor.plug(refuses=["mirror off"])
    path = tmp_path_factory.mktemp("oni") / "take.oni"
    rng = np.random.default_rng(4)
    pictures = [_noise(rng) for _ in range(10)]
    record(sensor, path, pictures, step=0.1)
    sensor.unplug()
    return path, pictures


def test_a_recording_plays_the_pictures_that_were_recorded_and_ends(recording, opened):
    path, pictures = recording
    device = opened("file", str(path))
    for k, (depth, color) in enumerate(pictures):
        picture = read(device)
        assert picture.time == pytest.approx(k / 10, abs=2e-6)
        np.testing.assert_array_equal(picture.depth, depth)
        np.testing.assert_array_equal(picture.color, color)
        assert picture.lens.focal == pytest.approx(320 / np.tan(0.5), rel=1e-6)
    with pytest.raises(SourceError) as caught:
        device.read(0.1)
    assert caught.value.found == "the end of the recording"


def test_it_is_said_that_a_recording_does_not_tell_whether_depth_is_registered(recording, caplog):
    caplog.set_level("INFO", "capture")
    with closing(OpenNIDevice("openni:file=take.oni", Place("file", str(recording[0])))):
        assert caplog.messages == [
            "openni:file=take.oni: the recording does not tell whether its depth is registered to colour, "
            "so it is taken to be"
        ]


def test_of_a_recording_that_tells_so_it_is_said_that_depth_is_not_registered(recording, caplog, monkeypatch):
    """As other builds of the library may; Debian's gives nothing back."""
    bindings = openni2(NAME)
    monkeypatch.setattr(bindings.Device, "get_image_registration_mode", lambda _device: bindings.IMAGE_REGISTRATION_OFF)
    with closing(OpenNIDevice("openni:file=take.oni", Place("file", str(recording[0])))):
        assert caplog.messages == [
            "openni:file=take.oni: its depth was not registered to colour, so depth is a little off"
        ]


def test_a_recording_in_a_loop_begins_again_and_its_time_goes_on(recording, opened):
    path, pictures = recording
    device = opened("file", str(path), loop=True)
    times = []
    for k in range(25):
        picture = read(device)
        np.testing.assert_array_equal(picture.depth, pictures[k % 10][0])
        times.append(picture.time)
    spaces = np.diff(times)
    np.testing.assert_allclose(spaces, [1 / 30 if (k + 1) % 10 == 0 else 0.1 for k in range(24)], atol=1e-5)


def test_a_recording_is_tracked_picture_by_picture_at_its_own_times(recording, watch, scripted_tracker):
    play = partial(OpenNIDevice, NAME, Place("file", str(recording[0])))
    watched = watch(play, scripted_tracker, recorded=True, fast=True)
    frames = watched.events(10)
    assert {type(frame) for frame in frames} == {SkeletonFrame}
    np.testing.assert_allclose([frame.time for frame in frames], np.arange(10) / 10, atol=2e-6)
    assert watched.error().found == "the end of the recording"
    assert watched.source.counts.dropped == 0


@pytest.fixture
def damaged(recording, tmp_path):
    """A recording that was cut off, which the library crashes on now and then."""
    path = tmp_path / "damaged.oni"
    path.write_bytes(recording[0].read_bytes()[:10_000_000])
    return path


def test_a_damaged_recording_never_reaches_the_library(damaged):
    for _ in range(100):
        with pytest.raises(SourceError, match="which is damaged at byte 1"):
            OpenNIDevice(NAME, Place("file", str(damaged)))


def test_a_recording_on_which_the_library_crashes_costs_another_process(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "library", lambda: None)
    damaged = tmp_path / "damaged.oni"
    content = bytearray(recording[0].read_bytes())
    content[23] = 127  # there are billions of nodes
    damaged.write_bytes(content)
    with pytest.raises(SourceError) as caught:
        open_openni("openni:file=damaged.oni", "file=damaged.oni", tmp_path)
    assert caught.value.found == f"{damaged}, on which OpenNI2 crashes"


def test_a_recording_on_which_the_library_hangs_is_given_up(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(oni_file, "_PLAY", "import time; time.sleep(60)")
    monkeypatch.setattr(oni_file, "_PATIENCE", 0.1)
    with pytest.raises(SourceError, match=r"take\.oni, on which OpenNI2 hangs"):
        oni_file.check_plays(NAME, recording[0])


def test_a_picture_that_is_too_short_is_left_out(sensor, opened, rng, monkeypatch):
    """OpenNI2 gives one where the compressed data of a recording are damaged."""
    device = opened()
    pixels, shortened = device._pixels, []

    def first_shortened(stream, frame):
        if shortened:
            return pixels(stream, frame)
        shortened.append(frame)
        return pixels(stream, SimpleNamespace(height=480, width=640, stride=frame.stride, dataSize=1000))

    monkeypatch.setattr(device, "_pixels", first_shortened)
    sensor.show(*_noise(rng), 1.0)
    assert device.read(0.2) is None
    sensor.show(*_noise(rng), 2.0)
    assert read(device).time == 2.0
    assert shortened


def test_pictures_that_are_damaged_are_left_out_and_the_recording_ends_all_the_same(recording, opened, tmp_path, rng):
    content = bytearray(recording[0].read_bytes())
    data = data_of(content)
    for k in (6, 7, 18):
        content[data[k]] = rng.bytes(data[k].stop - data[k].start)
    damaged = tmp_path / "damaged.oni"
    damaged.write_bytes(content)
    device = opened("file", str(damaged))
    given = []
    with pytest.raises(SourceError, match="the end of the recording"):  # noqa: PT012
        while len(given) < 30:
            picture = device.read(0.3)
            given += [] if picture is None else [picture]
    assert [round(10 * picture.time) for picture in given] == [0, 1, 2, 4, 5, 6, 7, 8]


def test_recordings_are_opened_and_closed_again_and_again_wherever_they_are(recording):
    """The library crashes if one that does not repeat is closed at its end."""
    path, pictures = recording
    for k in range(60):
        with closing(OpenNIDevice(NAME, Place("file", str(path)))) as device:
            for depth, _ in pictures[: k % 11]:
                np.testing.assert_array_equal(read(device).depth, depth)


def test_a_recording_is_not_taken_for_a_sensor(recording, opened):
    opened("file", str(recording[0]))
    assert devices(openni2(NAME)) == []


ALONE = """
import sys
from capture.sensors.openni import openni2
from puppetline.errors import SourceError
try:
    openni2("openni:")
except SourceError as error:
    print(error.found, "|", error.expected, "|", error.fix)
"""


@pytest.mark.usefixtures("openni_folder")
def test_a_library_that_is_not_there_is_an_error_that_says_what_to_install(tmp_path):
    environment = {**os.environ, "OPENNI2_REDIST": str(tmp_path)}
    result = subprocess.run([sys.executable, "-c", ALONE], env=environment, capture_output=True, text=True, check=True)
    assert result.stdout.startswith("no OpenNI2 library that starts (none of libOpenNI2.so")
    assert "apt install libopenni2-0" in result.stdout
    assert "OPENNI2_REDIST" in result.stdout


@pytest.mark.usefixtures("openni_folder")
def test_starting_the_library_leaves_the_working_folder_alone():
    """The bindings' own way changes it for a moment, and a take that begins then would be written elsewhere."""
    script = f"import os; os.chdir = None\n{ALONE}\nfrom openni import openni2\nprint(openni2.is_initialized())"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout == "True\n"


REOPEN = """
import sys, threading, time
from capture.sensors.openni import devices, openni2
from capture.sensors.source import SensorSource
from puppetline.errors import SourceError

def unplugged():
    raise SourceError("openni:", found=f"{len(devices(library))} sensors", expected="one", fix="Plug it in.")

library = openni2("openni:")
for megabytes in range(64, 320, 16):  # so many that the system takes back a thread's memory as soon as it ends
    threading.stack_size(megabytes << 20)
    source = SensorSource("openni:", unplugged, None)
    try:
        while True:
            source.receive()
            time.sleep(0.001)
    except SourceError as error:
        print(error.found)
    source.close()
"""


@pytest.mark.usefixtures("openni_folder")
def test_a_sensor_is_looked_for_again_and_again_without_a_crash_of_the_library():
    """It asks the system about every thread that ever called it, which Linux does not forgive of one that has ended."""
    result = subprocess.run([sys.executable, "-c", REOPEN], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout.splitlines()) == (0, ["0 sensors"] * 16)


def test_an_opening_that_never_returns_does_not_hold_up_others_for_ever(sensor, monkeypatch):
    monkeypatch.setattr(module, "_PATIENCE", 0.1)
    with module._library, pytest.raises(SourceError, match="another sensor that OpenNI2 has been opening"):
        OpenNIDevice(NAME, Place())
