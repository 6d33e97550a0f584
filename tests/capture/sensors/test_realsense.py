"""Through the real librealsense, with its own software device in place of a sensor on USB."""

from contextlib import ExitStack, closing
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from capture.sensors import realsense
from capture.sensors.depth_camera import MAX_ALONE_COUNT, Selection
from capture.sensors.realsense import SETTINGS, RealSenseDevice, parse
from puppetline.errors import SourceError

from ...conftest import missing
from ..devices import read

NAME = "realsense:"


@pytest.fixture
def bus(monkeypatch):
    """Sensors that are plugged in: a list to which tests add virtual ones."""
    if find_spec("pyrealsense2") is None:
        missing("realsense", "librealsense is not here (pip install pyrealsense2)")
    sensors = []
    monkeypatch.setattr(realsense, "plugged_in", lambda _rs: [sensor.device for sensor in sensors])
    return sensors


@pytest.fixture
def plug(bus):
    """Plug a virtual sensor in: `plug(serial, …)`."""
    from .virtual_realsense import VirtualRealSense

    def plugged(*args, **options):
        bus.append(VirtualRealSense(*args, **options))
        return bus[-1]

    return plugged


@pytest.fixture
def opened():
    """Open a device that is closed after the test."""
    with ExitStack() as stack:
        yield lambda *args, **options: stack.enter_context(closing(RealSenseDevice(NAME, Selection(*args), **options)))


@pytest.fixture
def recorded(plug, noise, tmp_path):
    """A recording of ten images, and the images."""
    sensor, path, pictures = plug("7"), tmp_path / "take.db3", [noise() for _ in range(10)]
    with closing(RealSenseDevice(NAME, Selection(), record=path)) as device:
        for k, (depth, color) in enumerate(pictures):
            sensor.show(depth, color, 1.0 + k / 30)
            read(device)
    return path, pictures


def test_images_have_the_sensors_pixels_times_lens_and_upward_direction(plug, opened, noise):
    sensor, device = plug("7"), None
    device = opened()
    for k in range(5):
        depth, color = noise()
        sensor.show(depth, color, 1.0 + k / 30)
        picture = read(device)
        np.testing.assert_array_equal(picture.depth, depth)
        np.testing.assert_array_equal(picture.color, color)
        assert picture.time == pytest.approx(1.0 + k / 30, abs=1e-6)
        np.testing.assert_allclose(picture.up, [0, 1, 0], atol=1e-6)
    assert (picture.lens.focal, picture.lens.offset) == (600.0, (-9.0, 11.0))


def test_a_corner_of_depth_is_where_the_lens_of_colour_projects_it(plug, opened):
    """A board whose corner is at a known place; the depth camera is 5 cm beside the colour camera."""
    sensor = plug("7", apart=True)
    device = opened()
    corner = np.array([0.1, -0.08, 2.0])  # right of, above and away from the depth camera
    depth = np.full((480, 640), 4.0, np.float32)
    column, row = 500 * corner[:2] / corner[2] + [320, 240]
    depth[: round(row), round(column) :] = 2.0
    sensor.show(depth, np.zeros((480, 640, 3), np.uint8), 1.0)
    picture = read(device)
    place = np.array([-(corner[0] + 0.05), -corner[1], corner[2]])  # sensor coordinates of the colour camera
    column, row = picture.lens.project(place)
    near = (picture.depth > 1.5) & (picture.depth < 2.5)
    rows, columns = np.nonzero(near)
    assert columns.min() == pytest.approx(column, abs=1.5)
    assert rows.max() + 1 == pytest.approx(row, abs=1.5)


def test_a_sensor_is_chosen_by_serial_number_and_two_work_at_once(plug, opened, noise):
    sensors = [plug(serial) for serial in ("7", "8")]
    devices = [opened("serial", sensor.serial) for sensor in sensors]
    shown = [noise() for _ in sensors]
    for sensor, images in zip(sensors, shown, strict=True):
        sensor.show(*images, 1.0)
    for sensor, device, (depth, color) in zip(sensors, devices, shown, strict=True):
        picture = read(device)
        assert device.name == f"Virtual RealSense {sensor.serial}"
        np.testing.assert_array_equal(picture.depth, depth)
        np.testing.assert_array_equal(picture.color, color)


def test_a_missing_sensor_is_an_error_that_lists_the_others(plug):
    plug("7")
    with pytest.raises(SourceError) as caught:
        RealSenseDevice(NAME, Selection("serial", "9"))
    assert (caught.value.found, caught.value.expected) == ("sensors 7", "a sensor with the serial 9")


def test_an_unplugged_sensor_is_an_error_and_works_again_when_it_is_plugged_in(
    bus, plug, noise, watch, scripted_tracker
):
    for taken in (5.0, 0.5):
        sensor = plug("7")
        watched = watch(partial(RealSenseDevice, NAME, Selection()), scripted_tracker)
        while not watched.source.counts.received:
            sensor.show(*noise(), taken)
            taken += 1 / 30
            watched.wait()
            watched.source.receive()
        bus.clear()
        assert watched.error().found == "an unplugged sensor (Virtual RealSense 7)"
        watched.source.close()
        unplugged = watch(partial(RealSenseDevice, NAME, Selection()), scripted_tracker)
        assert unplugged.error().found == "no sensor"


def test_a_slow_usb_port_is_logged(plug, opened, caplog):
    plug("7", usb="2.1")
    opened()
    assert "connected by USB 2.1" in caplog.text


@pytest.mark.parametrize(("lacks", "found"), [(0, "colour without depth"), (1, "depth without colour")])
def test_one_kind_of_images_without_the_other_is_an_error(plug, opened, noise, lacks, found):
    sensor, device = plug("7"), opened()
    sensor.show(*noise(), 1.0)
    read(device)
    images = list(noise())
    images[lacks] = None
    with pytest.raises(SourceError, match=found):  # noqa: PT012
        for k in range(2, 4 * MAX_ALONE_COUNT):
            sensor.show(*images, 1.0 + k / 30)
            device.read(0.05)


def test_a_recording_plays_the_recorded_images_and_ends(recorded, opened):
    path, pictures = recorded
    device = opened("file", str(path))
    for depth, color in pictures:
        picture = read(device)
        np.testing.assert_array_equal(picture.depth, depth)
        np.testing.assert_array_equal(picture.color, color)
    with pytest.raises(SourceError) as caught:
        read(device)
    assert caught.value.found == "the end of the recording"


@pytest.mark.parametrize("content", ["half", "empty", "text", "none"])
def test_a_damaged_file_is_an_error(recorded, opened, content):
    path = recorded[0].with_name(f"{content}.db3")
    whole = recorded[0].read_bytes()
    if content != "none":
        path.write_bytes({"half": whole[: len(whole) // 2], "empty": b"", "text": b"hello" * 1000}[content])
    with pytest.raises(SourceError, match="a file that librealsense does not play"):
        opened("file", str(path))


def test_a_uri_has_a_file_a_serial_number_or_settings():
    assert parse(NAME, "take.db3?loop") == Selection("file", "take.db3", loop=True)
    assert parse(NAME, "serial=7&laser=150", settings=SETTINGS) == Selection("serial", "7", settings={"laser": 150.0})
    assert parse(NAME, "?exposure=8000", settings=SETTINGS) == Selection(settings={"exposure": 8000.0})
    with pytest.raises(SourceError, match="a number of milliwatts"):
        parse(NAME, "?laser=much", settings=SETTINGS)


def test_a_missing_library_is_an_error_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyrealsense2", None)
    with pytest.raises(SourceError, match=r"puppetline\[realsense\]"):
        realsense.open_source(NAME, "", Path())
