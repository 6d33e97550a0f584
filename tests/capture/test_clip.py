import dataclasses

import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.skeleton import INFERRED, LOST, TRACKED


def make(count=4, times=None, lost=(), **changes):
    positions = np.random.default_rng(0).normal(size=(count, 20, 3))
    confidence = np.full((count, 20), TRACKED, dtype=np.float32)
    for frame, joint in lost:
        positions[frame, joint], confidence[frame, joint] = np.nan, LOST
    arrays = {
        "times": np.arange(count) / 30 if times is None else times,
        "positions": positions,
        "confidence": confidence,
    }
    return SkeletonClip(format="test", user=1, **arrays | changes)


def test_a_clip_has_the_given_values():
    times = np.array([5.0, 5.1, 7.0])
    clip = make(3, times=times, notes=("a note",))
    np.testing.assert_array_equal(clip.times, times)
    assert (clip.format, clip.user, clip.notes) == ("test", 1, ("a note",))
    assert make().notes == ()


def test_a_clip_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        make().user = 2


def test_frames_with_no_joint_at_all_are_not_counted_as_tracked():
    everything = [(1, joint) for joint in range(20)]
    assert make(4, lost=everything).tracked_frames == 3
    assert make(4, lost=[*everything[:-1], (2, 5)]).tracked_frames == 4
    assert make(0).tracked_frames == 0


def test_inferred_joints_count_as_known():
    confidence = np.full((4, 20), INFERRED, dtype=np.float32)
    assert make(confidence=confidence).tracked_frames == 4


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"positions": np.zeros((3, 20, 3))}, r"positions \(3, 20, 3\).* for 4 frames"),
        ({"positions": np.zeros((4, 25, 3))}, r"positions \(4, 25, 3\)"),
        ({"confidence": np.ones((4, 19))}, r"confidence \(4, 19\)"),
        ({"times": np.array([0.0, 0.1, 0.1, 0.2])}, "increase strictly"),
        ({"times": np.array([0.0, 0.1, 0.05, 0.2])}, "increase strictly"),
    ],
)
def test_arrays_that_do_not_fit_each_other_are_refused(changes, says):
    with pytest.raises(ValueError, match=says):
        make(**changes)


def test_a_position_is_missing_exactly_if_confidence_is_zero():
    positions = np.zeros((4, 20, 3))
    positions[2, 3, 1] = np.nan
    with pytest.raises(ValueError, match="exactly if its position is NaN"):
        make(positions=positions)
    confidence = np.ones((4, 20), dtype=np.float32)
    confidence[0, 0] = LOST
    with pytest.raises(ValueError, match="exactly if its position is NaN"):
        make(confidence=confidence)
