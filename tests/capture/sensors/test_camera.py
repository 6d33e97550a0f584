"""Videos that the tests write, decoded by the real OpenCV; errors of cameras before and after they open."""

import math
import os
import sys
from contextlib import suppress
from select import select

import numpy as np
import pytest

from capture.sensors.camera import Camera, Options, Video, load_opencv, open_camera, open_video, parse
from puppetline.errors import SourceError

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
        ("2", Options("2")),
        ("/dev/video4?fov=90", Options("/dev/video4", fov=90.0)),
        ("a clip.mp4?loop", Options("a clip.mp4", loop=True)),
        ("clip.mp4?height=1.5&loop&fov=60", Options("clip.mp4", height=1.5, fov=60.0, loop=True)),
    ],
)
def test_options_are_read(rest, options):
    assert parse("video:" + rest, rest) == options


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        ("0?size=2", "found the option 'size'; expected height, fov, loop"),
        ("0?height=1.7&height=1.8", "the option 'height' for the second time"),
        ("0?height=175", "height: found '175'; expected 0.5 to 2.5 metres"),
        ("0?height=nan", "height: found 'nan'"),
        ("0?height=", "height: found ''"),
        ("0?fov=wide", "fov: found 'wide'; expected 20 to 150 degrees"),
        ("0?loop=no", "loop: found 'no'; expected no value"),
    ],
)
def test_wrong_options_are_errors(rest, message):
    with pytest.raises(SourceError, match=f"camera:.*{message}"):
        parse("camera:" + rest, rest)


def test_images_have_the_times_and_colours_of_the_video(opened_video):
    pictures = all_of(opened_video())
    np.testing.assert_allclose([picture.time for picture in pictures], np.arange(COUNT) / RATE, atol=1e-9)
    for k, picture in enumerate(pictures):
        assert picture.color.shape == (HEIGHT, WIDTH, 3)
        assert picture.depth is None
        np.testing.assert_allclose(picture.color.mean(axis=(0, 1)), (30 * k, 200, 10), atol=4)


def test_the_end_of_a_video_is_an_error(opened_video):
    video = opened_video()
    all_of(video)
    with pytest.raises(SourceError, match=r"found the end of the video; expected more images. Add \?loop"):
        video.read(1.0)


def test_the_angle_between_the_images_corners_is_the_field_of_view(opened_video):
    lens = opened_video(fov=80.0).read(1.0).lens
    left, right = lens.unproject(np.array([[0, 0], [WIDTH, HEIGHT]]), np.ones(2))
    cosine = left @ right / np.linalg.norm(left) / np.linalg.norm(right)
    assert math.degrees(math.acos(cosine)) == pytest.approx(80)


def test_the_time_of_a_looped_video_increases(opened_video):
    video = opened_video(loop=True)
    pictures = [video.read(1.0) for _ in range(3 * COUNT)]
    np.testing.assert_allclose([picture.time for picture in pictures], np.arange(3 * COUNT) / RATE, atol=1e-9)
    np.testing.assert_array_equal(pictures[3].color, pictures[3 + 2 * COUNT].color)


@pytest.mark.parametrize("content", [b"", b"no video at all" * 100, b"RIFF\xff\xff\xff\xffAVI LIST"])
def test_a_file_without_images_is_an_error(opened_video, tmp_path, content):
    broken = tmp_path / "broken.avi"
    broken.write_bytes(content)
    with pytest.raises(SourceError, match=rf"video:clip: found no image in .*broken.avi \({len(content)} bytes\)"):
        opened_video(broken)


def test_an_incomplete_video_plays_up_to_its_end(opened_video, video_file, tmp_path):
    half = tmp_path / "half.avi"
    whole = video_file.read_bytes()
    half.write_bytes(whole[: (whole.index(b"movi") + whole.index(b"idx1")) // 2])
    pictures = all_of(opened_video(half))
    assert 0 < len(pictures) < COUNT
    for before, after in zip(all_of(opened_video()), pictures[:-1], strict=False):
        np.testing.assert_array_equal(before.color, after.color)


def test_a_missing_video_is_an_error_when_it_is_opened(camera, tmp_path):
    with pytest.raises(SourceError, match=r"video:none.mp4: found no file .*none.mp4"):
        open_video("video:none.mp4", "none.mp4", tmp_path)


def test_a_looped_camera_is_an_error():
    with pytest.raises(SourceError, match="found the option 'loop'; expected height and fov"):
        open_camera("camera:0?loop", "0?loop")


@pytest.mark.parametrize("module", ["cv2", "mediapipe.python.solutions.pose"])
def test_a_missing_library_is_an_error_with_the_package(monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(SourceError, match=r"pip install 'puppetline\[camera\]'"):
        open_camera("camera:0", "0")


linux = pytest.mark.skipif(sys.platform != "linux", reason="devices are files on Linux")


@linux
def test_the_source_raises_the_error_of_its_camera(camera):
    source = open_camera("camera:98", "98")
    assert select([source.fileno()], [], [], 10)[0]
    with pytest.raises(SourceError, match=r"camera:98: found no /dev/video98; expected an existing camera \("):
        source.receive()
    source.close()


@linux
def test_missing_permission_is_an_error_with_the_devices_group(camera, tmp_path, monkeypatch):
    device = tmp_path / "video0"
    device.touch()
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # tests may run as root
    with pytest.raises(SourceError, match=f"its group {device.group()} has.*usermod -aG {device.group()} .*uaccess"):
        Camera("camera:here", Options(str(device)))


@linux
def test_a_device_that_is_not_a_camera_is_an_error(camera):
    with pytest.raises(SourceError, match=r"found a device that cannot be opened as a camera \(/dev/null\)"):
        Camera("camera:/dev/null", Options("/dev/null"))


@linux
def test_a_camera_that_stops_is_an_error(video_file, monkeypatch):
    """A video stands in for the camera: at its end, it behaves like an unplugged camera."""
    cv2 = load_opencv()
    monkeypatch.setattr(cv2, "CAP_V4L2", cv2.CAP_FFMPEG)
    device = Camera("camera:clip", Options(str(video_file)))
    times = [device.read(1.0).time for _ in range(COUNT)]
    assert times == sorted(times)
    with pytest.raises(SourceError, match=r"camera:clip: found no image from camera .*clip.avi"):
        device.read(1.0)
    device.close()
    device.close()
