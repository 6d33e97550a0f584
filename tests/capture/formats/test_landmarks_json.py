"""JSON of trackers is read in the forms in which programs write it."""

import json
import re

import numpy as np
import pytest

from capture.formats import landmarks_json
from capture.formats.layouts import JOINT_SETS
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

from .test_positions import BLAZEPOSE, joints_as, person

POINTS = joints_as(BLAZEPOSE)
ARMS = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("elbow", "wrist", "knee") for side in ("left", "right")]


def listed(pose):
    return [list(point) for point in pose]


def objects(pose):
    return [dict(zip("xyz", point, strict=True), visibility=0.9) for point in pose]


FORMS = {
    "names": lambda pose: dict(zip(BLAZEPOSE, listed(pose), strict=True)),
    "named objects": lambda pose: [{"name": name, **each} for name, each in zip(BLAZEPOSE, objects(pose), strict=True)],
    "objects": lambda pose: {"landmarks2d": [{"x": 1, "y": 2}] * 33, "landmarks": objects(pose), "time": 0.04},
    "world": lambda pose: {"pose_landmarks": listed(pose * [1, 2, 3]), "pose_world_landmarks": listed(pose)},
    "texts": lambda pose: [dict(zip("xyz", map(str, point), strict=True)) for point in listed(pose)],
    "camera": lambda pose: [
        {"joint": name, "cameraX": x, "cameraY": y, "cameraZ": z, "depthX": 7, "depthY": 8}
        for name, (x, y, z) in zip(BLAZEPOSE, listed(pose), strict=True)
    ],
    "numbers of joints": lambda pose: {str(index): point for index, point in reversed([*enumerate(listed(pose))])},
    "poses": lambda pose: [
        {"name": name, "pose": {"position": dict(zip("xyz", point, strict=True)), "rotation": {"w": 1, "x": 0, "y": 0}}}
        for name, point in zip(BLAZEPOSE, listed(pose), strict=True)
    ],
    "lists": listed,
    "numbers": lambda pose: {"people": [{"pose_keypoints_3d": [float(each) for each in pose.ravel()]}]},
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("frames", ["list", "numbers", "key"])
def test_forms_of_frames_and_poses(read, form, frames):
    poses = [FORMS[form](pose) for pose in POINTS]
    for index, pose in enumerate(poses):
        if isinstance(pose, dict) and "time" in pose:
            pose["time"] = index / 25
    document = {
        "list": poses,
        "numbers": {"positions": {f"{index}.0": pose for index, pose in enumerate(poses)}},
        "key": {"fps": 30, "frames": poses},
    }[frames]
    content = json.dumps(document)
    assert landmarks_json.matches(content.encode())
    [clip] = read(landmarks_json, content)
    np.testing.assert_allclose(clip.positions[:, ARMS], person()[:, ARMS], atol=1e-9)
    assert np.diff(clip.times) == pytest.approx(1 / 25 if form == "objects" else 1 / 30)


@pytest.mark.parametrize(("size", "joint_set"), [(3, "kinect_v1"), (4, "nite")])
def test_the_person_tells_how_many_numbers_a_point_has(read, size, joint_set):
    points = np.pad(joints_as(JOINT_SETS[joint_set]), ((0, 0), (0, 0), (0, size - 3)), constant_values=0.9)
    [clip] = read(landmarks_json, json.dumps([pose.ravel().tolist() for pose in points]))
    bent = [joint for joint in ARMS if not JOINTS[joint].startswith("wrist")]
    np.testing.assert_allclose(clip.positions[:, bent], person()[:, bent], atol=1e-9)
    assert any("assumed" in note and "30" in note for note in clip.notes)


def test_people_are_clips(read):
    people = [
        [{"id": 3, "pose": listed(pose)}, {"id": 5, "pose": listed(pose + np.array([1.0, 0, 0]))}] for pose in POINTS
    ]
    one, other = read(landmarks_json, json.dumps({"frames": [{"people": each} for each in people]}))
    assert (one.user, other.user) == (3, 5)
    np.testing.assert_allclose(other.positions[..., 0] - one.positions[..., 0], 1, atol=1e-9)


@pytest.mark.parametrize(
    "document",
    [
        [],
        {"people": [{"pose_keypoints_2d": [1.0] * 75}]},
        [[{"x": 1, "y": 2, "score": 1}] * 17],
        [[[0.0, 0.0, 0.0]] * len(JOINT_SETS["mediapipe"])],
        [[[10**400, 0.0, 0.0]] * len(JOINT_SETS["mediapipe"])],
        {"shoulder": {"deep": [[[[[[1]]]]]]}},
    ],
)
def test_other_documents_are_refused(refused_at, document):
    assert refused_at(landmarks_json, json.dumps(document)) == ""


def test_points_with_a_score_are_those_of_an_image(tmp_path):
    picture = 900 * joints_as(JOINT_SETS["coco"])[:, ::-1, :2] + [960, 540]  # in an unknown order
    picture[:, :4] = 0  # lost
    score = np.random.default_rng(0).uniform(0, 1, (*picture.shape[:2], 1))
    document = [{"frame": index, "keypoints": each.tolist()} for index, each in enumerate(np.dstack([picture, score]))]
    path = tmp_path / "a.json"
    path.write_text(json.dumps(document))
    with pytest.raises(SkeletonLogError, match=r"positions in an image \(2D\)"):
        landmarks_json.read(path, ReadOptions())


def test_a_document_may_be_one_pose(read):
    content = json.dumps(objects(POINTS[0]), indent=1)
    assert landmarks_json.matches(content.encode())
    [clip] = read(landmarks_json, content)
    assert clip.positions.shape == (1, len(JOINTS), 3)


def test_names_may_have_their_points_over_time(read):
    times = np.arange(len(POINTS)) / 50
    paths = {name: {"translation": POINTS[:, index].tolist()} for index, name in enumerate(BLAZEPOSE)}
    [clip] = read(landmarks_json, json.dumps({"time": times.tolist(), "bodies": paths}))
    np.testing.assert_allclose(clip.positions[:, ARMS], person()[:, ARMS], atol=1e-9)
    np.testing.assert_allclose(clip.times, times)


@pytest.mark.parametrize("document", [{"left_elbow": "x"}, {"root": {"elbow": [1, 2]}, "pose": []}])
def test_the_keys_tell_what_a_document_is(read, document):
    with pytest.raises(SkeletonLogError) as caught:
        read(landmarks_json, json.dumps(document))
    assert ", ".join(document) in caught.value.found


@pytest.mark.parametrize("form", ["names", "lists"])
def test_poses_may_have_the_names_of_pictures(read, form):
    poses = {f"./picture{index}.png": FORMS[form](pose) for index, pose in enumerate(POINTS)}
    [clip] = read(landmarks_json, json.dumps(poses))
    np.testing.assert_allclose(clip.positions[:, ARMS], person()[:, ARMS], atol=1e-9)


def test_a_document_may_be_one_frame(read):
    [clip] = read(landmarks_json, json.dumps(FORMS["world"](POINTS[0])))
    np.testing.assert_allclose(clip.positions[0, ARMS], person()[0, ARMS], atol=1e-9)


WRIST = BLAZEPOSE.index("right_wrist")


@pytest.mark.parametrize("lost", [[np.nan] * 3, [None] * 3, None])
@pytest.mark.parametrize("is_named", [True, False])
def test_points_without_numbers_are_lost(read, lost, is_named):
    poses = [listed(pose) for pose in POINTS]
    poses[2][WRIST] = lost
    named = [dict(zip(BLAZEPOSE, pose, strict=True)) for pose in poses]
    [clip] = read(landmarks_json, json.dumps(named if is_named else poses))
    [whole] = read(landmarks_json, json.dumps([listed(pose) for pose in POINTS]))
    expected = whole.positions.copy()
    expected[2, JOINT_INDEX["wrist_right"]] = np.nan
    np.testing.assert_allclose(clip.positions[:, ARMS], expected[:, ARMS], atol=1e-9)


def test_names_that_a_frame_lacks_are_lost_there(read):
    poses = [FORMS["names"](pose) for pose in POINTS]
    for frame in (0, 2):
        del poses[frame]["right_wrist"]
    [clip] = read(landmarks_json, json.dumps(poses))
    lost = np.isnan(clip.positions[:, JOINT_INDEX["wrist_right"]]).any(axis=1)
    assert lost.tolist() == [True, False, True, False]
    whole = [joint for joint in ARMS if joint != JOINT_INDEX["wrist_right"]]
    np.testing.assert_allclose(clip.positions[:, whole], person()[:, whole], atol=1e-9)


@pytest.mark.parametrize("samples", [1, 3])
def test_frames_may_be_within_samples_as_rows_of_numbers(read, samples):
    frames = [{"jointCount": len(JOINTS), "values": pose.ravel().tolist()} for pose in person(40)]
    document = {"name": "wave", "samples": [{"rate": 15, "frames": frames[: 40 - k]} for k in range(samples)]}
    content = json.dumps(document)
    assert landmarks_json.matches(content.encode())
    [clip] = read(landmarks_json, content)
    np.testing.assert_allclose(clip.positions, person(40), atol=1e-9)


def test_points_whose_names_are_no_persons_are_refused_by_them(read):
    names = [f"antenna {letter}" for letter in "abcdefghijklmnopq"]  # as many as Human3.6M's joints
    document = [{"name": name, "position": [1.0, 2.0, 3.0]} for name in names]
    with pytest.raises(SkeletonLogError, match=r"shoulder_left.* among antenna a, antenna b"):
        read(landmarks_json, json.dumps({"landmarks": document}))


def test_a_pose_in_an_image_replaces_none_in_space(read):
    frames = [FORMS["world"](pose) for pose in POINTS]
    frames[2]["pose_world_landmarks"] = []
    [clip] = read(landmarks_json, json.dumps(frames))
    kept = [0, 1, 3]
    np.testing.assert_allclose(clip.times, np.array(kept) / 30)
    np.testing.assert_allclose(clip.positions[:, ARMS], person()[kept][:, ARMS], atol=1e-9)


def test_numbers_of_some_joints_are_those_of_the_order_that_gives_a_person(read):
    points = joints_as(JOINT_SETS["body_25"])[:, :9]  # to the middle of the hips
    points[:, [0, 8]] = person()[:, [JOINT_INDEX["head"], JOINT_INDEX["hip_center"]]]
    frames = [
        {**{str(index): list(point) for index, point in enumerate(pose)}, "timestamp": f"15:48:{second:04.1f}"}
        for pose, second in zip(points, (48, 48.2, 48.7), strict=False)
    ]
    [clip] = read(landmarks_json, "\n".join(map(repr, frames)))
    arms = [joint for joint in ARMS if not JOINTS[joint].startswith("knee")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:3, arms], atol=1e-9)
    assert np.isnan(clip.positions[:, JOINT_INDEX["knee_left"]]).all()
    np.testing.assert_allclose(clip.times, [0, 0.2, 0.7], atol=1e-6)


PLANE, SPACE = [[float(k), k / 3] for k in range(21)], [[float(k), k / 3, k * k / 7] for k in range(21)]


@pytest.mark.parametrize(
    ("document", "found"),
    [
        ([{"hand": SPACE}] * 3, "21 points, as a hand has"),
        ({"0": [[k, k + 0.5, k * k] for k in range(478)]}, "478 points, as a face has"),
        ([{"hand_xy": dict(zip("abcdefghijklmnopqrstu", PLANE, strict=True))}] * 3, "positions in an image"),
        ({"frames": [[{"x": 1.5, "y": 2.5, "score": 0.5}] * 17] * 3}, "positions in an image"),
        ({"people": [{"pose_keypoints_2d": [0.5] * 75}]}, "positions in an image"),
        ({"train": [{"points": list(range(34)), "label": 2}] * 3}, "positions in an image"),
        ([{"roll": 1.5, "accX": [1, 2, 3]}] * 9, ", a list of 9 with the keys roll, accX, without positions in space"),
        ({"poses": [{"base": [0, 0, 1], "joints": {"hip": 0.5}}]}, "keys poses, without positions in space"),
        ([{"frame": 1, "knee_angle": 177, "elbow_angle": [1, 2, 3]}] * 9, "without positions in space: angles"),
    ],
)
def test_a_document_without_a_person_is_called_what_it_has(read, document, found):
    with pytest.raises(SkeletonLogError) as caught:
        read(landmarks_json, json.dumps(document))
    assert found in caught.value.found


@pytest.mark.parametrize("rest", ['"nodes": [{"translation": [0, 1, 2]}]', '"skins": [{"index": 3, "matrix": [1, 0]}]'])
def test_a_character_of_json_is_no_recording(rest):
    assert not landmarks_json.matches(f'{{"asset": {{"version": "2.0"}}, {rest}}}'.encode())


QUEST = (
    "Hips SpineMiddle Chest Neck Head LeftShoulder LeftArmUpper LeftArmLower LeftHandWrist RightShoulder RightArmUpper "
    "RightArmLower RightHandWrist LeftUpperLeg LeftLowerLeg LeftFootAnkle RightUpperLeg RightLowerLeg RightFootAnkle"
)
QUEST_JOINTS = [
    *("hip_center", "spine", "spine", "shoulder_center", "head"),
    *("shoulder_center", "shoulder_left", "elbow_left", "wrist_left"),
    *("shoulder_center", "shoulder_right", "elbow_right", "wrist_right"),
    *(f"{joint}_{side}" for side in ("left", "right") for joint in ("hip", "knee", "ankle")),
]


def test_headsets_name_joints_after_the_whole_body(read):
    frames = [
        {"joints": [{"name": f"FullBody_{name}", "pose": {"position": dict(zip("xyz", pose[joint], strict=True))}}
                    for name, joint in zip(QUEST.split(), map(JOINT_INDEX.get, QUEST_JOINTS), strict=True)]}
        for pose in person().tolist()
    ]  # fmt: skip
    [clip] = read(landmarks_json, json.dumps(frames))
    ends = [*ARMS, *(JOINT_INDEX[f"ankle_{side}"] for side in ("left", "right"))]
    np.testing.assert_allclose(clip.positions[:, ends], person()[:, ends], atol=1e-9)


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
    poses, points = person(), {}
    for index, name in enumerate(JOINT_SETS["quest_84"]):
        *words, side = name.split("_") if name.endswith(("left", "right")) else (*name.split("_"), "")
        own = "".join(word.title() for word in (side, *words)).replace("FootAnkleTwist", "AnkleTwist")
        own = own.replace("Wrist", "HandWrist").replace("Middle", "HandMiddle").replace("SpineHand", "Spine")
        points[own] = poses[:, JOINT_INDEX[META.get(own, "spine")]] + 0.001 * index * (own not in META)
    assert points.keys() >= META.keys()
    return points


@pytest.mark.parametrize("count", [70, 84])
@pytest.mark.parametrize("form", ["bones by identity", "bones by number", "names of OpenXR", "array"])
def test_meta_quests_body_is_read_with_names_or_numbers(read, form, count):
    points = dict(list(quest().items())[:count])
    frames = []
    for index in range(len(person())):
        own = [(name, place[index].tolist()) for name, place in points.items()]
        if form == "names of OpenXR":
            upper = [(re.sub("(?<=[a-z])(?=[A-Z])", "_", name).upper(), place) for name, place in own]
            frames.append({"joints": {f"XR_BODY_JOINT_{name}_FB": {"position": place} for name, place in upper}})
        elif form == "array":
            frames.append([place for _, place in own])
        else:
            ids = [f"Body_{name}" if form == "bones by identity" else k for k, (name, _) in enumerate(own)]
            bones = [
                {"id": each, "pos": dict(zip("xyz", p, strict=True))} for each, (_, p) in zip(ids, own, strict=True)
            ]
            frames.append({"time": index / 72, "bones": bones[::-1]})
    [clip] = read(landmarks_json, json.dumps(frames))
    seen = [JOINT_INDEX[joint] for name, joint in META.items() if name in points]
    np.testing.assert_allclose(clip.positions[:, seen], person()[:, seen], atol=1e-9)
    assert (clip.confidence[:, [k for k in range(20) if k not in seen]] < 1).all()


def matrix(point, *, by_columns):
    axes = np.eye(4)
    axes[:3, 3] = point
    return (axes.T if by_columns else axes).tolist()


COLUMNS = {
    f"{joint}_{axis}": person()[:, k, a].tolist() for k, joint in enumerate(JOINTS) for a, axis in enumerate("xyz")
}
FRAMES = range(len(person()))


@pytest.mark.parametrize(
    "document",
    [
        [{"time": t / 30, **{name: values[t] for name, values in COLUMNS.items()}} for t in FRAMES],
        {"data": [{"frame": t, **{name: values[t] for name, values in COLUMNS.items()}} for t in FRAMES]},
        COLUMNS,
        {name: {str(t): values[t] for t in FRAMES} for name, values in COLUMNS.items()},
        {joint: {axis: COLUMNS[f"{joint}_{axis}"] for axis in "xyz"} for joint in JOINTS},
        {"tracks": [{"name": joint, "positions": person()[:, k].tolist()} for k, joint in enumerate(JOINTS)]},
        [
            {joint: "({}, {}, {})".format(*point) for joint, point in zip(JOINTS, pose, strict=True)}
            for pose in person()
        ],
        *(
            [
                {
                    "joints": [
                        {"name": joint, "transform": matrix(point, by_columns=by_columns)}
                        for joint, point in zip(JOINTS, pose, strict=True)
                    ]
                }
                for pose in person()
            ]
            for by_columns in (False, True)
        ),
        [
            {
                joint: {"modelTransform": {"columns": matrix(point, by_columns=True)}}
                for joint, point in zip(JOINTS, pose, strict=True)
            }
            for pose in person()
        ],
        [
            {
                joint: [value for row in matrix(point, by_columns=True) for value in row]
                for joint, point in zip(JOINTS, pose, strict=True)
            }
            for pose in person()
        ],
    ],
)
def test_a_document_may_be_a_table_or_have_points_as_texts_and_matrices(read, document):
    content = json.dumps(document).encode()
    assert landmarks_json.matches(content)
    [clip] = read(landmarks_json, content)
    np.testing.assert_allclose(clip.positions, person(), atol=1e-9)
    np.testing.assert_allclose(clip.times - clip.times[0], np.arange(len(person())) / 30, atol=1e-9)


@pytest.mark.parametrize(
    "document",
    [
        {"fps": 60, "frames": [dict(zip(JOINTS, pose.tolist(), strict=True)) for pose in person()]},
        {"header": {"Frame Rate": 60}, "data": person().reshape(len(person()), -1).tolist()},
        {"sampleRate": 60.0, "frames": [dict(zip("xyz", pose.T.tolist(), strict=True)) for pose in person()]},
        {
            "frame_rate": 60,
            "frames": [
                {"bodies": [{"joint_orientations": [[1, 0, 0, 0]] * 20, "joint_positions": pose.tolist()}]}
                for pose in person()
            ],
        },
    ],
)
def test_a_document_states_its_rate_and_may_have_orientations_or_axes_apart(read, document):
    [clip] = read(landmarks_json, json.dumps(document))
    np.testing.assert_allclose(clip.positions, person(), atol=1e-9)
    np.testing.assert_allclose(clip.times, np.arange(len(person())) / 60)
    assert clip.notes[0] == "The file states 60 frames per second."
    [clip] = read(landmarks_json, json.dumps(document), fps=10.0)
    np.testing.assert_allclose(clip.times, np.arange(len(person())) / 10)
