"""Videos that the tests write, decoded by the real OpenCV; errors of cameras before and after they open."""

import math
import os
import sys
from contextlib import suppress

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.sensors.camera import Camera, Options, Video, load_opencv, open_camera, open_video, parse
from puppetline.errors import SourceError

from ..conftest import Watched, refused

RATE, COUNT, WIDTH, HEIGHT = 20, 8, 160, 120


@pytest.fixture(scope="module")
def video_file(camera, tmp_path_factory):
    """A video of 8 images; the k-th has red, green and blue 30k, 200 and 10."""
    cv2 = load_opencv()
    path = tmp_path_factory.mktemp("video") / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), RATE, (WIDTH, HEIGHT))
    assert writer.isOpened()
    for k in range(COUNT):
        writer.write(np.full((HEIGHT, WIDTH, 3), (10, 200, 30 * k), np.uint8))
    writer.release()
    return path


@pytest.fixture
def opened_video(video_file, until_end):
    return lambda path=video_file, **options: until_end(Video("video:clip", path, Options(str(path), **options)))


def all_of(video):
    """Return the images up to the end."""
    pictures = []
    with suppress(SourceError):
        while True:
            pictures.append(video.read(1.0))
    return pictures


@pytest.mark.parametrize(
    ("rest", "options"),
    [
        ("", Options("0")),
        ("/dev/video4?fov=90", Options("/dev/video4", fov=90.0)),
        ("a clip.mp4?height=1.5&loop&fov=60", Options("a clip.mp4", height=1.5, fov=60.0, loop=True)),
    ],
)
def test_options_are_read(rest, options):
    assert parse("video:" + rest, rest) == options


@pytest.mark.parametrize(
    ("rest", "field"),
    [
        *(("0?size=2", ""), ("0?height=1.7&height=1.8", ""), ("0?height=175", "height"), ("0?height=nan", "height")),
        *(("0?height=", "height"), ("0?fov=wide", "fov"), ("0?loop=no", "loop")),
    ],
)
def test_wrong_options_are_errors_with_their_place(rest, field):
    error = refused(parse, "camera:" + rest, rest)
    assert error.where.startswith("camera:")
    assert field in error.where


def test_images_have_the_times_and_colours_of_the_video_and_then_it_ends(opened_video):
    video = opened_video()
    pictures = all_of(video)
    assert_allclose([picture.time for picture in pictures], np.arange(COUNT) / RATE, atol=1e-9)
    for k, picture in enumerate(pictures):
        assert (picture.color.shape, picture.depth) == ((HEIGHT, WIDTH, 3), None)
        assert_allclose(picture.color.mean(axis=(0, 1)), (30 * k, 200, 10), atol=4)
    assert refused(video.read, 1.0).found == "the end of the video"


def test_the_angle_between_the_images_corners_is_the_field_of_view(opened_video):
    lens = opened_video(fov=80.0).read(1.0).lens
    left, right = lens.unproject(np.array([[0, 0], [WIDTH, HEIGHT]]), np.ones(2))
    cosine = left @ right / np.linalg.norm(left) / np.linalg.norm(right)
    assert math.degrees(math.acos(cosine)) == pytest.approx(80)


def test_the_time_of_a_looped_video_increases(opened_video):
    video = opened_video(loop=True)
    pictures = [video.read(1.0) for _ in range(3 * COUNT)]
    assert_allclose([picture.time for picture in pictures], np.arange(3 * COUNT) / RATE, atol=1e-9)
    assert_array_equal(pictures[3].color, pictures[3 + 2 * COUNT].color)


@pytest.mark.parametrize("content", [b"", b"no video at all" * 100, b"RIFF\xff\xff\xff\xffAVI LIST"])
def test_a_file_without_images_is_an_error(opened_video, tmp_path, content):
    broken = tmp_path / "broken.avi"
    broken.write_bytes(content)
    assert f"{broken} ({len(content)} bytes)" in refused(opened_video, broken).found


def test_a_missing_video_or_a_looped_camera_is_an_error_when_it_is_opened(camera, tmp_path):
    refused(open_video, "video:none.mp4", "none.mp4", tmp_path)
    refused(open_camera, "camera:0?loop", "0?loop")


@pytest.mark.parametrize("module", ["cv2", "mediapipe.python.solutions.pose"])
def test_a_missing_library_is_an_error_with_the_package(monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    assert "pip install 'puppetline[camera]'" in refused(open_camera, "camera:0", "0").fix


linux = pytest.mark.skipif(sys.platform != "linux", reason="devices are files on Linux")


@linux
def test_the_source_raises_the_error_of_its_camera(camera, until_end):
    assert "/dev/video98" in Watched(until_end(open_camera("camera:98", "98"))).error().found


@linux
def test_missing_permission_is_an_error_with_the_devices_group(camera, tmp_path, monkeypatch):
    device = tmp_path / "video0"
    device.touch()
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # tests may run as root
    assert f"usermod -aG {device.group()} " in refused(Camera, "camera:here", Options(str(device))).fix


@linux
def test_a_device_that_is_not_a_camera_is_an_error(camera):
    assert "/dev/null" in refused(Camera, "camera:/dev/null", Options("/dev/null")).found


@linux
def test_a_camera_that_stops_is_an_error(video_file, monkeypatch):
    """A video stands in for the camera: at its end, it behaves like an unplugged camera."""
    cv2 = load_opencv()
    monkeypatch.setattr(cv2, "CAP_V4L2", cv2.CAP_FFMPEG)
    device = Camera("camera:clip", Options(str(video_file)))
    times = [device.read(1.0).time for _ in range(COUNT)]
    assert times == sorted(times)
    refused(device.read, 1.0)
    device.close()
    device.close()
