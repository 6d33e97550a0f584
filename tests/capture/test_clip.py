import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.skeleton import INFERRED, LOST, TRACKED


def make(lost=(), **changes):
    positions, confidence = np.zeros((4, 20, 3)), np.full((4, 20), TRACKED, dtype=np.float32)
    confidence[3] = INFERRED
    for place in lost:
        positions[place], confidence[place] = np.nan, LOST
    given = {"times": np.arange(4) / 30, "positions": positions, "confidence": confidence}
    return SkeletonClip(format="test", user=1, **given | changes)


def test_frames_with_no_joint_at_all_are_not_counted_as_tracked():
    assert make(lost=[1]).tracked_frames == 3
    assert make(lost=[(1, slice(19)), (2, 5)]).tracked_frames == 4


@pytest.mark.parametrize(
    "changes",
    [
        {"positions": np.zeros((3, 20, 3))},
        {"positions": np.zeros((4, 25, 3))},
        {"confidence": np.ones((4, 19))},
        {"orientations": np.zeros((4, 20, 3))},
        {"times": np.array([0.0, 0.1, 0.1, 0.2])},
        {"positions": np.where(np.arange(3) == 1, np.nan, np.zeros((4, 20, 1)))},
        {"confidence": np.zeros((4, 20))},
    ],
)
def test_arrays_that_do_not_fit_each_other_are_refused(changes):
    with pytest.raises(ValueError, match=r"."):
        make(**changes)
