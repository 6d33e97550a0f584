"""Somebody in a video moves a character: the commands as a user runs them, with the real tracker."""

import json

import numpy as np
import pytest

from capture.body import height
from capture.formats import read_log

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("camera")]

PICTURES = 65


@pytest.fixture
def squats(real_data):
    return real_data / "video" / "tfjs" / "pose_squats.mp4"


def test_a_video_is_recorded_whole(squats, tmp_path, commands):
    take = tmp_path / "squats.log"
    result = commands.run("record", "--source", f"video:{squats}?height=1.65", "-o", take, "--json")
    summary = json.loads(result.stdout)
    assert result.stderr == "", "MediaPipe says a lot"
    assert summary["frames"] == PICTURES
    assert summary["users"] == [1]
    [clip] = read_log(take)
    np.testing.assert_allclose(np.diff(clip.times), 0.2, atol=1e-6)
    assert [height(pose) for pose in clip.positions] == pytest.approx([1.65] * PICTURES, abs=1e-3)


def test_a_video_is_converted_like_a_take_of_it(squats, tmp_path, commands):
    take, paths = tmp_path / "take.log", [tmp_path / "of_video.bvh", tmp_path / "of_take.bvh"]
    commands.run("record", "--source", f"video:{squats}", "-o", take)
    for recording, path in zip((squats, take), paths, strict=True):
        assert commands.run("convert", recording, "-o", path).stderr == ""
    one, other = (read_log(path)[0].positions for path in paths)
    np.testing.assert_allclose(one, other, atol=1e-4)


def test_a_broken_video_is_one_line_and_exit_code_1(tmp_path, commands):
    """FFmpeg and OpenCV would say something, too."""
    (tmp_path / "cut.mp4").write_bytes(b"\0\0\0\x20ftypisom" + bytes(100))
    result = commands.run("look", "--source", f"video:{tmp_path}/cut.mp4", "-o", tmp_path / "look.png")
    [line] = result.stderr.splitlines()
    assert "found no image in" in line
    assert result.returncode == 1
    assert result.stdout == ""
