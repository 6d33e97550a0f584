import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture.body import bone_lengths, typical_bone_length
from capture.network.humanoid import (
    DRIVING_BONES,
    IDENTITY,
    JOINTS,
    SKELETON,
    joint_positions,
    quaternion_product,
    transformed,
)
from capture.skeleton import JOINT_INDEX, PARENTS

HIPS = ((0.0, 1.0, 0.0), IDENTITY)


def _pose(joints):
    pose = np.empty((20, 3))
    pose[[JOINT_INDEX[name] for name in JOINTS]] = joints
    return pose


def test_at_rest_every_bone_has_its_typical_length_and_both_sides_are_alike():
    pose = _pose(joint_positions(HIPS, {}))
    for joint, length in bone_lengths(pose).items():
        assert length == pytest.approx(typical_bone_length(joint), abs=1e-12), joint
    for joint in PARENTS:
        if joint.endswith("_left"):
            left, right = (pose[JOINT_INDEX[name]] for name in (joint, joint.replace("left", "right")))
            assert left.tolist() == (right * [-1, 1, 1]).tolist()
            assert left[0] < 0
    assert pose[JOINT_INDEX["foot_left"], 2] > 0.05
    assert set(pose[:, 2]) == {0.0, pose[JOINT_INDEX["foot_left"], 2]}


def test_poses_agree_with_rotation_matrices_in_a_right_handed_frame(rng):
    """Mirrored Unity coordinates are right-handed: z changes its sign, and so do x and y of quaternions."""
    flip, flip_turn = np.array([1, 1, -1]), np.array([-1, -1, 1, 1])
    for _ in range(20):
        turns = {bone: Rotation.random(rng=rng) for bone in ("Hips", *SKELETON)}
        hips = rng.normal(size=3)
        frames = {"Hips": (hips * flip, turns["Hips"])}
        for bone, (parent, begin) in SKELETON.items():
            start, turn = frames[parent]
            frames[bone] = (start + turn.apply(np.array(begin) * flip), turn * turns[bone])
        expected = [frames[bone][0] + frames[bone][1].apply(np.array(place) * flip) for bone, place in JOINTS.values()]
        unity = {bone: tuple(turn.as_quat() * flip_turn) for bone, turn in turns.items()}
        np.testing.assert_allclose(
            np.array(joint_positions((tuple(hips), unity["Hips"]), unity)) * flip, expected, atol=1e-12
        )


def test_products_and_turned_vectors_are_scipys(rng):
    for _ in range(50):
        one, other = Rotation.random(rng=rng), Rotation.random(rng=rng)
        start, place = rng.normal(size=(2, 3))
        both = quaternion_product(tuple(one.as_quat()), tuple(other.as_quat()))
        np.testing.assert_allclose(Rotation.from_quat(both).as_matrix(), (one * other).as_matrix(), atol=1e-12)
        np.testing.assert_allclose(
            transformed(tuple(start), tuple(one.as_quat()), tuple(place)), start + one.apply(place), atol=1e-12
        )


def test_an_arm_is_raised_by_hand():
    up = (0.0, 0.0, -math.sqrt(0.5), math.sqrt(0.5))
    at_rest, raised = _pose(joint_positions(HIPS, {})), _pose(joint_positions(HIPS, {"LeftUpperArm": up}))
    arm = [JOINT_INDEX[f"{joint}_left"] for joint in ("elbow", "wrist", "hand")]
    shoulder = at_rest[JOINT_INDEX["shoulder_left"]]
    np.testing.assert_allclose(raised[arm], shoulder + np.outer([0.263, 0.510, 0.594], [0, 1, 0]), atol=1e-12)
    rest = [index for index in range(20) if index not in arm]
    assert raised[rest].tolist() == at_rest[rest].tolist()


def test_each_joint_is_moved_by_a_bone_that_every_humanoid_has():
    required = {"Hips", "Spine", "Head"} | {
        f"{side}{bone}"
        for side in ("Left", "Right")
        for bone in ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")
    }
    assert set(DRIVING_BONES) == set(JOINT_INDEX)
    assert set(DRIVING_BONES.values()) == required
    for joint, bone in DRIVING_BONES.items():
        if bone == "Hips":
            continue
        at_rest = joint_positions(HIPS, {})
        turned = joint_positions(HIPS, {bone: (math.sqrt(0.5), 0.0, 0.5, 0.5)})
        index = list(JOINTS).index(joint)
        assert math.dist(at_rest[index], turned[index]) > 0.01, joint
