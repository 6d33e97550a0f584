import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.performance.clip import load_timeline, poses, solve
from engine_bridge.performance.motion import Motion
from engine_bridge.performance.pose import TargetPose
from engine_bridge.performance.settings import Settings

FIELDS = "R", "targets", "bones", "root", "controls"


@pytest.fixture(scope="module")
def timeline(take):
    return load_timeline(take, Settings())[0]


@pytest.fixture(scope="module")
def motion(limbed_figure, timeline):
    return solve(limbed_figure, timeline, Settings())


def test_a_solved_motion_keeps_its_poses_and_shows_them_at_their_times(motion, limbed_figure, timeline):
    assert_array_equal(motion.times, timeline.times)
    for number, pose in enumerate(poses(limbed_figure, timeline, Settings())):
        shown = motion.at(number / motion.fps)
        for name in FIELDS:
            assert_allclose(getattr(motion[number], name), getattr(pose, name), atol=1e-5)
            assert_allclose(getattr(shown, name), getattr(motion[number], name), atol=1e-5)


def test_between_two_poses_bones_stay_rigid_and_the_rest_is_linear_and_the_ends_hold(motion):
    before, after, half = motion[20], motion[21], motion.at(20.5 / motion.fps)
    for name in ("R", "targets", "root"):
        assert_allclose(getattr(half, name), (getattr(before, name) + getattr(after, name)) / 2, atol=1e-6)
    turns = half.bones[:, :3]
    assert_allclose(turns @ turns.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turns.shape), atol=1e-6)
    for seconds, number in ((-1.0, 0), (1000.0, len(motion) - 1)):
        assert_allclose(motion.at(seconds).bones, motion[number].bones, atol=1e-6)


def test_a_loop_goes_from_its_last_pose_to_its_first_one(limbed_figure):
    bones = np.tile(np.eye(4, 3), (len(limbed_figure.model.bones), 1, 1))
    roots = np.array([[0.0, 0, 0], [1.0, 0, 0], [4.0, 0, 0]])
    loop = Motion(limbed_figure, 2.0, [TargetPose(np.zeros((0, 3)), bones, root) for root in roots], loops=True)
    assert_allclose([loop.at(t).root[0] for t in (0, 0.25, 1, 1.25, 1.5, 3.75)], [0, 0.5, 4, 2, 0, 2.5])
