import json
from itertools import pairwise

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, Slerp

from engine_bridge.export.performer.gltf import skeleton_animation, vrm_animation
from engine_bridge.export.performer.motion import PerformerMotion

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
def avatar(new_glb, motion, tmp_path_factory):
    """A VRM with other proportions than the performer's, long arms and short legs, and other axes of its bones."""
    glb, skeleton = new_glb(), motion.body.skeleton
    heads = skeleton.heads * [1.7, 0.6, 1.0] + [0.0, 0.02, 0.05]
    turns = Rotation.random(len(heads), random_state=7)
    for row, joint in enumerate(skeleton.joints):
        above = turns[joint.parent].inv() if joint.parent >= 0 else Rotation.identity()
        offset = above.apply(heads[row] - (heads[joint.parent] if joint.parent >= 0 else 0))
        children = np.flatnonzero(skeleton.parents == row).tolist()
        rotation = (above * turns[row]).as_quat().tolist()
        glb.file.nodes.append(
            gltf.Node(name=f"b{row}", translation=offset.tolist(), rotation=rotation, children=children)
        )
    glb.file.scenes, glb.file.scene = [gltf.Scene(nodes=[0])], 0
    glb.file.extensionsUsed = ["VRMC_vrm"]
    bones = {name: {"node": row} for row, name in enumerate(skeleton.names)}
    meta = {"name": "Test", "authors": ["Test"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    glb.file.extensions = {"VRMC_vrm": {"specVersion": "1.0", "meta": meta, "humanoid": {"humanBones": bones}}}
    return glb.save(tmp_path_factory.mktemp("avatar") / "avatar.vrm")


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
    ends = [(skeleton.names[joint.parent], joint.name) for joint in skeleton.joints if joint.parent >= 0]
    ends = [
        pair
        for pair in ends
        if np.linalg.norm(np.diff(skeleton.heads[[skeleton.names.index(n) for n in pair]], axis=0))
    ]
    ends += [(name, f"{name}_end") for name in tips]
    assert positions.shape == (TIMES, 6 * len(ends), 3)
    for number, (start, end) in enumerate(ends):  # the joint and its child are the last two of six corners
        assert_allclose(positions[:, 6 * number + 4], places[start], rtol=0, atol=2e-6 * second.body.height)
        assert_allclose(positions[:, 6 * number + 5], places[end], rtol=0, atol=2e-6 * second.body.height)


def test_an_avatar_with_other_proportions_has_the_performers_directions(second, avatar, node, tmp_path):
    vrm_animation(second, "test").save(tmp_path / "second.vrma")
    played = json.loads(node("play_vrma.mjs", avatar, tmp_path / "second.vrma", str(TIMES)))
    assert played["warnings"] == []
    places = joints_of(at_times(second, np.clip(played["times"], 0, 1)))
    rest = dict(zip(second.body.skeleton.names, second.body.skeleton.heads, strict=True))
    assert_same_directions(played, places)
    hips = np.array(played["bones"]["hips"])
    scale = (0.6 * rest["hips"][1] + 0.02) / rest["hips"][1]
    assert_allclose(hips - hips[0], scale * (places["hips"] - places["hips"][0]), atol=1e-6)
