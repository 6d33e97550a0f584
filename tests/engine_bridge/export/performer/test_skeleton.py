import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.skeleton import JOINT_INDEX, LIMBS, PARENTS
from engine_bridge.export.performer.skeleton import skeleton_of

from .conftest import timeline_of


def length(pose, joint):
    return np.linalg.norm(pose[JOINT_INDEX[joint]] - pose[JOINT_INDEX[PARENTS[joint]]])


def test_lengths_are_the_medians_of_both_sides(motion):
    poses = np.tile(motion.body.pose, (31, 1, 1))
    poses[::2, JOINT_INDEX["wrist_left"], 0] += 0.1  # more than half of the frames
    poses[:14, JOINT_INDEX["head"], 1] += 0.5  # less than half
    found = skeleton_of(timeline_of(poses)).pose
    expected = length(motion.body.pose, "wrist_left") + 0.05
    assert length(found, "wrist_left") == length(found, "wrist_right") == pytest.approx(expected)
    assert length(found, "head") == pytest.approx(length(motion.body.pose, "head"))


def test_unknown_legs_are_those_of_a_typical_body_of_the_same_size(motion):
    poses = np.tile(motion.body.pose, (30, 1, 1))
    legs = [JOINT_INDEX[joint] for limb in ("left leg", "right leg") for joint in LIMBS[limb]]
    poses[:, legs] = np.nan
    found = skeleton_of(timeline_of(poses))
    assert np.isfinite(found.pose).all()
    assert 0.6 < found.pose[JOINT_INDEX["hip_center"], 1] < 1.2
    assert_allclose(length(found.pose, "elbow_left"), length(motion.body.pose, "elbow_left"))
