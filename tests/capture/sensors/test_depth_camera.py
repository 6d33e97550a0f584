"""What every depth camera does: OpenNI2's with a virtual sensor, librealsense's with its software device, and Orbbec's
with a stand-in for its SDK. libfreenect's runs in another process: see test_freenect.py.
"""

import sys
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import psutil
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.sensors import depth_camera, freenect, openni, openni_library, orbbec, realsense
from capture.sensors.depth_camera import MAX_ALONE_COUNT, Selection, metres, parse, upward
from capture.sensors.openni import OpenNIDevice
from capture.sensors.orbbec import OrbbecDevice
from capture.sensors.realsense import SETTINGS, RealSenseDevice
from capture.sources.registry import check_records
from puppetline.errors import OutputError

from ..conftest import read, refused


class OpenNI:
    """Two virtual sensors of the real OpenNI2 library."""

    def __init__(self, request):
        self.recording = lambda: (*request.getfixturevalue("recording"), 0.1)
        self._sensors = request.getfixturevalue("virtual_sensors")
        self.open = partial(OpenNIDevice, "openni:")

    def plug(self, number=0):
        self._sensors[number].plug()
        return self._sensors[number]

    def unplug(self):
        self._sensors[0].unplug()


class RealSense:
    """Software devices of the real librealsense."""

    usb = "2.1"

    def __init__(self, request):
        self.recording = lambda: (*request.getfixturevalue("recorded"), 1 / 30)
        self._plug = request.getfixturevalue("plug")
        self.open = partial(RealSenseDevice, "realsense:")

    def plug(self, number=0, **options):
        return self._plug(str(7 + number), **options)

    def unplug(self):
        del self._plug.sensors[0]

    def forbid(self, monkeypatch):
        def start(*_):
            raise RuntimeError("Reason: failed to open usb interface: 0, error: RS2_USB_STATUS_ACCESS")

        monkeypatch.setattr(RealSenseDevice, "_enable", start)


class Orbbec:
    """A stand-in for Orbbec's SDK."""

    usb = "USB2.1"

    def __init__(self, request):
        from . import orbbec_stand_in

        self.sdk = orbbec_stand_in
        request.getfixturevalue("monkeypatch").setitem(sys.modules, "pyorbbecsdk", orbbec_stand_in)
        orbbec_stand_in.PLUGGED.clear()
        self._noise = request.getfixturevalue("noise")
        self.open = partial(OrbbecDevice, "orbbec:")

    def plug(self, number=0, **options):
        self.sdk.PLUGGED.append(self.sdk.StandInSensor(str(7 + number), **options))
        return self.sdk.PLUGGED[-1]

    def unplug(self):
        del self.sdk.PLUGGED[0]

    def recording(self):
        pictures = [self._noise() for _ in range(3)]
        self.sdk.PlaybackDevice.RECORDING = [(*images, k / 30) for k, images in enumerate(pictures)]
        return "take.bag", pictures, 1 / 30

    def forbid(self, _monkeypatch):
        self.sdk.PLUGGED[0].forbids = True


@pytest.fixture(params=[OpenNI, RealSense, Orbbec], ids=lambda kind: kind.__name__)
def bus(request):
    """A kind of sensors: `plug`, `unplug`, and `open` with a selection."""
    return request.param(request)


@pytest.fixture
def opened(bus, until_end):
    """Open a device that is closed after the test: `opened(*selection)`."""
    return lambda *args, **options: until_end(bus.open(Selection(*args, **options)))


not_openni = pytest.mark.parametrize("bus", [RealSense, Orbbec], ids=lambda kind: kind.__name__, indirect=True)


@pytest.mark.parametrize(
    ("rest", "selection"),
    [
        ("", Selection()),
        ("uri=1d27/0601@1/5", Selection("uri", "1d27/0601@1/5")),
        ("file=a take.oni", Selection("file", "a take.oni")),
        ("file=take.oni&fast?loop", Selection("file", "take.oni", fast=True, loop=True)),
        ("?face&hands", Selection(face=True, hands=True)),
        ("serial=A1?hands", Selection("serial", "A1", hands=True)),
        ("file=take.oni?loop&face", Selection("file", "take.oni", loop=True, face=True)),
        ("take.db3?loop", Selection("file", "take.db3", loop=True)),
        ("serial=7&laser=150", Selection("serial", "7", settings={"laser": 150.0})),
        ("?exposure=8000", Selection(settings={"exposure": 8000.0})),
    ],
)
def test_a_uri_selects_a_sensor_or_a_recording(rest, selection):
    assert parse(f"sensor:{rest}", rest, ("serial", "uri"), SETTINGS) == selection


@pytest.mark.parametrize(
    "rest", ["1", "file", "file=", "uri=", "serial=1&fast", "file=a&slow", "fast", "file=a?fast=1"]
)
def test_a_wrong_uri_is_an_error(rest):
    assert refused(parse, f"sensor:{rest}", rest, ("serial", "uri")).found == repr(rest)


def test_a_setting_is_a_number():
    assert refused(parse, "sensor:?laser=much", "?laser=much", settings=SETTINGS).found == "'much'"


def test_images_have_the_sensors_pixels_and_times(bus, opened, noise):
    sensor = bus.plug()
    device = opened()
    for k in range(5):
        depth, color = noise()
        sensor.show(depth, color, 1.0 + k / 30)
        picture = read(device)
        assert (picture.depth.dtype, picture.color.dtype) == (np.float32, np.uint8)
        assert_allclose(picture.depth, depth, rtol=2e-7)
        assert_array_equal(picture.color, color)
        assert picture.time == pytest.approx(1.0 + k / 30, abs=2e-6)
    assert (picture.lens.width, picture.lens.height) == (640, 480)
    assert picture.lens.project(np.array([0.0, 0.0, 1.0])).tolist() in ([320.0, 240.0], [311.0, 251.0])


def test_a_sensor_is_chosen_by_serial_number_and_two_work_at_once(bus, opened, noise):
    sensors = [bus.plug(number) for number in range(2)]
    devices = [opened("serial", sensor.serial) for sensor in sensors]
    shown = [noise() for _ in sensors]
    for sensor, images in zip(sensors, shown, strict=True):
        sensor.show(*images, 1.0)
    for device, (_, color) in zip(devices, shown, strict=True):
        assert_array_equal(read(device).color, color)


def test_a_sensor_that_is_not_plugged_in_is_an_error_that_lists_those_that_are(bus):
    assert refused(bus.open, Selection()).found == "no sensor"
    bus.plug()
    error = refused(bus.open, Selection("serial", "9"))
    assert error.found.startswith("sensors ")
    assert error.expected == "a sensor with the serial 9"


def test_an_unplugged_sensor_is_an_error_and_works_again_when_it_is_plugged_in(bus, noise):
    for taken in (5.0, 0.5):
        sensor = bus.plug()
        with closing(bus.open(Selection())) as device:
            sensor.show(*noise(), taken)
            assert read(device).time == taken
            bus.unplug()
            assert "unplugged" in refused(read, device).found


@not_openni
@pytest.mark.parametrize("lacks", [0, 1])
def test_one_kind_of_images_without_the_other_is_an_error_and_it_comes_back(bus, opened, noise, lacks):
    sensor, device = bus.plug(), opened()
    sensor.show(*noise(), 1.0)
    read(device)
    images = list(noise())
    images[lacks] = None

    def look():
        for k in range(2, 4 * MAX_ALONE_COUNT):
            sensor.show(*images, 1.0 + k / 30)
            device.read(0.01)

    assert ("depth without colour" if lacks else "colour without depth") in refused(look).found
    device.close()
    again = opened()
    sensor.show(*noise(), 9.0)
    assert read(again).time == 9.0


@not_openni
def test_a_lost_image_of_one_kind_costs_its_counterpart_only(bus, opened, noise, caplog):
    """The port is slow, which is logged, and the accelerometer shows what is up."""
    sensor, device = bus.plug(usb=bus.usb), opened()
    assert "use a USB 3 port and cable" in caplog.text
    shown = [[*noise(), 1.0 + k / 30] for k in range(6)]
    shown[1][0] = shown[3][1] = None
    pictures = []
    for images in shown:
        sensor.show(*images)
        pictures.append(device.read(0.2))
    pictures = [picture for picture in pictures if picture is not None]
    for picture, (depth, color, moment) in zip(pictures, (shown[k] for k in (0, 2, 4, 5)), strict=True):
        assert picture.time == pytest.approx(moment, abs=2e-6)
        assert_allclose(picture.depth, depth, rtol=2e-7)
        assert_array_equal(picture.color, color)
    assert_allclose(pictures[-1].up, [0, 1, 0], atol=1e-6)


@not_openni
def test_missing_permission_and_a_sensor_in_use_are_errors_and_it_opens_once_it_can(bus, opened, noise):
    sensor = bus.plug()
    with pytest.MonkeyPatch.context() as patched:
        bus.forbid(patched)
        assert "udev" in refused(opened).fix
    if isinstance(bus, Orbbec):
        sensor.forbids = False
    first = opened()
    assert "Close other programs" in refused(opened).fix
    first.close()
    device = opened()
    sensor.show(*noise(), 1.0)
    assert read(device).time == 1.0


def test_memory_stays_the_same_from_image_to_image(bus, opened, noise):
    sensor, device = bus.plug(), opened()
    images, used = noise(), []
    for k in range(240):
        sensor.show(*images, 1.0 + k / 30)
        read(device)
        if k % 60 == 59:
            used.append(psutil.Process().memory_info().rss)
    assert used[-1] - used[1] < 8e6  # an image is 2 MB


def test_a_recording_plays_the_recorded_images_and_ends_or_its_time_increases(bus, opened):
    path, pictures, step = bus.recording()
    device = opened("file", str(path))
    for depth, color in pictures:
        picture = read(device)
        assert_allclose(picture.depth, depth, rtol=2e-7)
        assert_array_equal(picture.color, color)
    assert refused(read, device).found == "the end of the recording"
    device, count = opened("file", str(path), loop=True), len(pictures)
    seen = [read(device) for _ in range(2 * count + 1)]
    spaces = [1 / 30 if k % count == 0 else step for k in range(1, len(seen))]
    assert_allclose(np.diff([picture.time for picture in seen]), spaces, atol=1e-5)
    for k, picture in enumerate(seen):
        assert_allclose(picture.depth, pictures[k % count][0], rtol=2e-7)


@pytest.mark.parametrize("bus", [Orbbec], indirect=True)
def test_recordings_of_orbbec_have_their_names_when_they_are_complete(bus, opened, tmp_path):
    bus.plug()
    file = tmp_path / "take.bag"
    check_records("orbbec:", file)
    with closing(bus.open(Selection(), record=file)):
        assert [path.name for path in tmp_path.iterdir()] == [".take.part.bag"]
    assert [path.name for path in tmp_path.iterdir()] == ["take.bag"]
    with pytest.raises(OutputError):
        check_records("orbbec:", tmp_path / "take.db3")
    refused(opened, "file", "half.bag")


@pytest.mark.parametrize(
    ("module", "library", "package"),
    [(orbbec, "pyorbbecsdk", "--no-deps pyorbbecsdk2"), (realsense, "pyrealsense2", "'puppetline[realsense]'")],
)
def test_a_missing_library_is_an_error_with_the_command_that_installs_it(monkeypatch, module, library, package):
    monkeypatch.setitem(sys.modules, library, None)
    assert f"pip install {package}" in refused(module.open_source, "sensor:", "", Path()).fix


def test_what_is_up_follows_from_the_acceleration_of_a_sensor_at_rest():
    tilted = 9.8 * np.array([0.0, -np.cos(0.3), -np.sin(0.3)])  # in the axes of an image: right, down and away
    assert_allclose(upward(tilted, np.eye(3)), [0, np.cos(0.3), -np.sin(0.3)])
    assert upward([0, -14.0, 0], np.eye(3)) is None
    assert metres(np.array([2500], np.uint16)).tolist() == [2.5]


@pytest.mark.parametrize(("module", "number"), [(openni, ""), (freenect, "1"), (realsense, ""), (orbbec, "")])
def test_every_one_measures_faces_and_hands_if_asked(monkeypatch, module, number):
    def tracker_of(rest):
        made = []
        monkeypatch.setattr(depth_camera, "MediaPipePose", lambda **options: made.append(options))
        module.open_source(f"{module.__name__}:{rest}", rest, Path())
        return made

    monkeypatch.setattr(openni_library, "load_openni2", lambda _: None)
    for name in ("load_realsense", "load_orbbec", "load_mediapipe", "_load"):
        monkeypatch.setattr(module, name, lambda *_: None, raising=False)
    monkeypatch.setattr(depth_camera, "load_mediapipe", lambda: None)
    monkeypatch.setattr(depth_camera, "SensorSource", lambda _uri, _device, open_tracker: open_tracker(None))
    for asked, face in (("face&hands", True), ("hands", False)):
        assert tracker_of(f"{number}?{asked}") == [{"face": face, "hands": True}]
