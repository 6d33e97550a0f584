import math

import numpy as np
import pytest

from capture.body import bone_lengths, typical_bone_length
from capture.network.humanoid import DRIVING_BONES, IDENTITY, JOINTS, joint_positions
from capture.skeleton import JOINT_INDEX, PARENTS

HIPS = ((0.0, 1.0, 0.0), IDENTITY)


def _pose(turns):
    pose = np.empty((20, 3))
    pose[[JOINT_INDEX[name] for name in JOINTS]] = joint_positions(HIPS, turns)
    return pose


AT_REST = _pose({})


def test_at_rest_every_bone_has_its_typical_length_and_both_sides_are_alike():
    for joint, length in bone_lengths(AT_REST).items():
        assert length == pytest.approx(typical_bone_length(joint), abs=1e-12), joint
    for joint in PARENTS:
        if joint.endswith("_left"):
            left, right = (AT_REST[JOINT_INDEX[name]] for name in (joint, joint.replace("left", "right")))
            assert left.tolist() == (right * [-1, 1, 1]).tolist()
            assert left[0] < 0
    assert AT_REST[JOINT_INDEX["foot_left"], 2] > 0.05
    assert set(AT_REST[:, 2]) == {0.0, AT_REST[JOINT_INDEX["foot_left"], 2]}


def test_each_joint_is_moved_by_a_bone_that_every_humanoid_has():
    limbs = ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")
    required = {"Hips", "Spine", "Head"} | {f"{side}{bone}" for side in ("Left", "Right") for bone in limbs}
    assert set(DRIVING_BONES) == set(JOINT_INDEX)
    assert set(DRIVING_BONES.values()) == required
    for joint, bone in DRIVING_BONES.items():
        if bone != "Hips":
            turned = _pose({bone: (math.sqrt(0.5), 0.0, 0.5, 0.5)})
            assert math.dist(AT_REST[JOINT_INDEX[joint]], turned[JOINT_INDEX[joint]]) > 0.01, joint
