import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.rigging.joints import joints_of

from ..bones import limb, points

TRUNK = limb("trunk", "0 1 0, 0 1.2 0, 0 1.5 0")
HUMANOID = (
    TRUNK,
    limb("head", "0 1.5 0, 0 1.9 0"),
    limb("left arm", "0.2 1.5 0, 0.5 1.5 0, 0.8 1.5 0, 0.9 1.5 0"),
    limb("right leg", "-0.1 1 0, -0.1 0.5 0, -0.1 0.1 0, -0.1 0 0.2"),
)


def described(joints):
    """Name, parent and bone of each joint."""
    return [f"{each.name} {joints[each.parent].name if each.parent >= 0 else '-'} {each.bone}" for each in joints]


HIERARCHY = """
hips - 0
spine hips 1
chest spine 1
neck chest 2
head neck 2
leftShoulder chest 1
leftUpperArm leftShoulder 3
leftLowerArm leftUpperArm 4
leftHand leftLowerArm 5
rightUpperLeg hips 6
rightLowerLeg rightUpperLeg 7
rightFoot rightLowerLeg 8
rightToes rightFoot 8
"""
"""Name, parent and bone of each joint."""


def test_a_humanoid_has_the_joints_and_the_hierarchy_of_vrm():
    assert described(joints_of(HUMANOID)) == HIERARCHY.strip().splitlines()


@pytest.mark.parametrize(
    ("limbs", "handles", "expected"),
    [
        ([limb("trunk", "0 1 0, 0 1.1 0, 0 1.2 0, 0 1.3 0, 0 1.4 0, 0 1.5 0")], "",
         "hips - 0, spine hips 1, chest spine 2, upperChest chest 3, upperChest_2 upperChest 4"),
        ([TRUNK, limb("tail", "0 1 0, 0 1 -0.5, 0 1 -0.9"), limb("left wing", "0 1.4 0, 1 1.6 0")], "",
         "hips - 0, spine hips 1, chest spine 1, tail_1 hips 2, tail_2 tail_1 3, wing_left_1 chest 4"),
        ([limb("left horn", "0 0 0, 1 0 0", parent=None), limb("body", "0 0 0, 0 1 0", parent=None)], "",
         "root - -1, horn_left_1 root 0, body_1 root 1"),
        ([], "a", "a - 0"),
        ([], "ab", "root - -1, a root 0, b root 1"),
    ],
    ids=["a trunk with room", "other limbs", "limbs without a parent", "a handle", "handles"],
)  # fmt: skip
def test_other_joints_have_numbers_and_hang_on_the_nearest_limb_or_on_a_root(limbs, handles, expected):
    assert described(joints_of(limbs, [(name, np.zeros(3)) for name in handles])) == expected.split(", ")


def test_further_joints_are_along_the_last_bone_and_each_ends_where_the_next_begins():
    handless = limb("right arm", "-0.2 1.5 0, -0.5 1.5 0, -0.9 1.5 0")
    joints = joints_of([*HUMANOID, handless])
    places = {joint.name: np.array([joint.head, joint.tail]) for joint in joints}
    for name, ends in {
        "spine": "0 1.2 0, 0 1.35 0",
        "chest": "0 1.35 0, 0 1.5 0",
        "head": "0 1.7 0, 0 1.9 0",
        "leftShoulder": "0.05 1.5 0, 0.2 1.5 0",
        "rightToes": "-0.1 0.04 0.12, -0.1 0 0.2",
        "rightHand": "-0.9 1.5 0, -0.9 1.5 0",
    }.items():
        assert_allclose(places[name], points(ends), atol=1e-12)


def test_a_handle_is_a_joint_on_the_nearest_joint():
    handles = [("left ear", np.array([0.1, 1.9, 0.0])), ("head", np.array([0.0, 1.3, 0.2]))]
    joints = joints_of(HUMANOID, handles)
    assert described(joints)[-2:] == ["ear_left head 9", "head_2 spine 10"]
    assert_array_equal(joints[-2].head, joints[-2].tail)
