import json
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, Slerp

from engine_bridge.character.document_reader import load_document
from engine_bridge.character.scene import world_transforms
from engine_bridge.export.performer.gltf import skeleton_animation, vrm_animation
from engine_bridge.export.performer.motion import PerformerMotion
from engine_bridge.export.rig_file import RigSettings
from engine_bridge.export.vrm_file import write_vrm

from .conftest import joints_of

TIMES = 13
"""Number of times, of which every other is between two keyframes."""

CHAINS = (("UpperArm", "LowerArm", "Hand"), ("UpperLeg", "LowerLeg", "Foot"))
LIMBS = [(side + a, side + b) for side in ("left", "right") for chain in CHAINS for a, b in pairwise(chain)]
LIMBS.append(("neck", "head"))


@pytest.fixture(scope="module")
def second(motion):
    """One second of the motion."""
    return motion.part(0, 31)


def at_times(motion, times):
    """Return a motion at other times, interpolated as glTF says."""
    frames = np.arange(len(motion.hips)) / motion.fps
    turns = [Slerp(frames, Rotation.from_quat(motion.rotations[:, row]))(times).as_quat() for row in range(18)]
    hips = np.stack([np.interp(times, frames, motion.hips[:, axis]) for axis in range(3)], axis=1)
    return PerformerMotion(motion.body, motion.fps, hips, np.stack(turns, axis=1))


@pytest.fixture(scope="module")
def avatar(limbed_puppet, tmp_path_factory):
    """A VRM with other proportions than the performer's, long arms and short legs, and other axes of its bones."""
    path = tmp_path_factory.mktemp("avatar") / "avatar.vrm"
    stated = {"name": "Test", "authors": ["Test"], "licence": "https://vrm.dev/licenses/1.0/"}
    write_vrm(limbed_puppet, path, RigSettings(), stated)
    return path


def assert_same_directions(played, places):
    """Assert that an avatar's limbs and neck, which are straight in the T-pose, are along the performer's."""
    for start, end in LIMBS:
        found = np.array(played["bones"][end]) - played["bones"][start]
        expected = places[end] - places[start]
        lengths = np.linalg.norm(found, axis=1) * np.linalg.norm(expected, axis=1)
        cosines = np.einsum("fi,fi->f", found, expected) / lengths
        assert_allclose(cosines, 1, atol=1e-9, err_msg=f"{start} {end}")


def test_both_documents_are_valid(second, assert_valid_gltf, tmp_path):
    for make in (skeleton_animation, vrm_animation):
        make(second, "test").save(tmp_path / "made.glb")
        assert_valid_gltf(tmp_path / "made.glb")


@pytest.mark.parametrize("program", ["Blender", "three.js", "Babylon.js", "Godot"])
@pytest.mark.slow
def test_programs_show_the_bones_where_the_joints_are(second, player, tmp_path, program):
    skeleton_animation(second, "test").save(tmp_path / "skeleton.glb")
    shown = player(program)(tmp_path / "skeleton.glb", TIMES)
    (positions,) = shown.meshes.values()
    places = joints_of(at_times(second, np.clip(shown.times, 0, 1)))
    skeleton, tips = second.body.skeleton, second.body.tips
    heads = dict(zip(skeleton.names, skeleton.heads, strict=True))
    ends = [(skeleton.names[joint.parent], joint.name) for joint in skeleton.joints if joint.parent >= 0]
    ends = [(start, end) for start, end in ends if (heads[start] != heads[end]).any()]
    ends += [(name, f"{name}_end") for name in tips]
    assert positions.shape == (TIMES, 6 * len(ends), 3)
    for number, (start, end) in enumerate(ends):  # the joint and its child are the last two of six corners
        bone = positions[:, 6 * number + 4 : 6 * number + 6].swapaxes(0, 1)
        assert_allclose(bone, [places[start], places[end]], rtol=0, atol=2e-6 * second.body.height)


def test_an_avatar_with_other_proportions_has_the_performers_directions(second, avatar, node, tmp_path):
    vrm_animation(second, "test").save(tmp_path / "second.vrma")
    played = json.loads(node("play_vrma.mjs", avatar, tmp_path / "second.vrma", str(TIMES)))
    assert played["warnings"] == []
    places = joints_of(at_times(second, np.clip(played["times"], 0, 1)))
    assert_same_directions(played, places)
    hips = np.array(played["bones"]["hips"])
    document = load_document(avatar)
    node = document.gltf["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"]["hips"]["node"]
    scale = world_transforms(document)[node][1, 3] / second.body.skeleton.heads[0][1]
    assert_allclose(hips - hips[0], scale * (places["hips"] - places["hips"][0]), atol=1e-6)
