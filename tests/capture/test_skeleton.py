import numpy as np
import pytest
from numpy.testing import assert_array_equal

from capture.skeleton import JOINT_INDEX, JOINTS, OPPOSITE, PARENTS, mirrored, to_character_axes

KINECT_SDK = """
hip_center spine shoulder_center head
shoulder_left elbow_left wrist_left hand_left shoulder_right elbow_right wrist_right hand_right
hip_left knee_left ankle_left foot_left hip_right knee_right ankle_right foot_right
"""


def test_joints_are_in_the_order_of_the_kinect_sdk_each_after_its_parent_and_both_sides_are_alike():
    assert tuple(KINECT_SDK.split()) == JOINTS
    assert list(JOINT_INDEX.values()) == list(range(20))
    assert set(PARENTS) == set(JOINTS) - {"hip_center"}
    assert [PARENTS[f"{joint}_left"] for joint in ("shoulder", "hip")] == ["shoulder_center", "hip_center"]
    for joint, parent in PARENTS.items():
        assert JOINT_INDEX[parent] < JOINT_INDEX[joint]
        assert PARENTS[JOINTS[OPPOSITE[JOINT_INDEX[joint]]]] == JOINTS[OPPOSITE[JOINT_INDEX[parent]]]
    assert_array_equal(OPPOSITE[OPPOSITE], np.arange(20))
    assert np.flatnonzero(np.arange(20) == OPPOSITE).tolist() == [0, 1, 2, 3]


def test_a_mirrored_right_hand_is_a_left_hand_on_the_other_side():
    pose = np.full((20, 3), np.nan)
    pose[JOINT_INDEX["hand_right"]] = [0.6, 1.1, 2.0]
    expected = np.full((20, 3), np.nan)
    expected[JOINT_INDEX["hand_left"]] = [-0.6, 1.1, 2.0]
    assert_array_equal(mirrored(pose), expected)


def test_character_axes_are_a_turn_with_the_performers_right_at_minus_x():
    assert_array_equal(to_character_axes(np.array([0.6, 1.1, 2.0])), [-0.6, 1.1, -2.0])
    assert np.linalg.det(to_character_axes(np.eye(3))) == pytest.approx(1.0)
