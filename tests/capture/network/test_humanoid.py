import math

import numpy as np

from capture.network.humanoid import DRIVING_BONES, IDENTITY, JOINTS, joint_positions
from capture.skeleton import JOINT_INDEX

REQUIRED = {"Hips", "Spine", "Head"} | {
    f"{side}{bone}"
    for side in ("Left", "Right")
    for bone in ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")
}


def test_each_joint_is_moved_by_a_bone_that_every_humanoid_has():
    assert set(DRIVING_BONES) == set(JOINT_INDEX)
    assert set(DRIVING_BONES.values()) == REQUIRED
    hips = (0.0, 1.0, 0.0), IDENTITY
    for bone in REQUIRED - {"Hips"}:
        turns = {bone: (math.sqrt(0.5), 0.0, 0.5, 0.5)}
        moved = np.linalg.norm(np.subtract(joint_positions(hips, turns), joint_positions(hips, {})), axis=1)
        assert {joint for joint, by in DRIVING_BONES.items() if by == bone} <= set(np.array(list(JOINTS))[moved > 0.01])
