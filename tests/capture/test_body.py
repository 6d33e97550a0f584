import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.body import (
    ANKLE_HEIGHT_METRES,
    HEAD_TOP_METRES,
    TYPICAL_BONE_METRES,
    bone_lengths,
    height,
    not_upright,
    reach,
    resting_pose,
    upright,
)
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST, PARENTS, TRACKED

from .bodies import body, bone_of, table

WAYS = table("""
spine           0 0.1 0
shoulder_center 0 0.4 0
head            0 0.3 0
shoulder        0.2 0 0
elbow           0.3 0 0
wrist           0 -0.25 0
hand            0.06 -0.08 0
hip             0.06 -0.08 0
knee            0 -0.45 0
ankle           0 -0.35 0
foot            0 0 -0.15
""")
LENGTHS = {bone: np.linalg.norm(way) for bone, way in WAYS.items()}
POSE = body(WAYS, (0.3, 0.9, 2.5))
NOBODY = np.full((20, 3), np.nan)

IN_STEP = table("""
spine           0 0.1 -0.06
shoulder_center 0 0.3 -0.2
head            0 0.3 -0.05
shoulder        0.2 0 0
elbow           0.2 0 -0.2
wrist           0 0.1 -0.2
hand            0 0.08 0
hip             0.1 -0.02 0
knee            0 -0.3 -0.3
ankle           0 -0.4 0.05
foot            0 -0.02 -0.15
""")
STEP = body(IN_STEP, (0, 0, 0))
"""In mid step, a thigh, a shin, both arms and the trunk are far from upright."""


def without(*joints):
    pose = POSE.copy()
    pose[[JOINT_INDEX[joint] for joint in joints]] = np.nan
    return pose


def test_bone_lengths_are_measured_or_those_of_a_typical_body_scaled_to_the_rest():
    assert bone_lengths(POSE) == pytest.approx({joint: LENGTHS[bone_of(joint)] for joint in PARENTS})
    found = bone_lengths(without("elbow_left"))  # its two bones are unknown
    known = [bone_of(joint) for joint in PARENTS if joint not in ("elbow_left", "wrist_left")]
    size = sum(LENGTHS[bone] for bone in known) / sum(TYPICAL_BONE_METRES[bone] for bone in known)
    found = [found[joint] for joint in ("elbow_left", "wrist_left", "elbow_right")]
    assert found == pytest.approx([size * 0.263, size * 0.247, 0.3])
    alone = NOBODY.copy()
    alone[[JOINT_INDEX["head"], JOINT_INDEX["hand_left"]]] = [[0, 1, 2], [1, 1, 2]]
    for unknown in (NOBODY, alone):
        assert bone_lengths(unknown) == {joint: TYPICAL_BONE_METRES[bone_of(joint)] for joint in PARENTS}


def test_reach_is_the_straight_limb_from_shoulder_or_hip_and_that_of_the_trunk_its_length():
    expected = dict.fromkeys(LENGTHS, 0.8) | {"hip_center": 0.8, "elbow": 0.3, "wrist": 0.55, "hand": 0.65}
    expected |= {"knee": 0.45, "ankle": 0.8, "foot": 0.95}
    bent = body(WAYS | {"wrist": (0, 0.15, 0.2), "hand": (0.1, 0, 0)}, (0, 0, 0))
    for pose in (POSE, bent):
        assert_allclose(reach(pose), [expected[bone_of(joint)] for joint in JOINTS])
    assert reach(NOBODY).min() > 0.05


def test_height_is_legs_trunk_and_head_also_crouching_and_that_of_a_person_if_nothing_is_known():
    around = HEAD_TOP_METRES + ANKLE_HEIGHT_METRES
    crouched = body(WAYS | {"knee": (0, 0, -0.45)}, (0, 0, 0))
    for pose in (POSE, crouched):
        assert height(pose) == pytest.approx(0.45 + 0.35 + 0.1 + 0.4 + 0.3 + around)
    assert height(NOBODY) == pytest.approx(0.481 + 0.378 + 0.069 + 0.339 + 0.202 + around)


@pytest.fixture
def take():
    """Twelve frames in which joint j is at (frame, j, 0)."""
    positions = np.zeros((12, 20, 3))
    positions[..., 0] = np.arange(12)[:, None]
    positions[..., 1] = np.arange(20)
    return positions, np.full((12, 20), TRACKED, dtype=np.float32)


def test_a_resting_pose_is_the_median_of_the_frames_asked_for_in_which_a_joint_is_known(take):
    positions, confidence = take
    positions[4, 7] = [100.0, -50.0, 3.0]  # one frame's outlier
    positions[[3, 4, 7], 5], confidence[[3, 4, 7], 5] = np.nan, LOST
    confidence[:, 6] = INFERRED
    found = resting_pose(positions, confidence, first=3, count=5)
    assert_array_equal(found[4:8], [[5, 4, 0], [5.5, 5, 0], [5, 6, 0], [6, 7, 0]])


@pytest.mark.parametrize(
    ("lost", "first", "count", "x"), [(slice(6), 3, 3, 7.0), (slice(6, None), 8, 2, 4.5), (slice(None), 0, 12, np.nan)]
)
def test_a_joint_lost_in_all_frames_is_measured_in_the_nearest_ones(take, lost, first, count, x):
    positions, confidence = take
    positions[lost, 5], confidence[lost, 5] = np.nan, LOST
    found = resting_pose(positions, confidence, first, count)
    assert_array_equal(found[5], [x, 5 + 0 * x, 0 * x])
    assert np.isfinite(np.delete(found, 5, axis=0)).all()


def way_to(pose, joint):
    return pose[JOINT_INDEX[joint]] - pose[JOINT_INDEX[PARENTS[joint]]]


def test_an_upright_stand_has_the_bone_lengths_and_the_heading_of_the_pose():
    angle = 0.6
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    stand = upright(STEP @ turn)
    assert bone_lengths(stand) == pytest.approx(bone_lengths(STEP))
    for joint in ("shoulder_center", "spine"):
        assert way_to(stand, joint)[1] == pytest.approx(np.linalg.norm(way_to(stand, joint)))
    for joint in ("knee_left", "knee_right", "elbow_left", "wrist_right"):
        assert way_to(stand, joint)[1] < -0.98 * np.linalg.norm(way_to(stand, joint))
    assert_allclose(stand, upright(STEP) @ turn, atol=1e-12)


def test_bones_that_nearly_stand_upright_feet_and_joints_beside_unknown_ones_stay_as_they_are():
    stand = upright(STEP)
    for joint in ("head", "ankle_left", "ankle_right", "foot_left", "hip_right"):
        assert_allclose(way_to(stand, joint), way_to(STEP, joint), atol=1e-12)
    turned = {"spine", "shoulder_center", "elbow", "wrist", "knee"}
    assert set(map(bone_of, not_upright(STEP))) == turned
    assert not_upright(stand) == []
    pose, elbow, wrist = STEP.copy(), JOINT_INDEX["elbow_left"], JOINT_INDEX["wrist_left"]
    pose[elbow] = np.nan
    stand = upright(pose)
    assert np.flatnonzero(np.isnan(stand).any(axis=1)).tolist() == [elbow]
    assert_array_equal(stand[wrist], pose[wrist])
