"""Foreign skeletons in Godot point their limbs as the service's joints do, whatever their rest pose and axes."""

import json
import time
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.character.examples import prepare
from engine_bridge.performance.exercise import random_poses
from engine_bridge.performance.rig import load_rig
from engine_bridge.service.protocol.frame import Frame, StreamedCharacter
from engine_bridge.service.protocol.header import Header, Kind, join, topic
from engine_bridge.service.protocol.payloads import encode

CHAINS = {
    "leftUpperArm": ("leftLowerArm", "LeftArm"),
    "leftLowerArm": ("leftHand", "LeftForeArm"),
    "leftHand": (None, "LeftHand"),
    "rightUpperArm": ("rightLowerArm", "RightArm"),
    "rightLowerArm": ("rightHand", "RightForeArm"),
    "rightHand": (None, "RightHand"),
    "leftUpperLeg": ("leftLowerLeg", "LeftUpLeg"),
    "leftLowerLeg": ("leftFoot", "LeftLeg"),
    "leftFoot": (None, "LeftFoot"),
    "rightUpperLeg": ("rightLowerLeg", "RightUpLeg"),
    "rightLowerLeg": ("rightFoot", "RightLeg"),
    "rightFoot": (None, "RightFoot"),
}
"""Next joint of each one that is compared, and its bone in the foreign skeleton."""

FOREIGN = {
    "Hips": (None, (0, 1.0, 0)),
    "Spine": ("Hips", (0, 1.2, 0.02)),
    "Head": ("Spine", (0, 1.7, 0.05)),
    **{
        f"{side}{bone}": (f"{side}{parent}" if parent[0] != "*" else parent[1:], (sign * x, y, z))
        for side, sign in (("Left", 1), ("Right", -1))
        for bone, parent, (x, y, z) in (
            ("Arm", "*Spine", (0.2, 1.45, 0.0)),
            ("ForeArm", "Arm", (0.4, 1.2, -0.02)),
            ("Hand", "ForeArm", (0.55, 1.0, 0.05)),
            ("UpLeg", "*Hips", (0.1, 0.95, 0.0)),
            ("Leg", "UpLeg", (0.15, 0.5, 0.03)),
            ("Foot", "Leg", (0.17, 0.1, 0.0)),
        )
    },
}
"""Parent and place of each bone of a skeleton in an A-pose, with Mixamo's names; its left is at +x, and it faces +z."""


@pytest.fixture(scope="module")
def character(tmp_path_factory):
    """The example human."""
    _, puppet = prepare("human", tmp_path_factory.mktemp("example"))
    return StreamedCharacter.of("figure", load_rig(puppet))


@pytest.fixture(scope="module")
def frame(character):
    """A frame in a random pose."""
    controls, motions = random_poses(character.rig, 3)
    R, root = controls[-1].astype(np.float64), np.array([0.3, 0.1, 0.2])
    return Frame(character, 1, 0.5, 0, "performing", 0, R, root, np.zeros((0, 3)), motions=motions[-1])


def foreign():
    """The bones in Godot's terms, with random axes: parents first, rotations and places relative to the parent."""
    rng, world, bones = np.random.default_rng(5), {}, []
    for name, (parent, place) in FOREIGN.items():
        turn = Rotation.random(rng=rng)
        above, start = world[parent] if parent else (Rotation.identity(), np.zeros(3))
        local = above.inv() * turn
        bones.append(
            {
                "name": f"mixamorig_{name}",
                "parent": list(FOREIGN).index(parent) if parent else -1,
                "rotation": local.as_quat().tolist(),
                "position": above.inv().apply(np.array(place) - start).tolist(),
            }
        )
        world[name] = turn, np.array(place, dtype=np.float64)
    return bones


@pytest.fixture
def drive(run_godot, character, tmp_path):
    """Drive a skeleton by a frame."""

    def driven(payloads, bones=None, bone_map=(), **more):
        told = {"bones": foreign() if bones is None else bones, "map": dict(bone_map)}
        (tmp_path / "told.json").write_text(json.dumps(told))
        scene = Header(Kind.SCENE, len(character.scene), character.revision, published=time.monotonic_ns())
        (tmp_path / "scene").write_bytes(join(topic("figure", Kind.SCENE), scene, character.scene))
        for number, payload in enumerate(payloads):
            (tmp_path / f"frame_{number}").write_bytes(payload)
        paths = [tmp_path / f"frame_{number}" for number in range(len(payloads))]
        (result,) = run_godot("drive_skeleton.gd", tmp_path / "told.json", tmp_path / "scene", *paths, **more)
        return SimpleNamespace(**result)

    return driven


def directions(frame):
    """The directions of the service's bones: head to the next joint's head, file coordinates."""
    skeleton, found = frame.character.skeleton, {}
    moves = frame.motions
    places = {joint.name: joint.head @ moves[joint.bone, :3] + moves[joint.bone, 3] for joint in skeleton.joints}
    for joint, (after, bone) in CHAINS.items():
        if after in places:
            found[bone] = places[after] - places[joint]
    return found


def test_limbs_of_an_a_posed_skeleton_with_other_axes_point_as_those_of_the_service(drive, frame):
    result = drive([encode(Kind.BONES, frame, 0)])
    names = [f"mixamorig_{name}" for name in FOREIGN]
    places = dict(zip(names, np.array(result.poses)[:, :3], strict=True))
    assert result.driven["leftUpperArm"] == "mixamorig_LeftArm"
    for before, after in pairwise(CHAINS.values()):
        if before[0] is None:
            continue
        along = places[f"mixamorig_{after[1]}"] - places[f"mixamorig_{before[1]}"]
        aim = directions(frame)[before[1]]
        cosine = along @ aim / np.linalg.norm(along) / np.linalg.norm(aim)
        assert np.degrees(np.arccos(min(cosine, 1))) < 0.1, before


def test_hips_travel_in_proportion_to_the_legs(drive, frame):
    result = drive([encode(Kind.BONES, frame, 0)])
    hips = frame.character.skeleton.joints[0]
    moved = hips.head @ frame.motions[0, :3] + frame.motions[0, 3] + frame.root - hips.head
    joints = {joint.name: joint.head for joint in frame.character.skeleton.joints}
    own = sum(np.linalg.norm(joints[a] - joints[b]) for a, b in pairwise(["leftUpperLeg", "leftLowerLeg", "leftFoot"]))
    places = [np.array(FOREIGN[f"Left{name}"][1]) for name in ("UpLeg", "Leg", "Foot")]
    ratio = sum(np.linalg.norm(a - b) for a, b in pairwise(places)) / own
    np.testing.assert_allclose(np.array(result.poses)[0, :3], np.array([0, 1.0, 0]) + ratio * moved, atol=1e-4)


def test_a_map_names_bones_that_are_not_recognised_and_says_what_is_wrong(drive, frame):
    bones = [bone | {"name": f"b{number}"} for number, bone in enumerate(foreign())]
    result = drive([encode(Kind.BONES, frame, 0)], bones)
    assert result.driven == {}
    assert any("No bone of the skeleton has a known name" in warning for warning in result.warnings)
    result = drive([], bones, {"leftUpperArm": "b3", "nose": "b1", "leftHand": "missing"})
    assert result.driven == {"leftUpperArm": "b3"}
    assert any("no joint 'nose'" in warning for warning in result.warnings)
    assert any("no bone 'missing'" in warning for warning in result.warnings)


def test_a_frame_of_the_wrong_size_or_without_numbers_is_no_pose(drive, frame):
    message = encode(Kind.BONES, frame, 0)
    short = bytearray(message[:-4])
    short[64 + 12 : 64 + 16] = (len(message) - 128 - 4).to_bytes(4, "little")
    result = drive([bytes(short)])
    assert result.damaged == 1
    hostile = message[:128] + np.full((len(message) - 128) // 4, np.nan, dtype="<f4").tobytes()
    assert np.isfinite(np.array(drive([hostile]).poses)).all()
