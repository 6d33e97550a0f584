import numpy as np
import pytest

from capture.body import (
    ANKLE_HEIGHT_METRES,
    HEAD_TOP_METRES,
    TYPICAL_BONE_METRES,
    bone_lengths,
    height,
    not_upright,
    reach,
    resting_pose,
    typical_bone_length,
    upright,
)
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST, PARENTS, TRACKED

CHAINS = [
    ("hip_center", [("spine", (0, 0.1, 0)), ("shoulder_center", (0, 0.4, 0)), ("head", (0, 0.3, 0))]),
    (
        "shoulder_center",
        [("shoulder", (0.2, 0, 0)), ("elbow", (0.3, 0, 0)), ("wrist", (0, -0.25, 0)), ("hand", (0.06, -0.08, 0))],
    ),
    (
        "hip_center",
        [("hip", (0.06, -0.08, 0)), ("knee", (0, -0.45, 0)), ("ankle", (0, -0.35, 0)), ("foot", (0, 0, -0.15))],
    ),
]
"""Joints of each limb with the offset from the joint before; y up, the right side at +x."""

LENGTHS = {
    "spine": 0.1,
    "shoulder_center": 0.4,
    "head": 0.3,
    "shoulder": 0.2,
    "elbow": 0.3,
    "wrist": 0.25,
    "hand": 0.1,
    "hip": 0.1,
    "knee": 0.45,
    "ankle": 0.35,
    "foot": 0.15,
}


def simple_pose():
    pose = np.zeros((20, 3))
    for start, chain in CHAINS:
        for side, sign in (("right", 1), ("left", -1)):
            at = start
            for bone, offset in chain:
                joint = bone if bone in JOINTS else f"{bone}_{side}"
                pose[JOINT_INDEX[joint]] = pose[JOINT_INDEX[at]] + np.array(offset) * [sign, 1, 1]
                at = joint
    return pose + np.array([0.3, 0.9, 2.5])


def without(*joints):
    pose = simple_pose()
    pose[[JOINT_INDEX[joint] for joint in joints]] = np.nan
    return pose


def bone_of(joint):
    return joint.removesuffix("_left").removesuffix("_right") if joint not in LENGTHS else joint


# --- bones


def test_bone_lengths_of_a_simple_pose_equal_values_by_hand():
    found = bone_lengths(simple_pose())
    assert found == pytest.approx({joint: LENGTHS[bone_of(joint)] for joint in PARENTS})


def test_every_bone_has_a_typical_length():
    assert {joint: typical_bone_length(joint) for joint in PARENTS} == {
        joint: TYPICAL_BONE_METRES[bone_of(joint)] for joint in PARENTS
    }
    assert set(TYPICAL_BONE_METRES) == set(LENGTHS)


def test_bones_of_a_lost_joint_are_typical_ones_scaled_to_the_rest():
    """Without the left elbow, its two bones are unknown; the 17 others determine the size of the body."""
    found = bone_lengths(without("elbow_left"))
    known = [joint for joint in PARENTS if joint not in ("elbow_left", "wrist_left")]
    size = sum(LENGTHS[bone_of(joint)] for joint in known) / sum(typical_bone_length(joint) for joint in known)
    assert found["elbow_left"] == pytest.approx(size * 0.263)
    assert found["wrist_left"] == pytest.approx(size * 0.247)
    assert found["elbow_right"] == pytest.approx(0.3)


def test_a_body_twice_as_large_has_bones_twice_as_long_known_or_not():
    pose = without("elbow_left", "foot_right", "hip_center")
    once, twice = bone_lengths(pose), bone_lengths(2 * pose)
    assert twice == pytest.approx({joint: 2 * length for joint, length in once.items()})


def test_a_body_of_which_nothing_is_known_is_typical():
    assert bone_lengths(np.full((20, 3), np.nan)) == {joint: typical_bone_length(joint) for joint in PARENTS}


def test_a_body_of_which_no_two_neighbours_are_known_is_typical():
    pose = np.full((20, 3), np.nan)
    pose[[JOINT_INDEX["head"], JOINT_INDEX["hand_left"]]] = [[0, 1, 2], [1, 1, 2]]
    assert bone_lengths(pose) == {joint: typical_bone_length(joint) for joint in PARENTS}


# --- reach


def test_reach_is_the_straight_limb_from_shoulder_or_hip():
    found = dict(zip(JOINTS, reach(simple_pose()), strict=True))
    for side in ("left", "right"):
        assert found[f"elbow_{side}"] == pytest.approx(0.3)
        assert found[f"wrist_{side}"] == pytest.approx(0.3 + 0.25)
        assert found[f"hand_{side}"] == pytest.approx(0.3 + 0.25 + 0.1)
        assert found[f"knee_{side}"] == pytest.approx(0.45)
        assert found[f"ankle_{side}"] == pytest.approx(0.45 + 0.35)
        assert found[f"foot_{side}"] == pytest.approx(0.45 + 0.35 + 0.15)


def test_the_reach_of_the_trunk_is_its_length():
    found = dict(zip(JOINTS, reach(simple_pose()), strict=True))
    for joint in (*JOINTS[:4], "shoulder_left", "shoulder_right", "hip_left", "hip_right"):
        assert found[joint] == pytest.approx(0.1 + 0.4 + 0.3)


def test_reach_does_not_depend_on_the_pose():
    """Bent or raised arms have the same length."""
    pose = simple_pose()
    bent = pose.copy()
    wrist, hand = JOINT_INDEX["wrist_right"], JOINT_INDEX["hand_right"]
    bent[wrist] = bent[JOINT_INDEX["elbow_right"]] + [0, 0.15, 0.2]
    bent[hand] = bent[wrist] + [0.1, 0, 0]
    np.testing.assert_allclose(reach(bent), reach(pose))


def test_reach_is_known_for_every_joint_of_any_pose():
    for pose in (np.full((20, 3), np.nan), without("hip_center", "hand_left"), simple_pose()):
        found = reach(pose)
        assert found.shape == (20,)
        assert found.min() > 0.05


# --- height


def test_height_is_legs_trunk_and_head():
    assert height(simple_pose()) == pytest.approx(
        2 * (0.45 + 0.35) / 2 + 0.1 + 0.4 + 0.3 + HEAD_TOP_METRES + ANKLE_HEIGHT_METRES
    )


def test_a_typical_body_is_as_tall_as_a_person():
    nobody = np.full((20, 3), np.nan)
    assert height(nobody) == pytest.approx(
        0.481 + 0.378 + 0.069 + 0.339 + 0.202 + HEAD_TOP_METRES + ANKLE_HEIGHT_METRES
    )
    assert 1.4 < height(nobody) < 1.9


def test_height_is_the_same_crouching():
    crouched = simple_pose()
    for side in ("left", "right"):
        at = crouched[JOINT_INDEX[f"hip_{side}"]]
        crouched[JOINT_INDEX[f"knee_{side}"]] = at + np.array([0, 0, -0.45])
        crouched[JOINT_INDEX[f"ankle_{side}"]] = at + np.array([0, -0.35, -0.45])
        crouched[JOINT_INDEX[f"foot_{side}"]] = at + np.array([0, -0.35, -0.6])
    assert height(crouched) == pytest.approx(height(simple_pose()))


# --- resting pose


@pytest.fixture
def take():
    """Twelve frames in which joint j is at (frame, j, 0)."""
    positions = np.zeros((12, 20, 3))
    positions[..., 0] = np.arange(12)[:, None]
    positions[..., 1] = np.arange(20)
    return positions, np.full((12, 20), TRACKED, dtype=np.float32)


def lose(take, joint, frames):
    positions, confidence = take
    positions[frames, joint], confidence[frames, joint] = np.nan, LOST


def test_resting_pose_is_the_median_of_the_frames_asked_for(take):
    positions, confidence = take
    positions[4, 7] = [100.0, -50.0, 3.0]  # one frame's outlier
    found = resting_pose(positions, confidence, first=3, count=5)
    np.testing.assert_array_equal(found[:7, 0], 5.0)
    np.testing.assert_array_equal(found[:7, 1], np.arange(7))
    np.testing.assert_array_equal(
        found[7], np.median([[3, 7, 0], [100, -50, 3], [5, 7, 0], [6, 7, 0], [7, 7, 0]], axis=0)
    )


def test_a_joint_lost_in_some_frames_is_measured_in_the_others(take):
    lose(take, 5, [3, 4, 7])
    found = resting_pose(*take, first=3, count=5)
    np.testing.assert_array_equal(found[5], [5.5, 5, 0])
    np.testing.assert_array_equal(found[4], [5.0, 4, 0])


def test_a_joint_lost_in_all_frames_is_measured_in_the_nearest_frames(take):
    lose(take, 5, slice(0, 6))
    np.testing.assert_array_equal(resting_pose(*take, first=3, count=3)[5], [7.0, 5, 0])  # of frames 6, 7, 8
    positions, confidence = take
    positions[:6], confidence[:6] = positions[6:] - [6.0, 0, 0], TRACKED
    positions[6:, 5], confidence[6:, 5] = np.nan, LOST
    np.testing.assert_array_equal(resting_pose(*take, first=8, count=2)[5], [4.5, 5, 0])  # of frames 5, 4


def test_a_joint_that_is_never_known_is_nan(take):
    lose(take, 5, slice(None))
    found = resting_pose(*take, first=0, count=12)
    assert np.isnan(found[5]).all()
    assert np.isfinite(np.delete(found, 5, axis=0)).all()


def test_inferred_joints_count_as_known(take):
    positions, confidence = take
    confidence[:, 5] = INFERRED
    np.testing.assert_array_equal(resting_pose(positions, confidence, first=0, count=3)[5], [1.0, 5, 0])


def in_step():
    """A pose (20, 3) in mid step: a thigh, a shin, both arms and the trunk are far from upright."""
    ways = {"spine": (0, 0.1, -0.06), "shoulder_center": (0, 0.3, -0.2), "head": (0, 0.3, -0.05)}
    sides = {"shoulder": (0.2, 0, 0), "elbow": (0.2, 0, -0.2), "wrist": (0, 0.1, -0.2), "hand": (0, 0.08, 0)}
    sides |= {"hip": (0.1, -0.02, 0), "knee": (0, -0.3, -0.3), "ankle": (0, -0.4, 0.05), "foot": (0, -0.02, -0.15)}
    pose = np.zeros((len(JOINTS), 3))
    for joint, parent in PARENTS.items():
        bone, _, side = joint.partition("_")
        way = ways.get(joint) or np.multiply(sides[bone], [1 if side == "right" else -1, 1, 1])
        pose[JOINT_INDEX[joint]] = pose[JOINT_INDEX[parent]] + way
    return pose


def way_to(pose, joint):
    return pose[JOINT_INDEX[joint]] - pose[JOINT_INDEX[PARENTS[joint]]]


def test_an_upright_stand_has_the_bone_lengths_and_the_heading_of_the_pose():
    angle = 0.6
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])

    stand = upright(in_step() @ turn)

    assert bone_lengths(stand) == pytest.approx(bone_lengths(in_step()))
    for joint in ("shoulder_center", "spine"):
        assert way_to(stand, joint)[1] == pytest.approx(np.linalg.norm(way_to(stand, joint)))
    for joint in ("knee_left", "knee_right", "elbow_left", "wrist_right"):
        assert way_to(stand, joint)[1] < -0.98 * np.linalg.norm(way_to(stand, joint))
    assert np.allclose(stand, upright(in_step()) @ turn)


def test_joints_that_do_not_stand_upright_are_those_whose_bones_an_upright_stand_turns():
    turned = {"spine", "shoulder_center", "elbow", "wrist", "hand", "knee"}
    assert {
        joint.partition("_")[0] if "_" in joint and "center" not in joint else joint for joint in not_upright(in_step())
    } == turned
    assert not_upright(upright(in_step())) == []


def test_bones_that_nearly_stand_upright_and_feet_stay_as_they_are():
    stand = upright(in_step())

    for joint in ("head", "ankle_left", "ankle_right", "foot_left", "hip_right"):
        assert np.allclose(way_to(stand, joint), way_to(in_step(), joint))
    assert np.allclose(upright(stand), stand)


def test_joints_beside_unknown_ones_stay_where_they_are():
    pose = in_step()
    pose[JOINT_INDEX["elbow_left"]] = np.nan

    stand = upright(pose)

    assert np.flatnonzero(np.isnan(stand).any(axis=1)).tolist() == [JOINT_INDEX["elbow_left"]]
    assert np.array_equal(stand[JOINT_INDEX["wrist_left"]], pose[JOINT_INDEX["wrist_left"]])
