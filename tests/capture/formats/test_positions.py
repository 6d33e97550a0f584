"""Named positions in any unit and axes become the same motion."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture.body import TYPICAL_BONE_METRES
from capture.formats.options import ReadOptions
from capture.formats.positions import clip_of_positions
from capture.formats.proportions import BONES
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

from ..bodies import both
from .people import BLAZEPOSE, HUMAN36M, KINECT_V2, PERSON, POINTS, assert_reads, joints_as, person


def clip_of(points, names=JOINTS, **options):
    return clip_of_positions(Path("take"), "table", names, points, ReadOptions(), **options)


def at(positions, joint):
    return positions[:, JOINT_INDEX[joint]]


def without_heading(poses):
    """Return poses relative to the first hips, turned so that the first hips are parallel to x."""
    poses = poses - at(poses, "hip_center")[0]
    across = (at(poses, "hip_right") - at(poses, "hip_left"))[0]
    turn = Rotation.from_euler("y", np.arctan2(across[2], across[0]))
    return poses @ turn.as_matrix().T


@given(
    unit=st.sampled_from([1.0, 100.0, 1000.0]),
    axes=st.permutations(range(3)),
    signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 3),
    turn=st.floats(-180, 180),
    seed=st.integers(0, 99),
)
@settings(max_examples=60, deadline=None)
def test_unit_up_front_and_handedness_follow_from_the_person(unit, axes, signs, turn, seed):
    turned = PERSON @ Rotation.from_euler("y", turn, degrees=True).as_matrix().T
    clip = clip_of(unit * (turned[..., axes] * signs + np.random.default_rng(seed).normal(size=3)))
    assert_allclose(without_heading(clip.positions), without_heading(PERSON), atol=1e-9)


def test_positions_of_a_sensor_stay_where_they_are_in_any_order_of_the_joints():
    order = np.random.default_rng(3).permutation(len(JOINTS))
    names = [JOINTS[joint] for joint in order]
    clip = clip_of(PERSON[:, order], names, times=np.arange(4.0))
    assert_array_equal(clip.positions, PERSON)
    azure = clip_of(-1000 * PERSON[:, order] * [1, 1, -1], names)
    assert_reads(azure, atol=1e-12)


STRAIGHT = [JOINTS.index(joint) for joint in JOINTS if "foot" not in joint and joint != "spine"]
"""Joints that tell no front if limbs are straight."""
STRAIGHT_NAMES = [JOINTS[at] for at in STRAIGHT]


@pytest.mark.parametrize("toward", [-1, 1])
def test_left_handed_axes_without_feet_follow_from_a_performer_who_faces_the_sensor(toward):
    hips = at(PERSON, "hip_center")[:, None]
    almost = np.where(np.arange(3) == 2, hips + 0.3 * (PERSON - hips), PERSON)  # limbs that hardly bend
    clip = clip_of(almost[:, STRAIGHT] * [toward, 1, 1], STRAIGHT_NAMES)
    assert_reads(clip, almost, STRAIGHT)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_nose_before_the_head_tells_the_front(side):
    poses = PERSON[:, STRAIGHT]
    backwards = np.where(np.arange(3) == 2, poses[:, [0]] - 0.2 * (poses - poses[:, [0]]), poses)  # bent a little
    nose = backwards[:, [JOINTS.index("head")]] + [0, -0.02, -0.1]
    points = np.concatenate([nose, backwards], axis=1) * [side, 1, 1]
    clip = clip_of(points[..., [0, 2, 1]] * [1, -1, 1], ["nose", *STRAIGHT_NAMES])
    assert (at(clip.positions, "hip_right") > at(clip.positions, "hip_left"))[:, 0].all()
    assert ("left-handed" in " ".join(clip.notes)) == (side < 0)


@pytest.mark.parametrize(
    ("names", "between", "lost"),
    [
        (KINECT_V2, set(), set()),
        (BLAZEPOSE, {"hip_center", "spine", "shoulder_center"}, set()),
        (HUMAN36M, set(), {"hand_left", "hand_right", "foot_left", "foot_right"}),
    ],
)
def test_names_of_sensors_and_trackers_are_known(names, between, lost):
    clip = clip_of(joints_as(names), names)
    sure = dict(zip(JOINTS, clip.confidence[0], strict=True))
    assert {joint for joint in JOINTS if sure[joint] == 0} == lost
    assert {joint for joint in JOINTS if sure[joint] == 0.5} == between
    other = between | lost | ({"head"} if names is HUMAN36M else set())
    assert_reads(clip, joints=[JOINT_INDEX[joint] for joint in JOINTS if joint not in other], atol=1e-12)


def test_a_missing_head_continues_the_neck_and_zeros_are_lost_but_for_hips_in_the_middle_of_the_axes():
    poses = PERSON - PERSON[:, :1]
    at(poses, "hand_left")[2] = 0
    clip = clip_of(poses, [joint if joint != "head" else "prop" for joint in JOINTS])
    head = at(clip.positions, "head") - at(clip.positions, "shoulder_center")
    assert_allclose(head, [[0, TYPICAL_BONE_METRES["head"], 0]] * 4, atol=1e-12)
    assert np.argwhere(clip.confidence == 0).tolist() == [[2, JOINT_INDEX["hand_left"]]]


def test_a_head_at_the_hips_continues_the_neck():
    """Also if nobody is there in most frames."""
    poses = np.tile(PERSON[:1], (9, 1, 1))
    at(poses, "head")[:] = 0.9 * at(poses, "hip_center") + 0.1 * at(poses, "spine")
    poses[4:] = np.nan
    clip = clip_of(poses)
    head = at(clip.positions, "head") - at(clip.positions, "shoulder_center")
    assert_allclose(head[:4], [[0, TYPICAL_BONE_METRES["head"], 0]] * 4, atol=1e-12)
    assert "The position of the head is at the hips. The head continues the neck." in clip.notes


def test_a_person_without_arms_has_no_arms():
    names = [joint for joint in JOINTS if not joint.startswith(("elbow", "wrist", "hand"))]
    own = [JOINT_INDEX[joint] for joint in names]
    clip = clip_of(PERSON[:, own], names)
    assert_reads(clip, joints=own, atol=1e-12)
    assert np.isnan(np.delete(clip.positions, own, axis=1)).all()


def test_limbs_without_a_middle_are_straight():
    names = [joint for joint in JOINTS if not joint.startswith(("elbow", "knee"))]
    own = [JOINT_INDEX[joint] for joint in names]
    clip = clip_of(PERSON[:, own], names)
    assert_reads(clip, joints=own, atol=1e-12)
    for joint, before, after in both_sides(("elbow", "shoulder", "wrist"), ("knee", "hip", "ankle")):
        lengths = [TYPICAL_BONE_METRES[name.rpartition("_")[0]] for name in (joint, after)]
        start, end = at(PERSON, before), at(PERSON, after)
        assert_allclose(at(clip.positions, joint), start + lengths[0] / sum(lengths) * (end - start), atol=1e-12)
        assert f"No position for {joint}. It is placed between {before} and {after}." in clip.notes


def both_sides(*limbs):
    return [[f"{joint}_{side}" for joint in limb] for limb in limbs for side in ("left", "right")]


@pytest.mark.parametrize(
    ("names", "part"),
    [
        ("LASI RASI LPSI RPSI LKNE RKNE LANK RANK", "legs without arms and shoulders"),
        ("pelvis knee_left knee_right ankle_left ankle_right", "legs without arms and shoulders"),
        ("neck elbow_left elbow_right wrist_left wrist_right", "arms without hips and legs"),
    ],
)
def test_parts_of_a_person_are_called_so(names, part):
    with pytest.raises(SkeletonLogError) as caught:
        clip_of(PERSON[:, : len(names.split())], names.split())
    assert caught.value.found.endswith(f"among {', '.join(names.split())}: {part}")


def test_the_first_frame_with_hips_is_the_one_that_is_placed():
    poses = PERSON.copy()
    at(poses, "hip_center")[0] = np.nan
    clip = clip_of(100 * (poses - poses[1, 0]))
    known = np.isfinite(poses)
    assert_allclose(clip.positions[known], (PERSON - PERSON[1, 0] + [0, 0, 2.5])[known], atol=1e-9)


UNSEEN = PERSON.copy()
UNSEEN[:, both("shoulder")] = np.nan
SWAPPED = [{"elbow_left": "knee_right", "knee_right": "elbow_left"}.get(joint, joint) for joint in JOINTS]
UPPER = [joint for joint in JOINTS if joint.split("_")[0] in ("head", "shoulder", "elbow", "wrist")]
UPPER_BODY = PERSON[:, [JOINT_INDEX[joint] for joint in UPPER]]
SCORE = 0.9 + np.random.default_rng(0).uniform(-0.05, 0.05, POINTS.shape[:2])
X, Y, _ = np.moveaxis(200 * POINTS, 2, 0)


@pytest.mark.parametrize(
    ("points", "names", "found"),
    [
        (PERSON, SWAPPED, None),
        (PERSON, [f"marker {joint}" for joint in range(20)], None),
        (UNSEEN, JOINTS, "no position for shoulder_left, shoulder_right among hand_left"),
        (np.stack([X, Y, SCORE], axis=2), BLAZEPOSE, "positions in an image"),
        (np.stack([X, Y, X], axis=2), BLAZEPOSE, "positions in an image"),
        (UPPER_BODY * [100, -100, 2], UPPER, "positions in an image"),
    ],
    ids=["joints swapped", "no joints", "never seen", "a score is no depth", "a copy is no depth", "no hips"],
)
def test_positions_that_are_no_persons_in_space_are_refused(points, names, found):
    with pytest.raises(SkeletonLogError, match=found):
        clip_of(points, names)


@pytest.mark.parametrize("joint", ["wrist_right", "ankle_left"])
def test_an_end_of_a_limb_that_is_often_too_far_away_is_lost_there(joint):
    poses = person(8)
    at(poses, joint)[:6] += [1.2, 0, 0]
    clip = clip_of(poses)
    ends = [JOINT_INDEX[each] for each in (joint, joint.replace("wrist", "hand").replace("ankle", "foot"))]
    expected = person(8)
    expected[:6, ends] = np.nan
    assert_reads(clip, expected)
    assert_array_equal(clip.confidence == 0, np.isnan(expected[..., 0]))
    assert any(f"In 6 of 8 frames, {joint} is too far" in note for note in clip.notes)
    at(poses, joint)[6] += [1.2, 0, 0]
    with pytest.raises(SkeletonLogError, match=f"to {joint}"):
        clip_of(poses)


@pytest.mark.parametrize("far", [1, 3])
def test_few_frames_that_are_far_from_the_others_are_lost(far):
    poses = np.tile(PERSON, (20, 1, 1))
    expected = clip_of(poses).positions
    poses[2 : 2 + far] += 9000
    clip = clip_of(poses)
    expected[2 : 2 + far] = np.nan
    assert_allclose(clip.positions, expected)
    assert_array_equal(clip.confidence == 0, np.isnan(expected[..., 0]))
    assert f"{far} of 80 frames" in " ".join(clip.notes)


@pytest.mark.parametrize("depth", [1.0, 0.35])
@pytest.mark.parametrize(
    ("width", "height", "reach", "in_pixels"),
    [(9, 16, 2.5, False), (9, 16, 0.95, False), (16, 9, 2.5, False), (1280, 720, 2.5, True)],
)
def test_positions_in_a_picture_get_one_unit(width, height, reach, in_pixels, depth):
    points = POINTS @ Rotation.from_rotvec([0.5, 0.8, 0]).as_matrix().T  # nothing in the picture's plane
    hips = points[:, [BLAZEPOSE.index("left_hip"), BLAZEPOSE.index("right_hip")]].mean(axis=(0, 1))
    x, y, z = np.moveaxis((points - hips) / reach * min(width, height), 2, 0)
    picture = np.stack([width / 2 - x, height / 2 - y, z / width / depth], axis=2)
    clip = clip_of(picture if in_pixels else picture / [width, height, 1], BLAZEPOSE)
    angles = []
    for each in (clip.positions, PERSON):
        ways = np.stack([at(each, one) - at(each, other) for one, other in BONES], axis=1)
        ways /= np.linalg.norm(ways, axis=2, keepdims=True)
        angles.append(ways @ ways.swapaxes(1, 2))
    assert_allclose(*angles, atol=1e-6)
    assert "scaled to 1.7 m" in " ".join(clip.notes)


@pytest.mark.parametrize("up", [-1.0, 1.0])
def test_depths_in_pixels_are_those_of_a_picture(up):
    points = POINTS * -250.0
    hips = points[:, [BLAZEPOSE.index("left_hip"), BLAZEPOSE.index("right_hip")]].mean(axis=1, keepdims=True)
    picture = (points - hips) * [1, -up, 2] + [640, 360, 0]  # trackers exaggerate depths
    clip = clip_of(picture, BLAZEPOSE)
    assert "pixels of an image, which is assumed to have 1280 × 720" in " ".join(clip.notes)
    found, expected = (
        np.linalg.norm(at(each, "hip_right") - at(each, "hip_left"), axis=1)
        / np.linalg.norm(at(each, "ankle_left") - at(each, "knee_left"), axis=1)
        for each in (clip.positions, PERSON)
    )
    assert_allclose(found, expected)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_picture_in_which_left_is_always_above_right_is_turned(sign):
    hips = POINTS[:, [BLAZEPOSE.index("left_hip"), BLAZEPOSE.index("right_hip")]].mean(axis=(0, 1))
    x, y, z = np.moveaxis((POINTS - hips) @ Rotation.from_euler("z", 3, degrees=True).as_matrix() / 4.5, 2, 0)
    whole, turned = (
        clip_of(np.stack([0.5 + across, 0.5 + down * 16 / 9, z], axis=2), BLAZEPOSE)
        for across, down in ((-x, -y), (-y * sign, x * sign))
    )
    assert_allclose(turned.positions, whole.positions, atol=1e-9)
    assert f"Up is assumed to be {'−' if sign > 0 else ''}x, the direction from feet to head." in turned.notes


@pytest.mark.parametrize("lift", [0.05, -0.05])
def test_up_in_the_picture_of_a_body_that_lies_is_up(lift):
    """It lies on its back, whether the head is higher or lower than the feet."""
    x, y, z = np.moveaxis(POINTS - POINTS.mean(axis=(0, 1)), 2, 0) / 4.5
    clip = clip_of(np.stack([0.5 + y, (0.5 + z - lift * y) * 16 / 9, -x], axis=2), BLAZEPOSE)
    assert "Up is assumed to be −y, as in images: the body does not stand." in clip.notes
    toes = at(clip.positions, "foot_left") - at(clip.positions, "ankle_left")
    assert (toes[:, 1] > np.abs(toes[:, [0, 2]]).max(axis=1)).all()


def test_an_upper_body_in_a_picture_whose_y_is_up_stands():
    x, y, z = np.moveaxis(POINTS - POINTS.mean(axis=(0, 1)), 2, 0) / 4.5
    picture = np.stack([0.5 + x, (0.5 + y) * 16 / 9, z], axis=2)
    picture[:, [k for k, name in enumerate(BLAZEPOSE) if "ankle" in name or "heel" in name or "foot" in name]] = np.nan
    assert "Up is assumed to be y, the direction from feet to head." in clip_of(picture, BLAZEPOSE).notes


def test_a_head_without_ears_is_where_the_nose_is():
    head = PERSON[:, [JOINT_INDEX["head"]]]
    points = np.concatenate(
        [np.delete(PERSON, JOINT_INDEX["head"], axis=1), head * np.nan, head * np.nan, head], axis=1
    )
    clip = clip_of(points, [*(joint for joint in JOINTS if joint != "head"), "left_ear", "right_ear", "nose"])
    assert (at(clip.confidence, "head") > 0).all()


@pytest.mark.parametrize(("axes", "signs"), [([0, 1, 2], [1, 1, 1]), ([0, 2, 1], [1, -1, 1])])
def test_hips_that_have_no_position_are_placed_below_the_shoulders(axes, signs):
    clip = clip_of(100 * UPPER_BODY[..., axes] * signs, UPPER)
    bones, expected = (
        np.linalg.norm(np.diff(each[:, both("shoulder", "elbow", "wrist")[::2]], axis=1), axis=2)
        for each in (clip.positions, PERSON)
    )
    assert_allclose(bones, expected, atol=1e-9)
    down = clip.positions[:, both("shoulder")].mean(axis=1) - at(clip.positions, "hip_center")
    assert_allclose(down[:, [0, 2]], 0, atol=1e-9)
    assert ((down[:, 1] > 0.2) & (down[:, 1] < 0.8)).all()
    assert "No position for the hips. They are placed below the shoulders." in clip.notes
    assert np.isnan(at(clip.positions, "knee_left")).all()
