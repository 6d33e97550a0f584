"""Foreign skeletons in Unity point their limbs as the service's joints do, whatever their rest pose and axes."""

import json
import subprocess
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.scene import encode_scene

from ..foreign_skeleton import FOREIGN, foreign
from ..limbs import Limbs, values_of
from ..stage import performed
from .conftest import shown

UNKNOWN = {"neck", "head", "leftHand", "rightHand", "leftFoot", "rightFoot"}
"""Joints whose T-pose a skeleton does not tell: no bone follows in the direction that they have there."""


@pytest.fixture(scope="module")
def pose(mono, built, human, tmp_path_factory):
    """Pose a skeleton by a frame of the example human."""
    scene = tmp_path_factory.mktemp("scene") / "human.bin"
    scene.write_bytes(encode_scene(human))

    def posed(values, bones, moves_hips=True, **names):
        told = json.dumps({"bones": bones, "map": names, "frame": values.tolist(), "movesHips": moves_hips})
        command = [mono[1], built / "Posing.exe", scene]
        return json.loads(subprocess.run(command, input=told, capture_output=True, text=True, check=True).stdout)

    return posed


def places(poses):
    return np.array(poses)[:, 4:]


class TestLimbs(Limbs):
    @pytest.fixture
    def drive(self, pose):
        def driven(values, bones, **names):
            result = pose(values, bones, **names)
            return places(result["posed"]), dict(result["names"])

        return driven


def test_hips_stay_on_request_a_joint_without_a_name_does_too_and_the_rest_pose_comes_back(pose, posed_human):
    result = pose(values_of(posed_human), foreign(), moves_hips=False, leftUpperArm="")
    rest = np.array([place for _, place in FOREIGN.values()])
    np.testing.assert_allclose(places(result["posed"])[0], rest[0], atol=1e-6)
    np.testing.assert_allclose(places(result["rest"]), rest, atol=1e-5)
    assert "leftUpperArm" not in dict(result["names"])


@pytest.fixture
def limbed(new_stage, limbed_puppet, take):
    """The small figure with limbs."""
    return new_stage(performed(limbed_puppet, take))


@pytest.fixture
def show_bones(show, limbed, tmp_path):
    """Have a Puppet drive a copy of the figure's own skeleton."""

    def run(**fields):
        (tmp_path / "bones.json").write_text(json.dumps(limbed.facts["bones"]))
        return show(limbed, character="limbed", mode="Bones", bones=tmp_path / "bones.json", **fields)

    return run


def test_a_copy_of_the_characters_skeleton_has_the_poses_of_the_frames(show_bones, limbed):
    bones, program = limbed.facts["bones"], show_bones()
    both = shown(program, limbed, 30, Kind.BONES)
    for said, theirs in both:
        turns, found = [], Rotation.from_quat(np.array(said["bones"])[:, :4])
        for bone, own in zip(bones, np.reshape(theirs[: 4 * len(bones)], (-1, 4)), strict=True):
            turn = Rotation.from_quat(own)
            turns.append(turn if bone["parent"] < 0 else turns[bone["parent"]] * turn)
        off = np.degrees((found * Rotation.concatenate(turns).inv()).magnitude())
        assert max(angle for bone, angle in zip(bones, off, strict=True) if bone["name"] not in UNKNOWN) < 0.1
    assert np.ptp([said["bones"] for said, _ in both], axis=0).max() > 0.02
    assert program.finish()[-1]["ended"]


def test_between_frames_bones_turn_the_short_way(show_bones, limbed):
    limbed.is_playing = True
    program = show_bones(interpolationDelay=0.1)
    program.until(lambda _: sum("bones" in said for said in program.said) >= 40)
    turns = [Rotation.from_quat(np.array(said["bones"])[:, :4]) for said in program.finish() if "bones" in said]
    assert max(np.degrees((b * a.inv()).magnitude().max()) for a, b in pairwise(turns)) < 30


def test_bones_without_a_known_name_and_a_character_without_limbs_are_warned_of(show, limbed, stage):
    program = show(limbed, character="limbed", mode="Bones", boneMap="tail_9")
    for wanted in ("leftUpperArm", "tail_9"):
        program.until(lambda said, wanted=wanted: wanted in said.get("warning", ""))
    stage.listed["kinds"].remove("bones")
    show(mode="Bones").until(lambda said: "[[limb]]" in said.get("warning", ""))
