"""JSON of trackers is read in the forms in which programs write it."""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.formats import kinect_v2_json, landmarks_json
from capture.formats.layouts import JOINT_SETS
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

from ..bodies import both
from .people import BLAZEPOSE, LIMBS, MATRICES, PERSON, POINTS, assert_reads, joints_as, person

FRAMES = range(len(PERSON))


def named(points, names):
    return dict(zip(names, points, strict=True))


def x_y_z(points):
    return [named(point, "xyz") for point in points]


def elements(points, key="position", names=JOINTS, of=lambda point: point):
    """Return a list of objects with a name and a point."""
    return [{"name": name, key: of(point)} for name, point in zip(names, points, strict=True)]


POSES = POINTS.tolist()
OBJECTS = [[{**point, "visibility": 0.9} for point in x_y_z(pose)] for pose in POSES]
FORMS = {
    "names": [named(pose, BLAZEPOSE) for pose in POSES],
    "named objects": [[{"name": name, **point} for name, point in named(pose, BLAZEPOSE).items()] for pose in OBJECTS],
    "objects": [
        {"landmarks2d": [{"x": 1, "y": 2}] * 33, "landmarks": pose, "time": k / 25} for k, pose in enumerate(OBJECTS)
    ],
    "world": [
        {"pose_landmarks": (pose * [1, 2, 3]).tolist(), "pose_world_landmarks": pose.tolist()} for pose in POINTS
    ],
    "texts": [x_y_z([map(str, point) for point in pose]) for pose in POSES],
    "camera": [
        [
            {"joint": name, "cameraX": x, "cameraY": y, "cameraZ": z, "depthX": 7, "depthY": 8}
            for name, (x, y, z) in named(pose, BLAZEPOSE).items()
        ]
        for pose in POSES
    ],
    "numbers of joints": [{str(33 - k): point for k, point in enumerate(pose[::-1], 1)} for pose in POSES],
    "poses": [
        elements(
            x_y_z(pose), "pose", BLAZEPOSE, lambda point: {"position": point, "rotation": {"w": 1, "x": 0, "y": 0}}
        )
        for pose in POSES
    ],
    "lists": POSES,
    "numbers": [{"people": [{"pose_keypoints_3d": pose.ravel().tolist()}]} for pose in POINTS],
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("frames", ["list", "numbers", "pictures", "key"])
def test_forms_of_frames_and_poses(read, form, frames):
    poses = FORMS[form]
    document = {
        "list": poses,
        "numbers": {"positions": {f"{k}.0": pose for k, pose in enumerate(poses)}},
        "pictures": {f"./picture{k}.png": pose for k, pose in enumerate(poses)},
        "key": {"fps": 30, "frames": poses},
    }[frames]
    content = json.dumps(document)
    assert landmarks_json.matches(content.encode())
    [clip] = read(landmarks_json, content)
    assert_reads(clip, joints=LIMBS, step=1 / 25 if form == "objects" else 1 / 30)


BY_COLUMNS = MATRICES.swapaxes(2, 3)
COLUMNS = {
    f"{joint}_{axis}": PERSON[:, k, a].tolist() for k, joint in enumerate(JOINTS) for a, axis in enumerate("xyz")
}
ROWS = [{name: values[t] for name, values in COLUMNS.items()} for t in FRAMES]
TABLES = {
    "rows": [{"time": t / 30, **row} for t, row in enumerate(ROWS)],
    "rows in a key": {"data": [{"frame": t, **row} for t, row in enumerate(ROWS)]},
    "columns": COLUMNS,
    "columns of numbered rows": {name: {str(t): values[t] for t in FRAMES} for name, values in COLUMNS.items()},
    "columns of axes": {joint: {axis: COLUMNS[f"{joint}_{axis}"] for axis in "xyz"} for joint in JOINTS},
    "tracks": {"tracks": elements(PERSON.swapaxes(0, 1).tolist(), "positions")},
    "texts": [named(["({}, {}, {})".format(*point) for point in pose], JOINTS) for pose in PERSON],
    "matrices": [{"joints": elements(pose, "transform")} for pose in MATRICES.tolist()],
    "matrices by columns": [{"joints": elements(pose, "transform")} for pose in BY_COLUMNS.tolist()],
    "matrices of ARKit": [
        named([{"modelTransform": {"columns": each}} for each in pose], JOINTS) for pose in BY_COLUMNS.tolist()
    ],
    "matrices in a list": [named(pose, JOINTS) for pose in BY_COLUMNS.reshape(-1, 20, 16).tolist()],
    "samples": {
        "name": "wave",
        "samples": [{"rate": 30, "frames": [{"jointCount": 20, "values": pose.ravel().tolist()} for pose in PERSON]}],
    },
}


@pytest.mark.parametrize("form", TABLES)
def test_a_document_may_be_a_table_or_have_points_as_texts_and_matrices(read, form):
    content = json.dumps(TABLES[form])
    assert landmarks_json.matches(content.encode())
    [clip] = read(landmarks_json, content)
    assert_reads(clip, step=1 / 30)


@pytest.mark.parametrize(
    "document",
    [
        {"fps": 60, "frames": [named(pose, JOINTS) for pose in PERSON.tolist()]},
        {"clip_fps": 60, "frames": [named(pose, JOINTS) for pose in PERSON.tolist()]},
        {"ticksPerSecond": 60, "frames": [named(pose, JOINTS) for pose in PERSON.tolist()]},
        {"header": {"Frame Rate": 60}, "data": PERSON.reshape(len(PERSON), -1).tolist()},
        {"sampleRate": 60.0, "frames": [named(pose, "xyz") for pose in PERSON.swapaxes(1, 2).tolist()]},
        {
            "frame_rate": 60,
            "frames": [
                {"bodies": [{"joint_orientations": [[1, 0, 0, 0]] * 20, "joint_positions": pose}]}
                for pose in PERSON.tolist()
            ],
        },
    ],
)
def test_a_document_states_its_rate_and_may_have_orientations_or_axes_apart(read, document):
    [clip] = read(landmarks_json, json.dumps(document))
    assert_reads(clip, step=1 / 60)
    assert clip.notes[0] == "The file states 60 frames per second."
    [clip] = read(landmarks_json, json.dumps(document), fps=10.0)
    assert_reads(clip, step=1 / 10)


def test_the_longest_of_several_samples_is_read(read):
    frames = [{"values": pose} for pose in person(40).reshape(40, -1).tolist()]
    [clip] = read(landmarks_json, json.dumps({"samples": [{"frames": frames[: 40 - k]} for k in range(3)]}))
    assert_reads(clip, person(40))
    assert clip.notes[0] == "The file has 3 recordings. The longest one is read."


@pytest.mark.parametrize(("size", "joint_set"), [(3, "kinect_v1"), (4, "nite")])
def test_the_person_tells_how_many_numbers_a_point_has(read, size, joint_set):
    points = np.pad(joints_as(JOINT_SETS[joint_set]), ((0, 0), (0, 0), (0, size - 3)), constant_values=0.9)
    [clip] = read(landmarks_json, json.dumps(points.reshape(4, -1).tolist()))
    assert_reads(clip, joints=both("elbow", "knee"))
    assert any("assumed" in note and "30" in note for note in clip.notes)


def test_people_are_clips(read):
    other = PERSON + np.array([1.0, 0, 0])
    people = [
        [{"id": k, "pose": pose} for k, pose in ((3, a), (5, b))]
        for a, b in zip(PERSON.tolist(), other.tolist(), strict=True)
    ]
    clips = read(landmarks_json, json.dumps({"frames": [{"people": each} for each in people]}))
    assert [clip.user for clip in clips] == [3, 5]
    for clip, poses in zip(clips, (PERSON, other), strict=True):
        assert_reads(clip, poses)


@pytest.mark.parametrize("form", ["objects", "world"])
def test_a_document_may_be_one_frame(read, form):
    content = json.dumps(FORMS[form][0], indent=1)
    assert landmarks_json.matches(content.encode())
    [clip] = read(landmarks_json, content)
    assert_reads(clip, PERSON[:1], LIMBS)


def test_names_may_have_their_points_over_time(read):
    paths = {name: {"translation": POINTS[:, k].tolist()} for k, name in enumerate(BLAZEPOSE)}
    [clip] = read(landmarks_json, json.dumps({"time": [t / 50 for t in FRAMES], "bodies": paths}))
    assert_reads(clip, joints=LIMBS, step=1 / 50)


WRISTS = {"names": "right_wrist", "lists": BLAZEPOSE.index("right_wrist")}
LOST = [[np.nan] * 3, [None] * 3, None]


@pytest.mark.parametrize(("form", "lost"), [*((form, lost) for form in WRISTS for lost in LOST), ("names", "absent")])
def test_points_without_numbers_are_lost(read, form, lost):
    poses = json.loads(json.dumps(FORMS[form]))
    expected = PERSON.copy()
    for frame in (0, 2):
        poses[frame][WRISTS[form]] = lost
        if lost == "absent":
            del poses[frame][WRISTS[form]]
        expected[frame, JOINT_INDEX["wrist_right"]] = np.nan
    [clip] = read(landmarks_json, json.dumps(poses))
    assert_reads(clip, expected, LIMBS)


def test_a_pose_in_an_image_replaces_none_in_space(read):
    frames = json.loads(json.dumps(FORMS["world"]))
    frames[2]["pose_world_landmarks"] = []
    [clip] = read(landmarks_json, json.dumps(frames))
    kept = [0, 1, 3]
    assert_allclose(clip.times, np.array(kept) / 30)
    assert_reads(clip, PERSON[kept], LIMBS)


def test_numbers_of_some_joints_are_those_of_the_order_that_gives_a_person(read):
    points = joints_as(JOINT_SETS["body_25"])[:, :9]  # to the middle of the hips
    points[:, [0, 8]] = PERSON[:, [JOINT_INDEX["head"], JOINT_INDEX["hip_center"]]]
    frames = [
        {**{str(k): point for k, point in enumerate(pose)}, "timestamp": f"15:48:{second:04.1f}"}
        for pose, second in zip(points.tolist(), (48, 48.2, 48.7), strict=False)
    ]
    [clip] = read(landmarks_json, "\n".join(map(repr, frames)))
    assert_reads(clip, PERSON[:3], both("elbow", "wrist"))
    assert np.isnan(clip.positions[:, both("knee")]).all()
    assert_allclose(clip.times, [0, 0.2, 0.7], atol=1e-6)


PLANE, SPACE = [[float(k), k / 3] for k in range(21)], [[float(k), k / 3, k * k / 7] for k in range(21)]
LETTERS = "abcdefghijklmnopqrstu"
COCO = 900 * joints_as(JOINT_SETS["coco"])[:, ::-1] + [960, 540, 0]  # in an unknown order
COCO[:, :4] = 0  # lost
COCO[..., 2] = np.random.default_rng(0).uniform(0, 1, COCO.shape[:2])  # a score


@pytest.mark.parametrize(
    ("document", "found"),
    [
        ([{"hand": SPACE}] * 3, "21 points, as a hand has"),
        ({"0": [[k, k + 0.5, k * k] for k in range(478)]}, "478 points, as a face has"),
        ([{"hand_xy": named(PLANE, LETTERS)}] * 3, "positions in an image"),
        ([{"frame": k, "keypoints": pose} for k, pose in enumerate(COCO.tolist())], "positions in an image (2D)"),
        ({"frames": [[{"x": 1.5, "y": 2.5, "score": 0.5}] * 17] * 3}, "positions in an image"),
        ({"people": [{"pose_keypoints_2d": [0.5] * 75}]}, "positions in an image"),
        ({"train": [{"points": list(range(34)), "label": 2}] * 3}, "positions in an image"),
        ([{"roll": 1.5, "accX": [1, 2, 3]}] * 9, ", a list of 9 with the keys roll, accX, without positions in space"),
        ({"Frames": [[0.5, -0.5] * 22] * 3}, "without positions in space"),  # rotations
        ({"poses": [{"base": [0, 0, 1], "joints": {"hip": 0.5}}]}, "keys poses, without positions in space"),
        ([{"frame": 1, "knee_angle": 177, "elbow_angle": [1, 2, 3]}] * 9, "without positions in space: angles"),
        ({"left_elbow": "x"}, "left_elbow"),
        ({"root": {"elbow": [1, 2]}, "pose": []}, "root, pose"),
        # as many as Human3.6M's joints
        (
            {"landmarks": elements([[1.0, 2.0, 3.0]] * 17, names=[f"antenna {each}" for each in LETTERS[:17]])},
            "among antenna a, antenna b",
        ),
        ([], ""),
        ([[{"x": 1, "y": 2, "score": 1}] * 17], ""),
        ([[[0.0, 0.0, 0.0]] * 33], ""),
        ([[[10**400, 0.0, 0.0]] * 33], ""),
        ({"shoulder": {"deep": [[[[[[1]]]]]]}}, ""),
    ],
)
def test_a_document_without_a_person_is_called_what_it_has(read, tmp_path, document, found):
    with pytest.raises(SkeletonLogError) as caught:
        read(landmarks_json, json.dumps(document))
    assert caught.value.where == str(tmp_path / "take")
    assert found in caught.value.found


@pytest.mark.parametrize("rest", ['"nodes": [{"translation": [0, 1, 2]}]', '"skins": [{"index": 3, "matrix": [1, 0]}]'])
def test_a_character_of_json_is_no_recording(rest):
    assert not landmarks_json.matches(f'{{"asset": {{"version": "2.0"}}, {rest}}}'.encode())


META = {
    "Hips": "hip_center",
    "SpineLower": "spine",
    "Neck": "shoulder_center",
    "Head": "head",
    "LeftArmUpper": "shoulder_left",
    "LeftArmLower": "elbow_left",
    "LeftHandWrist": "wrist_left",
    "LeftHandMiddleProximal": "hand_left",
    "LeftPalm": "hand_left",
    "LeftUpperLeg": "hip_left",
    "LeftLowerLeg": "knee_left",
    "LeftFootAnkle": "ankle_left",
    "LeftFootBall": "foot_left",
}
META |= {name.replace("Left", "Right"): joint.replace("left", "right") for name, joint in META.items()}


def quest():
    """Return the positions of Meta Quest's body by the names of its joints; those that are not used are elsewhere."""
    points = {}
    for index, name in enumerate(JOINT_SETS["quest_84"]):
        *words, side = name.split("_") if name.endswith(("left", "right")) else (*name.split("_"), "")
        own = "".join(word.title() for word in (side, *words)).replace("FootAnkleTwist", "AnkleTwist")
        own = own.replace("Wrist", "HandWrist").replace("Middle", "HandMiddle").replace("SpineHand", "Spine")
        points[own] = PERSON[:, JOINT_INDEX[META.get(own, "spine")]] + 0.001 * index * (own not in META)
    assert points.keys() >= META.keys()
    return points


def open_xr(name):
    return f"XR_BODY_JOINT_{re.sub('(?<=[a-z])(?=[A-Z])', '_', name).upper()}_FB"


HEADSET = re.compile(
    "(Left|Right)?(Hips|SpineMiddle|Chest|Neck|Head|Shoulder|Arm(Upp|Low)er|HandWrist|(Upp|Low)erLeg|FootAnkle)"
)
QUEST_FORMS = {
    "bones by identity": lambda names, pose, t: {
        "time": t / 72,
        "bones": [{"id": f"Body_{name}", "pos": point} for name, point in zip(names, x_y_z(pose), strict=True)][::-1],
    },
    "bones by number": lambda _, pose, t: {
        "time": t / 72,
        "bones": [{"id": number, "pos": point} for number, point in enumerate(x_y_z(pose))][::-1],
    },
    "names of OpenXR": lambda names, pose, _: {
        "joints": {open_xr(name): {"position": point} for name, point in named(pose, names).items()}
    },
    "array": lambda _, pose, __: pose,
    "some names": lambda names, pose, _: {
        "joints": [
            {"name": f"FullBody_{name}", "pose": {"position": point}}
            for name, point in zip(names, x_y_z(pose), strict=True)
            if HEADSET.fullmatch(name)
        ]
    },
}


@pytest.mark.parametrize("count", [70, 84])
@pytest.mark.parametrize("form", QUEST_FORMS)
def test_meta_quests_body_is_read_with_names_or_numbers(read, form, count):
    points = dict(list(quest().items())[:count])
    poses = np.stack([*points.values()], axis=1).tolist()
    [clip] = read(landmarks_json, json.dumps([QUEST_FORMS[form](points, pose, t) for t, pose in enumerate(poses)]))
    seen = [META[name] for name in points if name in META and (form != "some names" or HEADSET.fullmatch(name))]
    seen = [JOINT_INDEX[joint] for joint in seen]
    assert_reads(clip, joints=seen)
    assert (np.delete(clip.confidence, [*seen, JOINT_INDEX["spine"]], axis=1) < 1).all()


def test_names_that_tell_nothing_do_not_matter_if_their_number_gives_a_person(read):
    """As in programs whose enumerations have several names for a number, and print another one."""
    poses = np.stack([*quest().values()], axis=1)
    frames = [{"joints": elements(pose, names=[f"b {k}" for k in range(84)])} for pose in poses.tolist()]
    [clip] = read(landmarks_json, json.dumps(frames))
    assert_reads(clip, joints=[JOINT_INDEX[joint] for joint in META.values()])


def test_a_pose_with_known_names_comes_before_as_many_points_of_a_hand(read):
    poses = [dict(zip(JOINTS, pose, strict=True)) for pose in PERSON.tolist()]
    hand = elements(np.zeros((21, 3)).tolist(), names=[f"thumb_{k}" for k in range(21)])
    [clip] = read(landmarks_json, json.dumps([{"hand": hand, "body": pose} for pose in poses]))
    assert_reads(clip)


def test_lists_with_symbols_are_no_document():
    assert not landmarks_json.matches(b"[\n[\\l_elbow, 0.1, 0.2, 0.3],\n")
    assert not landmarks_json.matches(b"[[:l_elbow, 0.1, 0.2, 0.3],\n")


def test_each_entry_of_a_list_may_be_a_person_with_a_number_and_a_time(read):
    joints = [[{"cameraX": x, "cameraY": y, "cameraZ": z, "depthX": 0.5} for x, y, z in pose] for pose in PERSON]
    bodies = [
        {"bodyIndex": user, "trackingId": str(70 + user), "joints": pose, "record_timestamp": 1000 + 40 * k}
        for k, pose in enumerate(joints)
        for user in (0, 1)
    ]
    content = json.dumps(bodies)
    assert not kinect_v2_json.matches(content.encode())
    assert landmarks_json.matches(content.encode())
    clips = read(landmarks_json, content)
    assert [clip.user for clip in clips] == [70, 71]
    for clip in clips:
        assert_reads(clip, step=1 / 25)
