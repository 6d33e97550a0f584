import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture.rest_frames import in_place, resting_frames

from .bodies import STANDS, body, both, table

WAYS = table("""
spine           0 0.07 0
shoulder_center 0 0.34 0
head            0 0.2 0
shoulder        0.2 0 0
elbow           0.26 0 0
wrist           0.25 0 0
hand            0.08 0 0
hip             0.1 0 0
knee            0 -0.48 0
ankle           0 -0.38 0
foot            0 -0.03 -0.09
""")
T_POSE = body(WAYS, (0, 0, 0))
PERFORMER = STANDS + np.array([3, 1, 0])
ANKLES = both("ankle")


def moving(count):
    """Return a body that walks along x."""
    return PERFORMER + np.arange(count)[:, None, None] * [0.03, 0, 0]


def found(positions):
    return resting_frames(np.arange(len(positions)) / 30, positions, np.ones(positions.shape[:2], np.float32))


@pytest.mark.parametrize("axes", Rotation.random(4, random_state=1).as_matrix())
@pytest.mark.parametrize("count", [1, 5])
def test_a_rest_pose_elsewhere_before_the_motion_is_found_in_any_axes(axes, count):
    frames = np.concatenate([np.repeat(T_POSE[None], count, axis=0), moving(20)])
    assert found(frames @ axes.T) == count


def test_motion_that_begins_in_a_rest_pose_and_jumps_between_other_poses_are_kept():
    assert found(T_POSE + np.arange(20)[:, None, None] * [0.03, 0, 0]) == 0
    assert found(np.concatenate([moving(10) - [3, 0, 0], moving(10)])) == 0


def test_a_rest_pose_is_put_where_the_motion_begins():
    frames = moving(10) @ Rotation.from_rotvec([0, 1.1, 0]).as_matrix().T
    rest = in_place(T_POSE, frames)
    across = [np.diff(pose[both("hip")], axis=0)[0, [0, 2]] for pose in (rest, frames[0])]
    assert_allclose(*(each / np.linalg.norm(each) for each in across), atol=1e-12)
    assert_allclose(rest[0, [0, 2]], frames[0, 0, [0, 2]], atol=1e-12)
    assert rest[ANKLES, 1].min() == pytest.approx(np.median(frames[:, ANKLES, 1].min(axis=1)))
    lengths = [np.linalg.norm(pose[:, None] - pose[None], axis=2) for pose in (rest, T_POSE)]
    assert_allclose(*lengths, atol=1e-12)
