from pathlib import Path

import numpy as np
import pytest

from capture.formats._clips import build_clip, clips_by_performer, frame_rate
from capture.formats.options import ReadOptions
from capture.skeleton import SkeletonFrame
from puppetline.errors import SkeletonLogError


def _frames(count):
    positions = np.arange(1.0, count * 60 + 1).reshape(count, 20, 3)
    return positions, np.ones((count, 20), dtype=np.float32)


def test_frames_in_order_pass_unchanged():
    positions, confidence = _frames(3)
    clip = build_clip("log", "test", np.array([5.0, 5.5, 9.0]), positions, confidence, ("A note.",))
    assert (clip.format, clip.user, clip.notes) == ("test", 0, ("A note.",))
    assert clip.times.tolist() == [5.0, 5.5, 9.0]
    assert np.array_equal(clip.positions, positions)
    assert np.array_equal(clip.confidence, confidence)


def test_repeated_and_decreasing_times_are_skipped_with_a_note():
    positions, confidence = _frames(6)
    clip = build_clip("log", "test", np.array([1.0, 1.0, 2.0, 1.5, 2.0, 3.0]), positions, confidence)
    assert clip.times.tolist() == [1.0, 2.0, 3.0]
    assert np.array_equal(clip.positions, positions[[0, 2, 5]])
    assert clip.notes == ("Skipped 3 of 6 frames that repeat or precede an earlier time.",)


def test_a_joint_at_the_sensor_or_without_confidence_is_lost():
    positions, confidence = _frames(1)
    positions[0, 4] = 0.0
    confidence[0, 7] = 0.0
    clip = build_clip("log", "test", np.array([0.0]), positions, confidence)
    assert np.flatnonzero(clip.confidence[0] == 0).tolist() == [4, 7]
    assert np.flatnonzero(np.isnan(clip.positions[0]).all(axis=1)).tolist() == [4, 7]


def test_a_joint_with_one_coordinate_0_is_not_lost():
    positions, confidence = _frames(1)
    positions[0, 4, 0] = 0.0
    assert build_clip("log", "test", np.array([0.0]), positions, confidence).confidence[0, 4] == 1.0


@pytest.mark.parametrize("count", [0, 2])
def test_a_log_without_a_tracked_frame_is_refused(count):
    positions, confidence = _frames(count)
    with pytest.raises(SkeletonLogError) as caught:
        build_clip("log.txt", "test", np.arange(float(count)), positions * 0, confidence)
    assert caught.value.where == "log.txt"
    assert caught.value.found == f"no tracked performer in any of {count} frames"
    assert caught.value.expected == "at least one tracked frame"


def test_an_assumed_frame_rate_is_noted():
    assert frame_rate(ReadOptions(), 15.0) == (15.0, ("The recording has no clock; 15 frames per second are assumed.",))
    assert frame_rate(ReadOptions(fps=24.0), 15.0) == (24.0, ())


def frame(time: float, user: int, confidence: float = 1) -> SkeletonFrame:
    return SkeletonFrame(time, user, np.full((20, 3), float(user)), np.full(20, confidence, np.float32))


def test_bodies_are_sorted_by_performer_in_order_of_appearance() -> None:
    frames = [frame(0, 9), frame(0.1, 4), frame(0.1, 9), frame(0.5, 4)]
    nine, four = clips_by_performer(Path("take.log"), "some", frames, ("A note.",))
    assert (nine.user, four.user) == (9, 4)
    assert (nine.times.tolist(), four.times.tolist()) == ([0, 0.1], [0.1, 0.5])
    assert (nine.positions == 9).all()
    assert (four.positions == 4).all()
    assert nine.format == four.format == "some"
    assert nine.notes == four.notes == ("A note.",)


def test_a_body_twice_in_a_frame_counts_once() -> None:
    (clip,) = clips_by_performer(Path("take.log"), "some", [frame(0, 1), frame(0, 1), frame(1, 1)])
    assert clip.times.tolist() == [0, 1]
    assert "1 of 3 frames" in clip.notes[0]


def test_bodies_that_are_never_tracked_are_skipped() -> None:
    (clip,) = clips_by_performer(Path("take.log"), "some", [frame(0, 1, 0), frame(0, 2), frame(1, 2, 0)])
    assert clip.user == 2
    assert clip.tracked_frames == 1
    assert np.isnan(clip.positions[1]).all()


@pytest.mark.parametrize("frames", [[], [frame(0, 1, 0)]])
def test_no_tracked_body_at_all_is_an_error(frames: list[SkeletonFrame]) -> None:
    with pytest.raises(SkeletonLogError, match="no frame with a tracked performer"):
        clips_by_performer(Path("take.log"), "some", frames)
