"""Named positions in any unit and axes become the same motion."""

from pathlib import Path

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.body import TYPICAL_BONE_METRES, typical_bone_length
from capture.formats.options import ReadOptions
from capture.formats.positions import clip_of_positions
from capture.formats.proportions import BONES
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

PATH, OPTIONS = Path("take"), ReadOptions()

KINECT_V2 = [
    "SpineBase",
    "SpineMid",
    "Neck",
    "Head",
    "ShoulderLeft",
    "ElbowLeft",
    "WristLeft",
    "HandLeft",
    "ShoulderRight",
    "ElbowRight",
    "WristRight",
    "HandRight",
    "HipLeft",
    "KneeLeft",
    "AnkleLeft",
    "FootLeft",
    "HipRight",
    "KneeRight",
    "AnkleRight",
    "FootRight",
    "SpineShoulder",
    "HandTipLeft",
    "ThumbLeft",
    "HandTipRight",
    "ThumbRight",
]

BLAZEPOSE = [
    "nose",
    "left_eye_inner",
    "left_eye",
    "left_eye_outer",
    "right_eye_inner",
    "right_eye",
    "right_eye_outer",
    "left_ear",
    "right_ear",
    "mouth_left",
    "mouth_right",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_pinky",
    "right_pinky",
    "left_index",
    "right_index",
    "left_thumb",
    "right_thumb",
    "left_hip",
    "right_hip",
    "left_knee",
    "right_knee",
    "left_ankle",
    "right_ankle",
    "left_heel",
    "right_heel",
    "left_foot_index",
    "right_foot_index",
]

HUMAN36M = [
    "Hip",
    "RHip",
    "RKnee",
    "RFoot",
    "LHip",
    "LKnee",
    "LFoot",
    "Spine",
    "Thorax",
    "Nose",
    "Head",
    "LShoulder",
    "LElbow",
    "LWrist",
    "RShoulder",
    "RElbow",
    "RWrist",
]


def person(frames=4):
    """Return (T, 20, 3) positions of a person 2.5 m in front of a sensor who raises the right arm."""
    ways = {"shoulder": (1, 0, 0), "hip": (1, 0, 0), "elbow": (0.2, -1, 0.3), "wrist": (0.1, -1, -0.3)}
    ways |= {"hand": (0, -1, -0.2), "knee": (0, -1, -0.1), "ankle": (0, -1, 0.1), "foot": (0, -0.3, -1)}
    poses = np.tile([0.1, 0.2, 2.5], (frames, len(JOINTS), 1))
    for joint, parent in PARENTS.items():
        part, _, side = joint.partition("_")
        way = np.array(ways.get(part if side in ("left", "right") else "", (0, 1, 0)), float)
        way = np.tile(way / np.linalg.norm(way) * ([1, 1, 1] if side == "right" else [-1, 1, 1]), (frames, 1))
        if joint == "elbow_right":
            way[:, 1] += np.linspace(0, 1.5, frames)
            way /= np.linalg.norm(way, axis=1, keepdims=True)
        poses[:, JOINT_INDEX[joint]] = poses[:, JOINT_INDEX[parent]] + typical_bone_length(joint) * way
    return poses


def without_heading(poses):
    """Return poses relative to the first hips, turned so that the first hips are parallel to x."""
    poses = poses - poses[0, JOINT_INDEX["hip_center"]]
    across = poses[0, JOINT_INDEX["hip_right"]] - poses[0, JOINT_INDEX["hip_left"]]
    turn = scipy.spatial.transform.Rotation.from_euler("y", np.arctan2(across[2], across[0]))
    return (poses.reshape(-1, 3) @ turn.as_matrix().T).reshape(poses.shape)


@given(
    unit=st.sampled_from([1.0, 100.0, 1000.0]),
    axes=st.permutations(range(3)),
    signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 3),
    turn=st.floats(-180, 180),
    seed=st.integers(0, 99),
)
@settings(max_examples=60, deadline=None)
def test_unit_up_front_and_handedness_follow_from_the_person(unit, axes, signs, turn, seed):
    poses = person()
    turned = poses @ scipy.spatial.transform.Rotation.from_euler("y", turn, degrees=True).as_matrix().T
    moved = unit * (turned[..., axes] * signs + np.random.default_rng(seed).normal(size=3))
    clip = clip_of_positions(PATH, "table", JOINTS, moved, OPTIONS)
    np.testing.assert_allclose(without_heading(clip.positions), without_heading(poses), atol=1e-9)


def test_positions_of_a_sensor_stay_where_they_are_in_any_order_of_the_joints():
    poses = person()
    order = np.random.default_rng(3).permutation(len(JOINTS))
    names = [JOINTS[joint] for joint in order]
    clip = clip_of_positions(PATH, "table", names, poses[:, order], OPTIONS, times=np.arange(4.0))
    np.testing.assert_array_equal(clip.positions, poses)
    azure = clip_of_positions(PATH, "table", names, -1000 * poses[:, order] * [1, 1, -1], OPTIONS)
    np.testing.assert_allclose(azure.positions, poses, atol=1e-12)


STRAIGHT = [JOINTS.index(joint) for joint in JOINTS if "foot" not in joint and joint != "spine"]


@pytest.mark.parametrize("toward", [-1, 1])
def test_left_handed_axes_without_feet_follow_from_a_performer_who_faces_the_sensor(toward):
    poses = person()[:, STRAIGHT]
    hips = poses[:, [JOINTS.index("hip_center")]]
    almost = np.where(np.arange(3) == 2, hips + 0.3 * (poses - hips), poses)  # limbs that hardly bend
    clip = clip_of_positions(PATH, "table", [JOINTS[at] for at in STRAIGHT], almost * [toward, 1, 1], OPTIONS)
    np.testing.assert_allclose(clip.positions[:, STRAIGHT], almost, atol=1e-9)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_nose_before_the_head_tells_the_front(side):
    poses = person()[:, STRAIGHT]
    names = ["nose", *(JOINTS[at] for at in STRAIGHT)]
    backwards = np.where(np.arange(3) == 2, poses[:, [0]] - 0.2 * (poses - poses[:, [0]]), poses)  # bent a little
    nose = backwards[:, [JOINTS.index("head")]] + [0, -0.02, -0.1]
    points = np.concatenate([nose, backwards], axis=1) * [side, 1, 1]
    clip = clip_of_positions(PATH, "table", names, points[..., [0, 2, 1]] * [1, -1, 1], OPTIONS)
    across = clip.positions[:, JOINT_INDEX["hip_right"]] - clip.positions[:, JOINT_INDEX["hip_left"]]
    assert (across[:, 0] > 0).all()
    assert ("left-handed" in " ".join(clip.notes)) == (side < 0)


def joints_as(names):
    """Return the person's positions under the names of another skeleton; others are near the joint that they follow."""
    poses, at = person(), {}
    for joint in JOINTS:
        at[joint.replace("_", "")] = poses[:, JOINT_INDEX[joint]]
    same = {"hip": "hipcenter", "spinebase": "hipcenter", "thorax": "shouldercenter", "spineshoulder": "shouldercenter"}
    same |= {"spinemid": "spine", "neck": "shouldercenter", "pelvis": "hipcenter"}
    for side in "left", "right":
        at |= {f"{part}{side}": at[f"foot{side}"] for part in ("footindex",)}
        at |= {f"heel{side}": at[f"ankle{side}"], f"ear{side}": at["head"]}
        at |= {f"{part}{side}": at[f"hand{side}"] for part in ("index", "pinky", "thumb", "handtip")}
    columns = []
    for name in names:
        key = name.lower().replace("_", "")
        for side, start in (("left", "l"), ("right", "r")):
            if key.startswith(side):
                key = key.removeprefix(side) + side
            elif names is HUMAN36M and key.startswith(start):
                key = key.removeprefix(start).replace("foot", "ankle") + side
        columns.append(at.get(same.get(key, key), at["head"] - [0, 0, 0.1]))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize(
    ("names", "between", "lost"),
    [
        (KINECT_V2, set(), set()),
        (BLAZEPOSE, {"hip_center", "spine", "shoulder_center"}, set()),
        (HUMAN36M, set(), {"hand_left", "hand_right", "foot_left", "foot_right"}),
    ],
)
def test_names_of_sensors_and_trackers_are_known(names, between, lost):
    clip = clip_of_positions(PATH, "table", names, joints_as(names), OPTIONS)
    assert {joint for joint in JOINTS if clip.confidence[0, JOINT_INDEX[joint]] == 0} == lost
    assert {joint for joint in JOINTS if clip.confidence[0, JOINT_INDEX[joint]] == 0.5} == between
    own = [
        JOINT_INDEX[joint]
        for joint in JOINTS
        if joint not in between | lost | ({"head"} if names is HUMAN36M else set())
    ]
    np.testing.assert_allclose(clip.positions[:, own], person()[:, own], atol=1e-12)


def test_a_missing_head_continues_the_neck_and_zeros_are_lost_but_for_hips_in_the_middle_of_the_axes():
    poses = person() - person()[:, :1]
    poses[2, JOINT_INDEX["hand_left"]] = 0
    names = [joint if joint != "head" else "prop" for joint in JOINTS]
    clip = clip_of_positions(PATH, "table", names, poses, OPTIONS)
    head = clip.positions[:, JOINT_INDEX["head"]] - clip.positions[:, JOINT_INDEX["shoulder_center"]]
    np.testing.assert_allclose(head, np.tile([0, TYPICAL_BONE_METRES["head"], 0], (4, 1)), atol=1e-12)
    assert np.argwhere(clip.confidence == 0).tolist() == [[2, JOINT_INDEX["hand_left"]]]


def test_a_person_without_arms_has_no_arms():
    names = [joint for joint in JOINTS if not joint.startswith(("elbow", "wrist", "hand"))]
    own = [JOINT_INDEX[joint] for joint in names]
    clip = clip_of_positions(PATH, "table", names, person()[:, own], OPTIONS)
    np.testing.assert_allclose(clip.positions[:, own], person()[:, own], atol=1e-12)
    assert np.isnan(np.delete(clip.positions, own, axis=1)).all()


def test_the_first_frame_with_hips_is_the_one_that_is_placed():
    poses = 100 * person()
    poses[0, JOINT_INDEX["hip_center"]] = np.nan
    clip = clip_of_positions(PATH, "table", JOINTS, poses - poses[1, 0], OPTIONS)
    known = np.isfinite(poses)
    np.testing.assert_allclose(clip.positions[known], (person() - person()[1, 0] + [0, 0, 2.5])[known], atol=1e-9)


def test_other_bodies_and_names_are_refused():
    poses = person()
    wrong = list(JOINTS)
    wrong[5], wrong[17] = wrong[17], wrong[5]
    for names in (wrong, [f"marker {joint}" for joint in range(20)]):
        with pytest.raises(SkeletonLogError):
            clip_of_positions(PATH, "table", names, poses, OPTIONS)


def test_joints_that_are_never_seen_are_missing():
    poses = person()
    poses[:, [JOINT_INDEX["shoulder_left"], JOINT_INDEX["shoulder_right"]]] = np.nan
    with pytest.raises(SkeletonLogError, match=r"no position for shoulder_left, shoulder_right among hand_left"):
        clip_of_positions(PATH, "table", JOINTS, poses, OPTIONS)


@pytest.mark.parametrize("joint", ["wrist_right", "ankle_left"])
@pytest.mark.parametrize(("stray", "is_read"), [(6, True), (7, False)])
def test_an_end_of_a_limb_that_is_often_too_far_away_is_lost_there(joint, stray, is_read):
    poses = person(8)
    poses[:stray, JOINT_INDEX[joint]] += [1.2, 0, 0]
    if not is_read:
        with pytest.raises(SkeletonLogError, match=f"to {joint}"):
            clip_of_positions(PATH, "table", JOINTS, poses, OPTIONS)
        return
    clip = clip_of_positions(PATH, "table", JOINTS, poses, OPTIONS)
    end = joint.replace("wrist", "hand").replace("ankle", "foot")
    lost = {(frame, JOINT_INDEX[each]) for frame in range(stray) for each in (joint, end)}
    assert {tuple(each) for each in np.argwhere(clip.confidence == 0).tolist()} == lost
    known = clip.confidence > 0
    np.testing.assert_allclose(clip.positions[known], person(8)[known], atol=1e-9)
    assert any(f"In 6 of 8 frames, {joint} is too far" in note for note in clip.notes)


@pytest.mark.parametrize("far", [1, 3])
def test_few_frames_that_are_far_from_the_others_are_lost(far):
    poses = np.tile(person(4), (20, 1, 1))
    expected = clip_of_positions(PATH, "table", JOINTS, poses, OPTIONS)
    wrong = poses.copy()
    wrong[2 : 2 + far] += 9000
    clip = clip_of_positions(PATH, "table", JOINTS, wrong, OPTIONS)
    assert np.flatnonzero((clip.confidence == 0).all(axis=1)).tolist() == list(range(2, 2 + far))
    kept = (clip.confidence > 0).all(axis=1)
    np.testing.assert_allclose(clip.positions[kept], expected.positions[kept])
    assert f"{far} of 80 frames" in " ".join(clip.notes)


@pytest.mark.parametrize("depth", [1.0, 0.5])
@pytest.mark.parametrize(
    ("width", "height", "reach", "in_pixels"),
    [(9, 16, 2.5, False), (9, 16, 0.95, False), (16, 9, 2.5, False), (1280, 720, 2.5, True)],
)
def test_positions_in_a_picture_get_one_unit(width, height, reach, in_pixels, depth):
    turn = scipy.spatial.transform.Rotation.from_rotvec([0.5, 0.8, 0]).as_matrix()  # nothing in the picture's plane
    points = joints_as(BLAZEPOSE) @ turn.T
    hips = points[:, [BLAZEPOSE.index("left_hip"), BLAZEPOSE.index("right_hip")]].mean(axis=(0, 1))
    x, y, z = np.moveaxis((points - hips) / reach * min(width, height), 2, 0)
    picture = np.stack([width / 2 - x, height / 2 - y, z / width / depth], axis=2)
    if not in_pixels:
        picture /= [width, height, 1]
    clip = clip_of_positions(PATH, "table", BLAZEPOSE, picture, OPTIONS)
    angles = []
    for each in (clip.positions, person()):
        ways = np.stack([each[:, JOINT_INDEX[one]] - each[:, JOINT_INDEX[other]] for one, other in BONES], axis=1)
        ways /= np.linalg.norm(ways, axis=2, keepdims=True)
        angles.append(ways @ ways.swapaxes(1, 2))
    np.testing.assert_allclose(*angles, atol=1e-6)
    assert "scaled to 1.7 m" in " ".join(clip.notes)


@pytest.mark.parametrize("up", [-1.0, 1.0])
def test_depths_in_pixels_are_those_of_a_picture(up):
    points = joints_as(BLAZEPOSE) * -250.0
    hips = points[:, [BLAZEPOSE.index("left_hip"), BLAZEPOSE.index("right_hip")]].mean(axis=1, keepdims=True)
    picture = (points - hips) * [1, -up, 2] + [640, 360, 0]  # trackers exaggerate depths
    clip = clip_of_positions(PATH, "table", BLAZEPOSE, picture, OPTIONS)
    assert "pixels of an image, which is assumed to have 1280 × 720" in " ".join(clip.notes)
    across = clip.positions[:, JOINT_INDEX["hip_right"]] - clip.positions[:, JOINT_INDEX["hip_left"]]
    expected = person()[:, JOINT_INDEX["hip_right"]] - person()[:, JOINT_INDEX["hip_left"]]
    shank, own = (
        each[:, JOINT_INDEX["ankle_left"]] - each[:, JOINT_INDEX["knee_left"]] for each in (clip.positions, person())
    )
    sizes = [np.linalg.norm(each, axis=1) for each in (across, expected, shank, own)]
    np.testing.assert_allclose(sizes[0] / sizes[2], sizes[1] / sizes[3])


@pytest.mark.parametrize("depth", [0.9, np.nan])
def test_a_score_or_a_copy_is_no_depth(depth):
    points = joints_as(BLAZEPOSE) * 200.0
    score = depth + np.random.default_rng(0).uniform(-0.05, 0.05, points.shape[:2])
    points[..., 2] = points[..., 0] if np.isnan(depth) else score
    with pytest.raises(SkeletonLogError, match="positions in an image"):
        clip_of_positions(PATH, "table", BLAZEPOSE, points, OPTIONS)


def test_a_head_without_ears_is_where_the_nose_is():
    names = [*(joint for joint in JOINTS if joint != "head"), "left_ear", "right_ear", "nose"]
    points = person()
    head = points[:, [JOINT_INDEX["head"]]]
    points = np.concatenate([np.delete(points, JOINT_INDEX["head"], axis=1), head, head * np.nan, head], axis=1)
    clip = clip_of_positions(PATH, "table", names, points, OPTIONS)
    assert (clip.confidence[:, JOINT_INDEX["head"]] > 0).all()


@pytest.mark.parametrize("axes", [[0, 1, 2], [0, 2, 1]])
def test_hips_that_have_no_position_are_placed_below_the_shoulders(axes):
    poses = person()
    names = [joint for joint in JOINTS if joint.split("_")[0] in ("head", "shoulder", "elbow", "wrist")]
    own = poses[:, [JOINT_INDEX[joint] for joint in names]]
    signs = [1, 1, 1] if axes[1] == 1 else [1, -1, 1]
    clip = clip_of_positions(PATH, "table", names, 100 * own[..., axes] * signs, OPTIONS)
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("shoulder", "elbow", "wrist") for side in ("left", "right")]
    bones, expected = (np.diff(each[:, arms[::2]], axis=1) for each in (clip.positions, poses))
    np.testing.assert_allclose(np.linalg.norm(bones, axis=2), np.linalg.norm(expected, axis=2), atol=1e-9)
    middle = clip.positions[:, [JOINT_INDEX["shoulder_left"], JOINT_INDEX["shoulder_right"]]].mean(axis=1)
    down = middle - clip.positions[:, JOINT_INDEX["hip_center"]]
    np.testing.assert_allclose(down[:, [0, 2]], 0, atol=1e-9)
    assert (down[:, 1] > 0.2).all()
    assert (down[:, 1] < 0.8).all()
    assert "No position for the hips. They are placed below the shoulders." in clip.notes
    assert np.isnan(clip.positions[:, JOINT_INDEX["knee_left"]]).all()


def test_depths_of_positions_without_hips_may_be_those_of_an_image():
    names = [joint for joint in JOINTS if joint.split("_")[0] in ("head", "shoulder", "elbow", "wrist")]
    points = person()[:, [JOINT_INDEX[joint] for joint in names]] * [100, -100, 2]
    with pytest.raises(SkeletonLogError, match="positions in an image"):
        clip_of_positions(PATH, "table", names, points, OPTIONS)
