"""Weights and inverse bind matrices that are mended when a character is read."""

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import load_character

PLACES = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [5, 0, 0], [6, 0, 0], [6, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [3, 4, 5]], np.uint32)
JOINTS = np.array([[0, 1, 0, 0]] * 3 + [[1, 0, 0, 0]] * 3, np.uint8)
WEIGHTS = np.array([[0.75, 0.25, 0, 0]] * 3 + [[1, 0, 0, 0]] * 3, np.float32)


@pytest.fixture
def skinned(glb, tmp_path):
    """Read a file with two triangles that follow two joints."""

    def make(weights=WEIGHTS, matrices=None, skeleton=None):
        top = glb.node(name="a", translation=[0.0, 1.0, 0.0])
        joints = [top, glb.node(parent=top, name="b", translation=[2.0, 0.0, 0.0])]
        glb.file.skins = [gltf.Skin(joints=joints, skeleton=None if skeleton is None else joints[skeleton])]
        if matrices is not None:
            glb.file.skins[0].inverseBindMatrices = glb.add(matrices.transpose(0, 2, 1).reshape(-1, 16))
            glb.file.accessors[-1].min = glb.file.accessors[-1].max = None
        primitive = glb.primitive(PLACES, FACES)
        primitive.attributes.JOINTS_0, primitive.attributes.WEIGHTS_0 = glb.add(JOINTS), glb.add(weights)
        glb.file.accessors[-1].min = glb.file.accessors[-1].max = None  # JSON has no NaN
        glb.node(glb.mesh(primitive), skin=0)
        return load_character(glb.save(tmp_path / "skinned.glb"))

    return make


@pytest.fixture
def mended(skinned, tmp_path, assert_valid_gltf):
    """Do the same, and check that what is saved is valid."""

    def make(*arrays, **more):
        character = skinned(*arrays, **more)
        character.document.save(tmp_path / "mended.glb")
        assert_valid_gltf(tmp_path / "mended.glb")
        return character

    return make


def notes_of(character, beginning):
    return [note for note in character.document.notes if note.startswith(beginning)]


def weights_of(character):
    """Return the weights (6, 2) of both joints at each vertex."""
    document, attributes = character.document, character.primitive(character.parts[0])["attributes"]
    joints, weights = (document.array(attributes[name]) for name in ("JOINTS_0", "WEIGHTS_0"))
    assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    return np.column_stack([np.where(joints == joint, weights, 0).sum(axis=1) for joint in (0, 1)])


@pytest.mark.parametrize(
    "broken",
    [[np.nan, 0, 0, 0], [np.inf, 1, 0, 0], [0, 0, 0, 0], [-1, 0, 0, 0]],
    ids=["nan", "inf", "zero", "negative"],
)
def test_a_vertex_without_valid_weights_gets_those_of_the_nearest_one(mended, broken):
    weights = WEIGHTS.copy()
    weights[[0, 5]] = broken
    character = mended(weights)
    assert_allclose(weights_of(character), [[0.75, 0.25]] * 3 + [[0, 1]] * 3)
    assert len(notes_of(character, "2 vertices")) == 1


def test_vertices_of_blender_s_neutral_bone_follow_the_nearest_ones_of_the_mesh(glb, tmp_path):
    """A horse's bridle would stay where it is while the head moves."""
    nodes = [glb.node(name=name) for name in ("a", "b", "neutral_bone")]
    glb.file.skins = [gltf.Skin(joints=nodes)]
    primitives = []
    for shift, joints in ((0, [0, 0, 2, 1, 1, 1]), (0.1, [2] * 6)):
        follows = np.pad(np.array(joints, np.uint8)[:, None], ((0, 0), (0, 3)))
        weights = np.eye(1, 4, dtype=np.float32).repeat(6, axis=0)
        primitives.append(glb.primitive(PLACES + np.float32(shift), FACES, JOINTS_0=follows, WEIGHTS_0=weights))
    glb.node(glb.mesh(*primitives), skin=0)
    character = load_character(glb.save(tmp_path / "bridle.glb"))
    for part in character.parts:
        joints = character.document.array(character.primitive(part)["attributes"]["JOINTS_0"])
        assert joints[:, 0].tolist() == [0, 0, 0, 1, 1, 1]
    assert notes_of(character, "7 vertices")


@pytest.mark.parametrize("factor", [1, 1.01])
def test_sums_become_1_and_valid_weights_stay_as_they_are_and_are_not_written_again(skinned, factor):
    character = skinned(WEIGHTS * np.float32(factor))
    assert_allclose(weights_of(character), [[0.75, 0.25]] * 3 + [[0, 1]] * 3, atol=1e-7 * (factor > 1))
    assert not character.document.notes
    assert len(character.document.gltf["accessors"]) == 4


def test_if_no_weights_are_valid_all_vertices_follow_the_first_joint(skinned):
    assert_array_equal(weights_of(skinned(WEIGHTS * np.nan)), [[1, 0]] * 6)


BINDS = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
BINDS[:, :3, 3] = [[0, -1, 0], [-2, -1, 0]]


@pytest.mark.parametrize("broken", [np.full((4, 4), np.nan), np.zeros((4, 4)), np.diag([1, 0, 1, 1])])
@pytest.mark.parametrize("joint", [0, 1])
def test_a_joint_without_a_valid_matrix_leaves_the_surface_where_it_is_at_rest(mended, broken, joint):
    matrices = BINDS.copy()
    matrices[joint] = broken
    character = mended(matrices=matrices)
    assert_allclose(character.vertices, PLACES, atol=1e-6)
    assert len(notes_of(character, "1 joints")) == 1


def test_the_last_row_of_a_matrix_is_that_of_an_affine_one(mended):
    matrices = BINDS.copy()
    matrices[:, 3, 3] = 1 + 1e-6
    assert not mended(matrices=matrices).document.notes


@pytest.mark.parametrize("root", [0, 1])
def test_a_root_that_is_not_above_all_joints_is_removed(mended, root):
    assert ("skeleton" in mended(skeleton=root).document.gltf["skins"][0]) == (root == 0)
