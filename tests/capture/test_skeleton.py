import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX, JOINTS, OPPOSITE, PARENTS, mirrored, to_character_axes


@pytest.fixture
def poses():
    return np.random.default_rng(0).normal(size=(5, 20, 3))


KINECT_SDK = """
hip_center spine shoulder_center head
shoulder_left elbow_left wrist_left hand_left shoulder_right elbow_right wrist_right hand_right
hip_left knee_left ankle_left foot_left hip_right knee_right ankle_right foot_right
"""


def test_joints_are_in_the_order_of_the_kinect_sdk():
    assert tuple(KINECT_SDK.split()) == JOINTS
    assert [JOINTS[index] for index in JOINT_INDEX.values()] == list(JOINTS)


def test_limbs_begin_at_the_trunk():
    assert {PARENTS[joint] for joint in ("shoulder_left", "shoulder_right")} == {"shoulder_center"}
    assert {PARENTS[joint] for joint in ("hip_left", "hip_right")} == {"hip_center"}


def test_the_bones_are_a_tree_with_the_hips_as_root():
    assert set(PARENTS) == set(JOINTS) - {"hip_center"}
    for joint in JOINTS:
        way = [joint]
        while way[-1] != "hip_center":
            way.append(PARENTS[way[-1]])
            assert len(way) <= 20
    assert all(JOINT_INDEX[parent] < JOINT_INDEX[joint] for joint, parent in PARENTS.items())


def test_the_bones_of_both_sides_are_alike():
    for joint, parent in PARENTS.items():
        opposite = JOINTS[OPPOSITE[JOINT_INDEX[joint]]]
        assert PARENTS[opposite] == JOINTS[OPPOSITE[JOINT_INDEX[parent]]]


def test_opposite_swaps_left_and_right_and_keeps_the_middle():
    np.testing.assert_array_equal(OPPOSITE[OPPOSITE], np.arange(20))
    for index, joint in enumerate(JOINTS):
        swapped = JOINTS[OPPOSITE[index]]
        sides = joint.split("_")[-1], swapped.split("_")[-1]
        assert sides in {("left", "right"), ("right", "left")} or joint == swapped
    assert [joint for index, joint in enumerate(JOINTS) if OPPOSITE[index] == index] == list(JOINTS[:4])


def test_a_mirrored_right_hand_is_a_left_hand_on_the_other_side():
    pose = np.zeros((20, 3))
    pose[JOINT_INDEX["hand_right"]] = [0.6, 1.1, 2.0]
    found = mirrored(pose)
    np.testing.assert_array_equal(found[JOINT_INDEX["hand_left"]], [-0.6, 1.1, 2.0])
    np.testing.assert_array_equal(found[JOINT_INDEX["hand_right"]], 0.0)


def test_mirroring_twice_changes_nothing(poses):
    np.testing.assert_array_equal(mirrored(mirrored(poses)), poses)


def test_a_mirror_keeps_bone_lengths(poses):
    for joint, parent in PARENTS.items():
        j, p = JOINT_INDEX[joint], JOINT_INDEX[parent]
        there = mirrored(poses)
        np.testing.assert_allclose(
            np.linalg.norm(there[:, OPPOSITE[j]] - there[:, OPPOSITE[p]], axis=1),
            np.linalg.norm(poses[:, j] - poses[:, p], axis=1),
        )


def test_a_lost_joint_stays_lost_on_the_other_side(poses):
    poses[:, JOINT_INDEX["knee_left"]] = np.nan
    lost = np.isnan(mirrored(poses)).any(axis=2)
    assert lost[:, JOINT_INDEX["knee_right"]].all()
    assert lost.sum() == len(poses)


def test_the_performers_right_is_at_minus_x_of_a_character_that_faces_plus_z():
    np.testing.assert_array_equal(to_character_axes(np.array([0.6, 1.1, 2.0])), [-0.6, 1.1, -2.0])


def test_character_axes_are_a_turn_and_no_mirror(poses):
    matrix = to_character_axes(np.eye(3))
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    np.testing.assert_array_equal(to_character_axes(poses), poses @ matrix)
    np.testing.assert_array_equal(to_character_axes(to_character_axes(poses)), poses)
