"""Through the real librealsense, with its own software device in place of a sensor on USB."""

from contextlib import closing
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal

from capture.sensors import depth_camera
from capture.sensors.depth_camera import Selection
from capture.sensors.realsense import RealSenseDevice
from engine_bridge.cli.record import record

from ...waiting import wait_until
from ..conftest import read, refused

NAME = "realsense:"


@pytest.fixture
def opened(plug, until_end):
    """Open a device that is closed after the test."""
    return lambda *args, **options: until_end(RealSenseDevice(NAME, Selection(*args, **options)))


def test_a_corner_of_depth_is_where_the_lens_of_colour_projects_it(plug, opened):
    """A board whose corner is at a known place; the depth camera is 5 cm beside the colour camera."""
    sensor, device = plug("7", apart=True), opened()
    corner = np.array([0.1, -0.08, 2.0])  # right of, above and away from the depth camera
    depth = np.full((480, 640), 4.0, np.float32)
    column, row = 500 * corner[:2] / corner[2] + [320, 240]
    depth[: round(row), round(column) :] = 2.0
    sensor.show(depth, np.zeros((480, 640, 3), np.uint8), 1.0)
    picture = read(device)
    place = np.array([-(corner[0] + 0.05), -corner[1], corner[2]])  # sensor coordinates of the colour camera
    rows, columns = np.nonzero((picture.depth > 1.5) & (picture.depth < 2.5))
    assert [columns.min(), rows.max() + 1] == pytest.approx(picture.lens.project(place), abs=1.5)


def test_images_that_cannot_be_aligned_are_an_error_and_it_comes_back(plug, opened, noise):
    sensor, device = plug("7", apart=True), opened()
    device._align = Mock(process=Mock(side_effect=RuntimeError("Error occured")))
    sensor.show(*noise(), 1.0)
    assert "Error occured" in refused(lambda: read(device).depth).found
    device.close()
    again = opened()
    sensor.show(*noise(), 2.0)
    assert read(again).depth.any()


def test_a_bag_of_an_older_librealsense_plays(opened):
    """Librealsense 2.55 has recorded three images of a `VirtualRealSense` of 16×12 pixels."""
    device = opened("file", str(Path(__file__).with_name("librealsense_2_55.bag")))
    for k in range(3):
        picture = read(device)
        assert picture.time == pytest.approx(1 + k / 30, abs=1e-6)
        assert_allclose(picture.depth, np.full((12, 16), 1 + k / 10), rtol=1e-6)
        assert_array_equal(picture.color, np.full((12, 16, 3), 10 * k))
    refused(read, device)


@pytest.mark.parametrize("content", ["half", "empty", "text", "none"])
def test_a_damaged_file_is_an_error(recorded, opened, content):
    path = recorded[0].with_name(f"{content}.db3")
    whole = recorded[0].read_bytes()
    if content != "none":
        path.write_bytes({"half": whole[: len(whole) // 2], "empty": b"", "text": b"hello" * 1000}[content])
    refused(opened, "file", str(path))


def test_record_writes_the_images_beside_the_take(
    plug, opened, noise, monkeypatch, scripted_tracker, tmp_path, given_clock
):
    sensor, images, seen = plug("7"), noise(), scripted_tracker.seen
    monkeypatch.setattr(depth_camera, "load_mediapipe", lambda: None)
    monkeypatch.setattr(depth_camera, "MediaPipePose", lambda **_: scripted_tracker)

    def perform():
        before = len(seen)
        wait_until(lambda: sensor.show(*images, given_clock.now()) or len(seen) > before)

    for k in range(1, 6):
        given_clock.call_at(given_clock.now() + 0.1 * k, perform)
    files = [str(tmp_path / name) for name in ("take.log", "take.db3")]
    arguments = ["--source", NAME, "-o", files[0], "--sensor", files[1], "--seconds", "0.7"]
    found = CliRunner().invoke(record, arguments)
    refused = CliRunner().invoke(record, ["--source", "demo:walk", "-o", files[0], "--sensor", f"{tmp_path}/b.db3"])
    assert found.exit_code == 0, found.output
    # the device's thread closes it in its own time
    wait_until(lambda: sorted(path.name for path in tmp_path.iterdir()) == ["take.db3", "take.log"])
    assert_array_equal(read(opened("file", files[1])).color, images[1])
    assert "a source whose sensor cannot record its images" in str(refused.exception)


def test_settings_reach_the_sensor_and_a_setting_that_it_lacks_is_an_error(plug):
    sensor = plug("7")
    for settings in ({"laser": 90.0}, {}):
        with closing(RealSenseDevice(NAME, Selection(settings=settings))):
            assert sensor.laser == 90.0
    refused(RealSenseDevice, NAME, Selection(settings={"exposure": 8000.0}))
