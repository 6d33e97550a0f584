from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture import body
from capture.skeleton import JOINT_INDEX
from engine_bridge.character.character import make_character
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.prepared_character import make_prepared
from engine_bridge.puppet.puppet import CharacterTable, RetargetTable, RootTable

from ..bones import turned
from ..export.conftest import solved_places
from .test_retargeting import RAW, changed


@pytest.fixture(scope="module")
def puppet(prepared_blob):
    return changed(prepared_blob.puppet, smoothing=RAW, retarget=RetargetTable())


@pytest.fixture(scope="module")
def prepared_of(blob):
    """Prepare the figure for a puppet, its vertices turned by a matrix for row vectors."""

    def make(puppet, turn=None):
        vertices = blob.vertices.astype(np.float64)
        return make_prepared(puppet, make_character("blob", vertices if turn is None else vertices @ turn, blob.faces))

    return make


def play(prepared, puppet, frames, rest):
    """Return (T, n, 3) vertices without the root's motion, and (T, 3) the root's."""
    motion = CharacterMotion(replace(prepared, puppet=puppet), rest)
    poses = [motion.step(frame) for frame in frames]
    return solved_places(prepared, np.array([pose.R for pose in poses])), np.array([pose.root for pose in poses])


@pytest.mark.parametrize(("axes", "scale"), [("", 2.5), ("xz", 2.5), ("xyz", "auto")])
def test_the_root_moves_as_the_hips_do_times_the_scale(prepared_blob, puppet, frames, dance, standing, axes, scale):
    moving = changed(puppet, root=RootTable(axes=axes), retarget=RetargetTable(scale=scale))
    takes = dance(20)
    _, root = play(prepared_blob, moving, frames(takes), standing)
    hips = takes[:, JOINT_INDEX["hip_center"]] - standing[JOINT_INDEX["hip_center"]]
    if scale == "auto":
        scale = np.ptp(prepared_blob.mesh.vertices[:, 1]) / body.height(standing)
    expected = scale * hips * [-1, 1, -1] * [axis in axes for axis in "xyz"]
    assert_allclose(root, expected, atol=1e-9)


def test_handles_take_the_mean_of_their_joints_their_axes_and_their_gain(prepared_blob, puppet, frames, standing):
    takes = np.tile(standing, (2, 1, 1))
    for joint, way in (("hand_right", [0, 0.2, 0]), ("wrist_right", [0.1, 0, 0]), ("head", [0.1, 0.3, -0.2])):
        takes[1, JOINT_INDEX[joint]] += way
    metric = changed(puppet, root=None, retarget=RetargetTable(scale=1.0))
    motion = CharacterMotion(replace(prepared_blob, puppet=metric), standing)
    _, pose = map(motion.step, frames(takes))
    expected = np.zeros((5, 3))
    expected[1:3] = [-0.05, 0.1, 0], np.multiply(0.8, [-0.1, 0, 0.2])
    assert_allclose(pose.targets - motion.deformer.handles, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("up", "front", "unit", "scale"), [("z", "-y", 0.01, "auto"), ("-y", "-z", 0.01, 1.3), ("z", "x", 1, 1.3)]
)
def test_a_character_that_stands_otherwise_or_in_another_unit_in_its_file_plays_the_same(
    prepared_blob, prepared_of, puppet, frames, dance, standing, up, front, unit, scale
):
    upright = changed(puppet, retarget=RetargetTable(scale=scale), root=RootTable(axes="xyz"))
    table = CharacterTable(mesh="a", up=up, front=front, scale=unit)
    turn = table.basis / unit  # rows: where left, up and front go
    lying = changed(turned(upright, turn), character=table)
    takes = dance(15)
    vertices, root = play(prepared_blob, upright, frames(takes), standing)
    other, other_root = play(prepared_of(lying, turn), lying, frames(takes), standing)
    assert_allclose(other, vertices @ turn, atol=1e-4 * prepared_blob.mesh.diagonal / unit)
    assert_allclose(other_root, root @ turn, atol=1e-9 / unit)
    assert np.abs(vertices - vertices[0]).max() > 0.03 * prepared_blob.mesh.diagonal


def test_where_the_performer_stands_when_and_how_tall_makes_no_difference(
    prepared_blob, puppet, frames, dance, standing
):
    takes, offset = dance(10), np.array([1.5, 0.3, -1.0])
    here, root = play(prepared_blob, puppet, frames(takes), standing)
    there, other_root = play(prepared_blob, puppet, frames(takes + offset, start=1e5), standing + offset)
    taller, _ = play(prepared_blob, puppet, frames(2 * takes), 2 * standing)
    assert_allclose([there, taller], [here, here], atol=1e-6)
    assert_allclose(other_root, root, atol=1e-9)


def test_a_root_that_is_lost_goes_on_with_the_other_joints_and_a_body_that_is_lost_without_a_jump(
    prepared_blob, puppet, frames, standing
):
    """In a walk of 2 cm a frame the hips, and then all joints, are lost from frame 20 to 39."""
    walking = changed(puppet, retarget=RetargetTable(scale=1.0), root=RootTable(axes="xz"))
    takes = np.tile(standing, (90, 1, 1))
    takes[:, :, 0] += 0.02 * np.arange(90)[:, None]
    takes[20:40, JOINT_INDEX["hip_center"]] = np.nan
    vertices, root = play(prepared_blob, walking, frames(takes), standing)
    assert_allclose(root[:, 0], -0.02 * np.arange(90), atol=1e-9)
    assert_allclose(vertices, np.tile(prepared_blob.mesh.vertices, (90, 1, 1)), atol=1e-6 * prepared_blob.mesh.diagonal)
    takes[20:40] = np.nan
    _, root = play(prepared_blob, walking, frames(takes), standing)
    assert_allclose(root[20:40], np.tile(root[19], (20, 1)), atol=1e-12)
    assert np.abs(np.diff(root[39:, 0])).max() < 0.12  # it is 0.42 m behind when it returns
    assert_allclose(root[-1, 0], -0.02 * 89, atol=0.02)
