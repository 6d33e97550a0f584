import numpy as np
import pytest

from engine_bridge.rigging.joints import joints_of
from solver.motion.limbs import Limb


def limb(name, *points, parent="trunk"):
    own = None if name == "trunk" else parent
    return Limb(name, np.array(points, dtype=np.float64), ((0,),) * len(points), parent=own)


TRUNK = limb("trunk", (0, 1, 0), (0, 1.2, 0), (0, 1.5, 0))
HUMANOID = (
    TRUNK,
    limb("head", (0, 1.5, 0), (0, 1.9, 0)),
    limb("left arm", (0.2, 1.5, 0), (0.5, 1.5, 0), (0.8, 1.5, 0), (0.9, 1.5, 0)),
    limb("right leg", (-0.1, 1, 0), (-0.1, 0.5, 0), (-0.1, 0.1, 0), (-0.1, 0, 0.2)),
)


def described(joints):
    """Name, parent and bone of each joint."""
    return [(joint.name, joints[joint.parent].name if joint.parent >= 0 else None, joint.bone) for joint in joints]


def test_a_humanoid_has_the_joints_and_the_hierarchy_of_vrm():
    assert described(joints_of(HUMANOID)) == [
        ("hips", None, 0),
        ("spine", "hips", 1),
        ("chest", "spine", 1),
        ("neck", "chest", 2),
        ("head", "neck", 2),
        ("leftShoulder", "chest", 1),
        ("leftUpperArm", "leftShoulder", 3),
        ("leftLowerArm", "leftUpperArm", 4),
        ("leftHand", "leftLowerArm", 5),
        ("rightUpperLeg", "hips", 6),
        ("rightLowerLeg", "rightUpperLeg", 7),
        ("rightFoot", "rightLowerLeg", 8),
        ("rightToes", "rightFoot", 8),
    ]


def test_further_joints_are_along_the_last_bone_and_each_ends_where_the_next_begins():
    places = {joint.name: (joint.head.tolist(), joint.tail.tolist()) for joint in joints_of(HUMANOID)}
    assert places["spine"] == (pytest.approx([0, 1.2, 0]), pytest.approx([0, 1.35, 0]))
    assert places["chest"] == (pytest.approx([0, 1.35, 0]), pytest.approx([0, 1.5, 0]))
    assert places["head"] == (pytest.approx([0, 1.7, 0]), pytest.approx([0, 1.9, 0]))
    assert places["leftShoulder"] == (pytest.approx([0.05, 1.5, 0]), pytest.approx([0.2, 1.5, 0]))
    assert places["rightToes"] == (pytest.approx([-0.1, 0.04, 0.12]), pytest.approx([-0.1, 0, 0.2]))


def test_a_trunk_with_room_has_an_upper_chest_and_more_bones_have_numbers():
    heights = [(0, 1 + 0.1 * step, 0) for step in range(6)]
    names = [joint.name for joint in joints_of([limb("trunk", *heights)])]
    assert names == ["hips", "spine", "chest", "upperChest", "upperChest_2"]


def test_an_arm_without_a_hand_has_one_at_its_tip():
    joints = joints_of([TRUNK, limb("left arm", (0.2, 1.5, 0), (0.5, 1.5, 0), (0.9, 1.5, 0))])
    hand = joints[-1]
    assert (hand.name, hand.bone, hand.head.tolist(), hand.tail.tolist()) == (
        "leftHand",
        3,
        [0.9, 1.5, 0],
        [0.9, 1.5, 0],
    )


def test_other_limbs_have_numbered_joints_with_their_side_last():
    tail = limb("tail", (0, 1, -0.1), (0, 1, -0.5), (0, 1, -0.9))
    wing = limb("left wing", (0.1, 1.4, 0), (1, 1.6, 0))
    assert described(joints_of([TRUNK, tail, wing]))[3:] == [
        ("tail_1", "hips", 2),
        ("tail_2", "tail_1", 3),
        ("wing_left_1", "chest", 4),
    ]


def test_limbs_without_a_common_parent_hang_on_a_root_that_does_not_move():
    apart = [limb("left horn", (0, 0, 0), (1, 0, 0), parent=None), limb("body", (0, 0, 0), (0, 1, 0), parent=None)]
    assert described(joints_of(apart)) == [("root", None, -1), ("horn_left_1", "root", 0), ("body_1", "root", 1)]


def test_a_handle_is_a_joint_on_the_nearest_joint():
    handles = [("left ear", np.array([0.1, 1.9, 0.0])), ("head", np.array([0.0, 1.3, 0.2]))]
    joints = joints_of(HUMANOID, handles)
    assert described(joints)[-2:] == [("ear_left", "head", 9), ("head_2", "spine", 10)]
    np.testing.assert_array_equal(joints[-2].head, joints[-2].tail)


@pytest.mark.parametrize(
    ("count", "expected"), [(1, [("a0", None, 0)]), (2, [("root", None, -1), ("a0", "root", 0), ("a1", "root", 1)])]
)
def test_handles_alone_hang_on_a_root_if_there_are_several(count, expected):
    assert described(joints_of([], [(f"a{k}", np.zeros(3)) for k in range(count)])) == expected
