import json
from pathlib import Path

import numpy as np
import pytest

from capture.formats import azure_json
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX

from .conftest import assert_refused
from .conftest import changed as changed_document

JOINTS32 = """
PELVIS SPINE_NAVEL SPINE_CHEST NECK
CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT HANDTIP_LEFT THUMB_LEFT
CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT HANDTIP_RIGHT THUMB_RIGHT
HIP_LEFT KNEE_LEFT ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT FOOT_RIGHT
HEAD NOSE EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT
"""
NAMES = JOINTS32.split()
MIDDLE = {"PELVIS": "hip_center", "SPINE_NAVEL": "spine", "NECK": "shoulder_center", "HEAD": "head"}
LEFT = [name for name in NAMES if name.endswith("_LEFT") and name.lower() in JOINT_INDEX]


def millimetres(name: str, frame: int = 0) -> list[float]:
    """Return a joint's position for a performer 2 m away who faces the camera: right side at −x, y down."""
    side = {"LEFT": 1, "RIGHT": -1}.get(name.rpartition("_")[2], 0)
    return [250.0 * side, -900.0 + 10 * NAMES.index(name), 2000.0 + frame]


def body(user: int = 1, frame: int = 0, **more: object) -> dict[str, object]:
    return {
        "body_id": user,
        "joint_positions": [millimetres(name, frame) for name in NAMES],
        "joint_orientations": [[1, 0, 0, 0]] * 32,
        **more,
    }


def document(*frames: list[dict[str, object]]) -> dict[str, object]:
    return {
        "k4abt_sdk_version": "1.1.2",
        "source_file": "take.mkv",
        "joint_names": NAMES,
        "bone_list": [["SPINE_CHEST", "SPINE_NAVEL"]],
        "frames": [
            {"timestamp_usec": 200_000 + 33_333 * index, "frame_id": index, "num_bodies": len(bodies), "bodies": bodies}
            for index, bodies in enumerate(frames)
        ],
    }


def write(folder: Path, content: object) -> Path:
    path = folder / "take.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_the_right_side_of_someone_facing_the_camera_is_at_positive_x(tmp_path: Path) -> None:
    (clip,) = azure_json.read(write(tmp_path, document([body()])), ReadOptions())
    for name in NAMES:
        ours = MIDDLE.get(name, name.lower())
        if ours in JOINT_INDEX:
            x, y, z = millimetres(name)
            np.testing.assert_allclose(clip.positions[0, JOINT_INDEX[ours]], [-x / 1000, -y / 1000, z / 1000])
    assert clip.positions[0, JOINT_INDEX["hand_right"], 0] == 0.25
    assert clip.positions[0, JOINT_INDEX["hip_center"], 1] == 0.9
    assert len(LEFT) == 8
    assert (clip.confidence == 1).all()


def test_each_body_id_is_a_clip_on_the_recordings_clock(tmp_path: Path) -> None:
    frames = document([body(1, 0)], [], [body(2, 2), body(1, 2)])
    one, two = azure_json.read(write(tmp_path, frames), ReadOptions(fps=5))
    assert (one.user, two.user) == (1, 2)
    np.testing.assert_allclose(one.times, [0.2, 0.266666])
    np.testing.assert_allclose(two.times, [0.266666])
    np.testing.assert_allclose(one.positions[:, 0, 2], [2.0, 2.002])


@pytest.mark.parametrize("wrapped", [False, True])
def test_tracking_states_become_confidences(tmp_path: Path, wrapped: bool) -> None:
    levels = [2] * 32
    for level, name in enumerate(("HAND_LEFT", "HAND_RIGHT", "FOOT_LEFT", "FOOT_RIGHT")):
        levels[NAMES.index(name)] = level
    written = [[level] for level in levels] if wrapped else levels
    (clip,) = azure_json.read(write(tmp_path, document([body(joint_confidence=written)])), ReadOptions())
    found = [clip.confidence[0, JOINT_INDEX[name]] for name in ("hand_left", "hand_right", "foot_left", "foot_right")]
    assert found == [0, 0.5, 1, 1]
    assert np.isnan(clip.positions[0, JOINT_INDEX["hand_left"]]).all()


def changed(*path: object, value: object) -> object:
    return changed_document(document([body()], [body(2), body(3)]), *path, value=value)


SECOND = ("frames", 1, "bodies", 1)


@pytest.mark.parametrize(
    ("content", "place", "message"),
    [
        (changed(*SECOND, "joint_positions", 3, value=[1, 2]), "frames[1].bodies[1].joint_positions[3]", "2 numbers"),
        (changed(*SECOND, "joint_positions", 3, 1, value="a"), "frames[1].bodies[1].joint_positions[3][1]", '"a"'),
        (changed(*SECOND, "joint_positions", value=[[1, 2, 3]] * 25), "bodies[1].joint_positions", "25 joints"),
        (changed(*SECOND, "joint_positions", value=None), "frames[1].bodies[1]", "no 'joint_positions'"),
        (changed(*SECOND, "body_id", value=-1), "frames[1].bodies[1].body_id", "-1"),
        (changed(*SECOND, "joint_confidence", value=[2] * 31), "bodies[1].joint_confidence", "31 values"),
        (changed(*SECOND, "joint_confidence", value=[2] * 31 + [4]), "joint_confidence[31]", "0 none, 1 low"),
        (changed("frames", 1, "num_bodies", value=3), "frames[1].num_bodies", "the length of bodies, 2"),
        (changed("frames", 1, "timestamp_usec", value=None), "frames[1]", "no 'timestamp_usec'"),
        (changed("frames", 1, "bodies", value={}), "frames[1].bodies", "a list"),
        (changed("frames", value=None), "top level", "no 'frames'"),
        ([1], "top level", "an object"),
        (document([], []), "take.json", "no frame with a tracked performer"),
        (document([body(joint_confidence=[0] * 32)]), "take.json", "no frame with a tracked performer"),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(
    tmp_path: Path, content: object, place: str, message: str
) -> None:
    assert_refused(azure_json, write(tmp_path, content), place, message)


def test_recognised_however_its_keys_are_ordered() -> None:
    content = document(*[[]] * 2000, [body()])
    assert azure_json.matches(json.dumps(content).encode()[:65536])
    assert azure_json.matches(json.dumps(content, indent=4, sort_keys=True).encode()[:65536])
