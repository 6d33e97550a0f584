"""Foreign skeletons in Unity point their limbs as the service's joints do, whatever their rest pose and axes."""

import json
import subprocess
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import encode
from engine_bridge.service.protocol.scene import encode_scene

from ...engine_bridge.service.conftest import services
from ..foreign_skeleton import CHARACTER_CREATOR, FOREIGN, MIXAMO, VROID, foreign, hips_place, worst_angle
from .conftest import shown

UNKNOWN = {"neck", "head", "leftHand", "rightHand", "leftFoot", "rightFoot"}
"""Joints whose T-pose a skeleton does not tell: no bone follows in the direction that they have there."""


@pytest.fixture(scope="module")
def pose(mono, built, human, tmp_path_factory):
    """Pose a skeleton by a frame of the example human."""
    scene = tmp_path_factory.mktemp("scene") / "human.bin"
    scene.write_bytes(encode_scene(human))

    def posed(frame, bones, moves_hips=True, **names):
        values = np.frombuffer(encode(Kind.BONES, frame, 0)[128:], dtype="<f4").astype(float).tolist()
        told = json.dumps({"bones": bones, "map": names, "frame": values, "movesHips": moves_hips})
        command = [mono[1], built / "Posing.exe", scene]
        return json.loads(subprocess.run(command, input=told, capture_output=True, text=True, check=True).stdout)

    return posed


def places(poses):
    return dict(zip(FOREIGN, np.array(poses)[:, 4:], strict=True))


@pytest.mark.parametrize("names", [MIXAMO, VROID, CHARACTER_CREATOR])
def test_limbs_of_an_a_posed_skeleton_with_other_axes_point_as_those_of_the_service(pose, posed_human, names):
    result = pose(posed_human, foreign(names))
    found = places(result["posed"])
    assert ["leftUpperArm", names[3]] in result["names"]
    assert worst_angle(found, posed_human) < 0.1
    np.testing.assert_allclose(found["Hips"], hips_place(posed_human), atol=1e-4)


def test_hips_stay_on_request_and_the_rest_pose_comes_back(pose, posed_human):
    result = pose(posed_human, foreign(), moves_hips=False)
    np.testing.assert_allclose(places(result["posed"])["Hips"], FOREIGN["Hips"][1], atol=1e-6)
    for name, place in places(result["rest"]).items():
        np.testing.assert_allclose(place, FOREIGN[name][1], atol=1e-5)


def test_a_map_names_bones_and_an_empty_name_leaves_a_joint_out(pose, posed_human):
    numbered = [bone | {"name": f"b{number}"} for number, bone in enumerate(foreign())]
    assert pose(posed_human, numbered, leftUpperArm="b3", nose="b1")["names"] == [["leftUpperArm", "b3"]]
    assert "leftUpperArm" not in dict(pose(posed_human, foreign(), leftUpperArm="")["names"])


@pytest.fixture(scope="module")
def limbed(own_cache, commands, limbed_puppet, take, tmp_path_factory):
    """The small figure with limbs, served."""
    played = ("--puppet", limbed_puppet, "--source", f"replay:{take}?loop", "--calibrate", "at_once")
    with services(commands, tmp_path_factory.mktemp("limbed")) as start:
        yield start(*played)


@pytest.fixture
def own_bones(reference, limbed, tmp_path):
    """The bones of the figure's own skeleton in a file, and what Python receives."""
    received = reference(limbed.stream, "limbed/bones", "limbed/scene/python")
    bones = received.scene.facts["bones"]
    path = tmp_path / "bones.json"
    path.write_text(json.dumps(bones))
    return path, bones, received


def test_a_copy_of_the_characters_skeleton_has_the_poses_of_the_frames(show, limbed, own_bones):
    path, bones, received = own_bones
    program = show(limbed, character="limbed", mode="Bones", bones=path)
    both = shown(program, received, 60)
    for said, theirs in both:
        turns, found = [], Rotation.from_quat(np.array(said["bones"])[:, :4])
        for bone, own in zip(bones, np.reshape(theirs[: 4 * len(bones)], (-1, 4)), strict=True):
            turn = Rotation.from_quat(own)
            turns.append(turn if bone["parent"] < 0 else turns[bone["parent"]] * turn)
        off = np.degrees((found * Rotation.concatenate(turns).inv()).magnitude())
        assert max(angle for bone, angle in zip(bones, off, strict=True) if bone["name"] not in UNKNOWN) < 0.1
    assert np.ptp([said["bones"] for said, _ in both], axis=0).max() > 0.02
    assert program.finish()[-1]["ended"]


def test_between_frames_bones_turn_the_short_way(show, limbed, own_bones):
    path, _, received = own_bones
    program = show(limbed, character="limbed", mode="Bones", bones=path, interpolationDelay=0.1)
    both = shown(program, received, 40)
    turns = [Rotation.from_quat(np.array(said["bones"])[:, :4]) for said, _ in both]
    steps = [np.degrees((b * a.inv()).magnitude().max()) for a, b in pairwise(turns)]
    assert max(steps) < 30
    program.finish()


def test_a_puppet_without_bones_of_a_known_name_says_which_joints_there_are(show, limbed):
    program = show(limbed, character="limbed", mode="Bones", boneMap="tail_9")
    warned = program.until(lambda said: "has a known name" in said.get("warning", ""))["warning"]
    assert "leftUpperArm" in warned
    assert "no joint 'tail_9'" in program.until(lambda said: "boneMap: " in said.get("warning", ""))["warning"]
    program.close()


def test_a_character_without_limbs_is_refused_with_a_remedy(show):
    program = show(mode="Bones")
    assert program.until(lambda said: "[[limb]]" in said.get("warning", ""))
    program.close()
