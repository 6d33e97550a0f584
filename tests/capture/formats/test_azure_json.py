import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.formats import azure_json
from capture.skeleton import JOINT_INDEX

from .conftest import changed, place_of

TEXT = """
PELVIS SPINE_NAVEL SPINE_CHEST NECK
CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT HANDTIP_LEFT THUMB_LEFT
CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT HANDTIP_RIGHT THUMB_RIGHT
HIP_LEFT KNEE_LEFT ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT FOOT_RIGHT
HEAD NOSE EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT
"""
NAMES = TEXT.split()
OURS = {"PELVIS": "hip_center", "SPINE_NAVEL": "spine", "NECK": "shoulder_center"}
OURS = {name: OURS.get(name, name.lower()) for name in NAMES}


def millimetres(name, frame=0):
    """Return a joint's position for a performer 2 m away who faces the camera: right side at −x, y down."""
    side = {"LEFT": 1, "RIGHT": -1}.get(name.rpartition("_")[2], 0)
    return [250.0 * side, -900.0 + 10 * NAMES.index(name), 2000.0 + frame]


def body(user=1, frame=0, levels=(2,) * 32):
    positions = [millimetres(name, frame) for name in NAMES]
    return {
        "body_id": user,
        "joint_positions": positions,
        "joint_confidence": list(levels),
        "joint_orientations": [[1, 0, 0, 0]] * 32,
    }


def document(*frames):
    return {
        "bone_list": [["SPINE_CHEST", "SPINE_NAVEL"]],
        "frames": [
            {"timestamp_usec": 200_000 + 33_333 * index, "num_bodies": len(bodies), "bodies": bodies}
            for index, bodies in enumerate(frames)
        ],
    }


def test_the_right_side_of_someone_facing_the_camera_is_at_positive_x(read):
    performer = body()
    del performer["joint_confidence"]
    (clip,) = read(azure_json, json.dumps(document([performer])))
    expected = {OURS[name]: np.array(millimetres(name)) * [-1e-3, -1e-3, 1e-3] for name in NAMES}
    for name, index in JOINT_INDEX.items():
        assert_allclose(clip.positions[0, index], expected[name])
    assert clip.positions[0, JOINT_INDEX["hand_right"], 0] == 0.25
    assert (clip.confidence == 1).all()


def test_each_body_id_is_a_clip_on_the_recordings_clock(read):
    one, two = read(azure_json, json.dumps(document([body(1, 0)], [], [body(2, 2), body(1, 2)])), fps=5)
    assert (one.user, two.user) == (1, 2)
    assert_allclose(one.times, [0.2, 0.266666])
    assert_allclose(two.times, [0.266666])
    assert_allclose(one.positions[:, 0, 2], [2.0, 2.002])


@pytest.mark.parametrize("wrapped", [False, True])
def test_tracking_states_become_confidences(read, wrapped):
    levels = [2] * 32
    sides = ("HAND_LEFT", "HAND_RIGHT", "FOOT_LEFT", "FOOT_RIGHT")
    for level, name in enumerate(sides):
        levels[NAMES.index(name)] = level
    written = [[level] for level in levels] if wrapped else levels
    (clip,) = read(azure_json, json.dumps(document([body(levels=written)])))
    assert [clip.confidence[0, JOINT_INDEX[OURS[name]]] for name in sides] == [0, 0.5, 1, 1]
    assert np.isnan(clip.positions[0, JOINT_INDEX["hand_left"]]).all()


SECOND = ("frames", 1, "bodies", 1)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ((*SECOND, "joint_positions", 3), [1, 2]),
        ((*SECOND, "joint_positions", 3, 1), "a"),
        ((*SECOND, "joint_positions"), [[1, 2, 3]] * 25),
        ((*SECOND, "joint_positions"), None),
        ((*SECOND, "body_id"), -1),
        ((*SECOND, "joint_confidence"), [2] * 31),
        ((*SECOND, "joint_confidence", 31), 4),
        (("frames", 1, "num_bodies"), 3),
        (("frames", 1, "timestamp_usec"), None),
        (("frames", 1, "bodies"), {}),
        (("frames",), None),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(refused_at, path, value):
    content = changed(document([body()], [body(2), body(3)]), path, value)
    assert refused_at(azure_json, json.dumps(content)) == place_of(path, value)


def test_recognised_however_its_keys_are_ordered():
    content = document(*[[]] * 2000, [body()])
    assert azure_json.matches(json.dumps(content).encode()[:65536])
    assert azure_json.matches(json.dumps(content, indent=4, sort_keys=True).encode()[:65536])
    assert not azure_json.matches(json.dumps(content["frames"]).encode()[:65536])
