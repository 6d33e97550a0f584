from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from capture.formats._clips import build_clip, clips_by_performer
from capture.skeleton import SkeletonFrame
from puppetline.errors import SkeletonLogError


def build(times, positions=None, confidence=None):
    """Return the positions that are given, and the clip of them."""
    count = len(times)
    positions = np.arange(1.0, count * 60 + 1).reshape(count, 20, 3) if positions is None else positions
    confidence = np.ones((count, 20), dtype=np.float32) if confidence is None else confidence
    return positions, build_clip("log.txt", "test", np.array(times, dtype=float), positions, confidence, ("A note.",))


def test_repeated_and_decreasing_times_are_skipped_with_a_note():
    positions, clip = build([5.0, 5.5, 9.0])
    assert (clip.format, clip.user, clip.notes) == ("test", 0, ("A note.",))
    assert_array_equal(clip.positions, positions)
    assert_array_equal(clip.confidence, np.ones((3, 20)))
    positions, clip = build([1.0, 1.0, 2.0, 1.5, 2.0, 3.0])
    assert clip.times.tolist() == [1.0, 2.0, 3.0]
    assert_array_equal(clip.positions, positions[[0, 2, 5]])
    assert "3 of 6 frames" in clip.notes[1]


def test_a_joint_at_the_sensor_or_without_confidence_is_lost():
    positions, confidence = np.ones((1, 20, 3)), np.ones((1, 20), dtype=np.float32)
    positions[0, 4] = 0.0
    positions[0, 5, 0] = 0.0  # of one coordinate alone, it is not lost
    confidence[0, 7] = 0.0
    _, clip = build([0.0], positions, confidence)
    assert np.flatnonzero(clip.confidence[0] == 0).tolist() == [4, 7]
    assert np.flatnonzero(np.isnan(clip.positions[0]).all(axis=1)).tolist() == [4, 7]


def frame(time, user, confidence=1):
    return SkeletonFrame(time, user, np.full((20, 3), float(user)), np.full(20, confidence, np.float32))


def test_bodies_are_sorted_by_performer_in_order_of_appearance_and_never_tracked_ones_skipped():
    frames = [frame(0, 1, 0), frame(0, 9), frame(0.1, 4), frame(0.1, 9), frame(0.1, 9), frame(0.5, 4, 0)]
    nine, four = clips_by_performer(Path("take.log"), "some", frames, ("A note.",))
    assert (nine.user, four.user) == (9, 4)
    assert (nine.times.tolist(), four.times.tolist()) == ([0, 0.1], [0.1, 0.5])
    assert (nine.positions == 9).all()
    assert (four.positions[0] == 4).all()
    assert np.isnan(four.positions[1]).all()
    assert nine.format == four.format == "some"
    assert (len(nine.notes), four.notes) == (2, ("A note.",))  # nine was twice in a frame


@pytest.mark.parametrize(
    "call",
    [
        lambda: build([]),
        lambda: build([0, 1], np.zeros((2, 20, 3))),
        lambda: clips_by_performer("log.txt", "some", []),
        lambda: clips_by_performer("log.txt", "some", [frame(0, 1, 0)]),
    ],
)
def test_a_log_without_a_tracked_frame_is_refused(call):
    with pytest.raises(SkeletonLogError) as caught:
        call()
    assert caught.value.where == "log.txt"
