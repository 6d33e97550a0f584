"""Files of `puppetline rig` in Godot: bones have the names, the hierarchy and the axes of its humanoid."""

import base64

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.export.rig_file import RigSettings, write_rig

DEGREES = 60.0


@pytest.fixture(scope="module")
def rigged(limbed_puppet, tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "figure.glb"
    write_rig(limbed_puppet, path, RigSettings(names="godot"))
    return path


def positions(text):
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, 3).astype(float)


def test_a_rig_is_godots_humanoid_and_a_bone_turns_its_part_of_the_mesh(run_godot, rigged):
    read, turned = run_godot("read_rig.gd", rigged, "LeftLowerArm", DEGREES)
    bones = {each["name"]: each for each in read["bones"]}
    assert {"Hips", "Spine", "Head", "LeftUpperArm", "RightHand", "LeftFoot"} <= {*bones}
    assert {each["parent"] for each in bones.values() if each["profile"] is None} <= {*bones}  # the handle's joint
    for each in bones.values():
        assert each["profile"] in (None, each["parent"])
    arm, hand = bones["LeftLowerArm"], bones["LeftHand"]
    joint = np.array(arm["place"])
    along = np.subtract(hand["place"], joint)
    np.testing.assert_allclose(arm["along"], along / np.linalg.norm(along), atol=1e-4)
    at_rest, now = positions(read["rest"]), positions(turned["turned"])
    beyond = (at_rest - hand["place"]) @ arm["along"] > 0  # what the forearm moves alone
    turn = Rotation.from_rotvec(DEGREES * np.array(arm["across"]), degrees=True)
    expected = turn.apply(at_rest - joint) + joint
    assert np.count_nonzero(beyond) > 10
    np.testing.assert_allclose(now[beyond], expected[beyond], atol=0.02)
    behind = (at_rest - bones["LeftUpperArm"]["place"]) @ arm["along"] < 0
    np.testing.assert_allclose(now[behind], at_rest[behind], atol=0.005)
