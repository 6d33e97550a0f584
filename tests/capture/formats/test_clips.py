import numpy as np
import pytest

from capture.formats._clips import clip_of, frame_rate
from capture.formats.options import ReadOptions
from puppetline.errors import SkeletonLogError


def _frames(count):
    positions = np.arange(1.0, count * 60 + 1).reshape(count, 20, 3)
    return positions, np.ones((count, 20), dtype=np.float32)


def test_frames_in_order_pass_unchanged():
    positions, confidence = _frames(3)
    clip = clip_of("log", "test", np.array([5.0, 5.5, 9.0]), positions, confidence, ("A note.",))
    assert (clip.format, clip.user, clip.notes) == ("test", 0, ("A note.",))
    assert clip.times.tolist() == [5.0, 5.5, 9.0]
    assert np.array_equal(clip.positions, positions)
    assert np.array_equal(clip.confidence, confidence)


def test_the_first_of_repeated_times_is_kept_and_steps_back_are_left_out_with_a_note():
    positions, confidence = _frames(6)
    clip = clip_of("log", "test", np.array([1.0, 1.0, 2.0, 1.5, 2.0, 3.0]), positions, confidence)
    assert clip.times.tolist() == [1.0, 2.0, 3.0]
    assert np.array_equal(clip.positions, positions[[0, 2, 5]])
    assert clip.notes == ("3 of 6 frames repeat or precede the time of an earlier one: left out.",)


def test_a_joint_at_the_sensor_or_without_confidence_is_lost():
    positions, confidence = _frames(1)
    positions[0, 4] = 0.0
    confidence[0, 7] = 0.0
    clip = clip_of("log", "test", np.array([0.0]), positions, confidence)
    assert np.flatnonzero(clip.confidence[0] == 0).tolist() == [4, 7]
    assert np.flatnonzero(np.isnan(clip.positions[0]).all(axis=1)).tolist() == [4, 7]


def test_a_joint_with_one_coordinate_0_is_not_lost():
    positions, confidence = _frames(1)
    positions[0, 4, 0] = 0.0
    assert clip_of("log", "test", np.array([0.0]), positions, confidence).confidence[0, 4] == 1.0


@pytest.mark.parametrize("count", [0, 2])
def test_a_log_without_a_tracked_frame_is_refused(count):
    positions, confidence = _frames(count)
    with pytest.raises(SkeletonLogError) as caught:
        clip_of("log.txt", "test", np.arange(float(count)), positions * 0, confidence)
    assert caught.value.where == "log.txt"
    assert caught.value.found == f"no tracked performer in any of {count} frames"
    assert caught.value.expected == "at least one tracked frame"


def test_a_frame_rate_is_noted_where_it_is_assumed():
    assert frame_rate(ReadOptions(), 15.0) == (15.0, ("The log has no clock: 15 frames a second assumed.",))
    assert frame_rate(ReadOptions(fps=24.0), 15.0) == (24.0, ())
