"""Films that the tests write, decoded by the real OpenCV; what is wrong with a camera before and after it opens."""

import math
import os
import sys
from contextlib import suppress
from functools import partial
from select import select

import numpy as np
import pytest

from capture.sensors.camera import Camera, Options, Video, open_camera, open_video, opencv, parse
from puppetline.errors import SourceError

RATE, COUNT, WIDTH, HEIGHT = 20, 8, 160, 120


@pytest.fixture(scope="module")
def film(camera, tmp_path_factory):
    """A film of 8 pictures, the k-th of red, green and blue 30k, 200 and 10."""
    cv2 = opencv()
    path = tmp_path_factory.mktemp("film") / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), RATE, (WIDTH, HEIGHT))
    assert writer.isOpened()
    for k in range(COUNT):
        writer.write(np.full((HEIGHT, WIDTH, 3), (10, 200, 30 * k), np.uint8))
    writer.release()
    return path


@pytest.fixture
def opened(film):
    videos = []

    def open_it(path=film, **options):
        videos.append(Video("video:film", path, Options(str(path), **options)))
        return videos[-1]

    yield open_it
    for video in videos:
        video.close()
        video.close()


def all_of(video):
    """Return the pictures until the end."""
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
        ("a film.mp4?loop", Options("a film.mp4", loop=True)),
        ("film.mp4?height=1.5&loop&fov=60", Options("film.mp4", height=1.5, fov=60.0, loop=True)),
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
def test_options_that_are_none_are_told(rest, message):
    with pytest.raises(SourceError, match=f"camera:.*{message}"):
        parse("camera:" + rest, rest)


def test_pictures_come_with_the_times_and_colours_of_the_film(opened):
    pictures = all_of(opened())
    np.testing.assert_allclose([picture.time for picture in pictures], np.arange(COUNT) / RATE, atol=1e-9)
    for k, picture in enumerate(pictures):
        assert picture.color.shape == (HEIGHT, WIDTH, 3)
        assert picture.depth is None
        np.testing.assert_allclose(picture.color.mean(axis=(0, 1)), (30 * k, 200, 10), atol=4)


def test_the_end_of_a_film_is_told(opened):
    video = opened()
    all_of(video)
    with pytest.raises(SourceError, match=r"found the end of the video; expected more of it. Put \?loop"):
        video.read(1.0)


def test_the_corners_of_the_picture_are_as_far_apart_as_the_field_of_view(opened):
    lens = opened(fov=80.0).read(1.0).lens
    left, right = lens.unproject(np.array([[0, 0], [WIDTH, HEIGHT]]), np.ones(2))
    cosine = left @ right / np.linalg.norm(left) / np.linalg.norm(right)
    assert math.degrees(math.acos(cosine)) == pytest.approx(80)


def test_a_looped_film_goes_on_in_time(opened):
    video = opened(loop=True)
    pictures = [video.read(1.0) for _ in range(3 * COUNT)]
    np.testing.assert_allclose([picture.time for picture in pictures], np.arange(3 * COUNT) / RATE, atol=1e-9)
    np.testing.assert_array_equal(pictures[3].color, pictures[3 + 2 * COUNT].color)


@pytest.mark.parametrize("content", [b"", b"no film at all" * 100, b"RIFF\xff\xff\xff\xffAVI LIST"])
def test_what_is_no_film_is_told(opened, tmp_path, content):
    broken = tmp_path / "broken.avi"
    broken.write_bytes(content)
    with pytest.raises(SourceError, match=f"video:film: found no picture in .*broken.avi, {len(content)} bytes"):
        opened(broken)


def test_a_film_that_was_cut_off_plays_as_far_as_it_goes(opened, film, tmp_path):
    half = tmp_path / "half.avi"
    whole = film.read_bytes()
    half.write_bytes(whole[: (whole.index(b"movi") + whole.index(b"idx1")) // 2])
    pictures = all_of(opened(half))
    assert 0 < len(pictures) < COUNT
    for before, after in zip(all_of(opened()), pictures[:-1], strict=False):
        np.testing.assert_array_equal(before.color, after.color)


def test_a_film_that_is_not_there_is_told_when_it_is_opened(camera, tmp_path):
    with pytest.raises(SourceError, match=r"video:none.mp4: found no file .*none.mp4"):
        open_video("video:none.mp4", "none.mp4", tmp_path)


def test_a_looped_camera_is_told():
    with pytest.raises(SourceError, match="found the option 'loop'; expected height and fov"):
        open_camera("camera:0?loop", "0?loop")


@pytest.mark.parametrize(
    ("module", "open_it"),
    [
        ("cv2", partial(open_camera, "camera:0", "0")),
        ("mediapipe.python.solutions", partial(open_camera, "camera:0", "0")),
    ],
)
def test_without_a_library_it_is_said_how_to_install_it(monkeypatch, module, open_it):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(SourceError, match=r"pip install 'puppetline\[camera\]'"):
        open_it()


linux = pytest.mark.skipif(sys.platform != "linux", reason="devices are files on Linux")


@linux
def test_a_camera_that_is_not_there_is_told(camera):
    with pytest.raises(SourceError, match="camera:98: found no /dev/video98; expected a camera that is there: "):
        Camera("camera:98", parse("camera:98", "98"))


@linux
def test_a_source_tells_what_is_wrong_with_its_camera_and_closes(camera):
    source = open_camera("camera:98", "98")
    assert select([source.fileno()], [], [], 10)[0]
    with pytest.raises(SourceError, match="camera:98: found no /dev/video98"):
        source.receive()
    source.close()


@linux
def test_a_camera_that_this_user_may_not_use_names_the_group_that_may(camera, tmp_path, monkeypatch):
    device = tmp_path / "video0"
    device.touch()
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # tests may run as root, who may everything
    with pytest.raises(SourceError, match=f"its group {device.group()} has.*usermod -aG {device.group()} .*uaccess"):
        Camera("camera:here", Options(str(device)))


@linux
def test_a_device_that_is_no_camera_is_told(camera):
    with pytest.raises(SourceError, match=r"found a device that cannot be opened as a camera \(/dev/null\)"):
        Camera("camera:/dev/null", Options("/dev/null"))


@linux
def test_a_camera_that_stops_is_told(film, monkeypatch):
    """A film stands in for the camera, as no machine of tests has one: it ends as a camera does that is pulled out."""
    cv2 = opencv()
    monkeypatch.setattr(cv2, "CAP_V4L2", cv2.CAP_FFMPEG)
    device = Camera("camera:film", Options(str(film)))
    times = [device.read(1.0).time for _ in range(COUNT)]
    assert times == sorted(times)
    with pytest.raises(SourceError, match=r"camera:film: found no image from camera .*film.avi"):
        device.read(1.0)
    device.close()
    device.close()
