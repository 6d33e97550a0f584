"""Through the real OpenNI2 library, with sensors that a test driver provides; see virtual_sensor.cpp."""

import gc
import time
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest

from capture.sensors import depth_camera, oni_file
from capture.sensors.depth_camera import Selection, parse
from capture.sensors.openni import OpenNIDevice, open_source
from capture.sensors.openni_library import list_sensors, load_openni2
from puppetline.errors import SourceError

from ..conftest import data_of, read

NAME = "openni:"


@pytest.mark.parametrize(
    ("rest", "selection"),
    [
        ("", Selection()),
        ("serial=A1", Selection("serial", "A1")),
        ("uri=1d27/0601@1/5", Selection("uri", "1d27/0601@1/5")),
        ("file=a take.oni", Selection("file", "a take.oni")),
        ("file=take.oni&fast", Selection("file", "take.oni", fast=True)),
        ("file=take.oni?loop", Selection("file", "take.oni", loop=True)),
        ("file=take.oni&fast?loop", Selection("file", "take.oni", fast=True, loop=True)),
        ("?face&hands", Selection(face=True, hands=True)),
        ("serial=A1?hands", Selection("serial", "A1", hands=True)),
        ("file=take.oni?loop&face", Selection("file", "take.oni", loop=True, face=True)),
    ],
)
def test_a_uri_selects_a_sensor_or_a_recording(rest, selection):
    assert parse(NAME + rest, rest, ("serial", "uri")) == selection


@pytest.mark.parametrize(
    "rest", ["1", "file", "file=", "uri=", "serial=1&fast", "file=a&slow", "fast", "file=a?fast=1"]
)
def test_a_wrong_uri_is_an_error_with_the_right_forms(rest):
    with pytest.raises(SourceError, match="expected nothing, serial=TEXT, uri=TEXT or file=NAME") as caught:
        parse(NAME + rest, rest, ("serial", "uri"))
    assert caught.value.found == repr(rest)


def test_a_function_that_a_sensor_lacks_is_logged_and_the_others_are_used(sensor, opened, noise, caplog):
    sensor.unplug()
    sensor.plug(refuses=("registration", "synchronisation", "mirror off"))
    device = opened()
    for moment in (1.0, 1.1):
        depth, color = noise()
        sensor.show(depth, color, moment)
        picture = read(device)
    assert caplog.messages == [
        "openni: Puppetline virtual sensor 0 cannot register depth to colour: depth is slightly displaced",
        "openni: the times of depth and colour of Puppetline virtual sensor 0 differ by 5.0 ms",
    ]
    np.testing.assert_array_equal(picture.color, color)
    np.testing.assert_array_equal(picture.depth[:, 8:], depth[:, :-8])


def test_waiting_for_an_image_ends_with_the_timeout(sensor, opened):
    device = opened()
    start = time.monotonic()
    assert device.read(0.2) is None
    assert time.monotonic() - start >= 0.19


def test_a_sensor_that_did_not_open_often_opens_once_it_can(sensor, opened, noise):
    """Another program may release it; closing a device that did not open would crash the library."""
    sensor.refuse("opening")
    for _ in range(4):
        with pytest.raises(SourceError, match=r"the virtual sensor refuses.* Close other programs"):
            OpenNIDevice(NAME, Selection())
        assert list_sensors(NAME)[0].error is not None
        gc.collect()
    sensor.refuse()
    device = opened()
    sensor.show(*noise(), 1.0)
    assert read(device).time == 1.0


def test_closing_stops_the_sensor_which_then_opens_again(sensor):
    for _ in range(3):
        device = OpenNIDevice(NAME, Selection())
        sensor.wait_for_streams()
        device.close()
        device.close()
        assert sensor.streaming == 0


@pytest.mark.usefixtures("virtual_sensors")
def test_a_missing_recording_is_an_error_when_it_is_opened(tmp_path, monkeypatch):
    monkeypatch.setattr(depth_camera, "load_mediapipe", lambda: None)
    with pytest.raises(SourceError, match=rf"found {tmp_path}/take.oni, which cannot be read \(No such file"):
        open_source("openni:file=take.oni", "file=take.oni", tmp_path)


def test_a_recording_plays_the_recorded_images_and_ends(recording, opened):
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


def test_the_log_says_that_a_recording_does_not_state_its_registration(recording, caplog):
    caplog.set_level("INFO", "capture")
    with closing(OpenNIDevice("openni:file=take.oni", Selection("file", str(recording[0])))):
        assert caplog.messages == [
            "openni:file=take.oni: the recording does not state whether depth is registered to colour: "
            "assuming that it is"
        ]


def test_the_log_says_that_a_recordings_depth_is_not_registered(recording, caplog, monkeypatch):
    """Other builds of the library may state it; Debian's does not."""
    bindings = load_openni2(NAME)
    monkeypatch.setattr(bindings.Device, "get_image_registration_mode", lambda _device: bindings.IMAGE_REGISTRATION_OFF)
    with closing(OpenNIDevice("openni:file=take.oni", Selection("file", str(recording[0])))):
        assert caplog.messages == [
            "openni:file=take.oni: the recording's depth is not registered to colour: depth is slightly displaced"
        ]


def test_the_time_of_a_looped_recording_increases(recording, opened):
    path, pictures = recording
    device = opened("file", str(path), loop=True)
    times = []
    for k in range(25):
        picture = read(device)
        np.testing.assert_array_equal(picture.depth, pictures[k % 10][0])
        times.append(picture.time)
    spaces = np.diff(times)
    np.testing.assert_allclose(spaces, [1 / 30 if (k + 1) % 10 == 0 else 0.1 for k in range(24)], atol=1e-5)


@pytest.fixture
def damaged(recording, tmp_path):
    """An incomplete recording, on which the library sometimes crashes."""
    path = tmp_path / "damaged.oni"
    path.write_bytes(recording[0].read_bytes()[:10_000_000])
    return path


def test_a_damaged_recording_never_reaches_the_library(damaged):
    with pytest.raises(SourceError, match="which is damaged at byte 1"):
        OpenNIDevice(NAME, Selection("file", str(damaged)))


def test_only_another_process_crashes_on_a_damaged_recording(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(depth_camera, "load_mediapipe", lambda: None)
    damaged = tmp_path / "damaged.oni"
    content = bytearray(recording[0].read_bytes())
    content[23] = 127  # billions of nodes
    damaged.write_bytes(content)
    with pytest.raises(SourceError) as caught:
        open_source("openni:file=damaged.oni", "file=damaged.oni", tmp_path)
    assert caught.value.found == f"{damaged}, on which OpenNI2 crashes"


def test_a_recording_on_which_the_library_hangs_is_an_error(recording, tmp_path, monkeypatch):
    monkeypatch.setattr(oni_file, "_PLAY", "import time; time.sleep(60)")
    monkeypatch.setattr(oni_file, "_PLAY_SECONDS", 0.1)
    with pytest.raises(SourceError, match=r"take\.oni, on which OpenNI2 hangs"):
        oni_file.check_plays(NAME, recording[0])


def test_an_image_with_too_few_bytes_is_skipped(sensor, opened, noise, monkeypatch):
    """OpenNI2 delivers one if the compressed data of a recording are damaged."""
    device = opened()
    pixels, shortened = device._pixels, []

    def first_shortened(kind, frame):
        if shortened:
            return pixels(kind, frame)
        shortened.append(frame)
        return pixels(kind, SimpleNamespace(height=480, width=640, stride=frame.stride, dataSize=1000))

    monkeypatch.setattr(device, "_pixels", first_shortened)
    sensor.show(*noise(), 1.0)
    assert device.read(0.2) is None
    sensor.show(*noise(), 2.0)
    assert read(device).time == 2.0
    assert shortened


def test_damaged_images_are_skipped_and_the_recording_still_ends(recording, opened, tmp_path):
    content = bytearray(recording[0].read_bytes())
    data = data_of(content)
    for k in (6, 7, 18):
        content[data[k]] = np.random.default_rng(3).bytes(data[k].stop - data[k].start)
    damaged = tmp_path / "damaged.oni"
    damaged.write_bytes(content)
    device = opened("file", str(damaged))
    given = []
    with pytest.raises(SourceError, match="the end of the recording"):  # noqa: PT012
        while len(given) < 30:
            picture = device.read(0.3)
            given += [] if picture is None else [picture]
    assert [round(10 * picture.time) for picture in given] == [0, 1, 2, 4, 5, 6, 7, 8]


def test_a_recording_can_be_closed_anywhere_many_times(recording):
    """The library crashes if a recording that does not repeat is closed at its end."""
    path, pictures = recording
    for k in range(60):
        with closing(OpenNIDevice(NAME, Selection("file", str(path)))) as device:
            for depth, _ in pictures[: k % 11]:
                np.testing.assert_array_equal(read(device).depth, depth)
