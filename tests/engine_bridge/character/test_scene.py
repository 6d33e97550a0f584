import numpy as np
import pygltflib as gltf
import pytest

from engine_bridge.character.character import MAX_PARTS, load_character
from engine_bridge.character.document import Document
from engine_bridge.character.scene import MAX_JOINT_SETS, world_transforms
from puppetline.errors import MeshError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.uint16)


def transform(**node):
    return world_transforms(Document({"nodes": [node]}))[0]


@pytest.mark.parametrize("size", [1e-320, 1e-200, 1, 10**30, 1e300])
def test_a_rotation_of_any_length_is_a_rotation(size):
    quarter = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(transform(rotation=[0, 0, size, size]), quarter, atol=1e-15)


def test_a_rotation_of_no_length_is_none():
    np.testing.assert_array_equal(transform(rotation=[0, 0, 0, 0]), np.eye(4))


def test_whole_numbers_of_more_than_64_bits_are_numbers():
    large = transform(scale=[10**30, 1, 1], translation=[0, 10**30, 0])
    np.testing.assert_array_equal(large, [[1e30, 0, 0, 0], [0, 1, 0, 1e30], [0, 0, 1, 0], [0, 0, 0, 1]])


def refused(glb, path):
    with pytest.raises(MeshError) as error:
        load_character(glb.save(path))
    return error.value


def hang_on(glb, inverse, sets=1):
    """A body on one bone."""
    bone = glb.node()
    glb.file.skins = [gltf.Skin(joints=[bone], inverseBindMatrices=glb.add(inverse.reshape(1, 16), None))]
    glb.file.accessors[-1].min = glb.file.accessors[-1].max = None  # JSON has no NaN
    primitive = glb.primitive(CORNERS, SIDES, NORMAL=CORNERS + np.float32(1))
    joints, weights = glb.add(np.zeros((4, 4), np.uint8)), glb.add(np.eye(4, dtype=np.float32)[[0, 0, 0, 0]])
    for number in range(sets):
        setattr(primitive.attributes, f"JOINTS_{number}", joints)
        setattr(primitive.attributes, f"WEIGHTS_{number}", weights)
    glb.node(glb.mesh(primitive), skin=0)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_a_skin_without_bounds_is_refused(glb, tmp_path, value):
    inverse = np.eye(4, dtype=np.float32)
    inverse[1, 2] = value
    hang_on(glb, inverse)
    error = refused(glb, tmp_path / "a.glb")
    assert (error.where, error.found) == (f"{tmp_path / 'a.glb'}, nodes[1]", "a transform that is not finite")


def test_a_node_without_bounds_is_refused(glb, tmp_path):
    above = glb.node(scale=[1e200] * 3)
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES)), parent=above, scale=[1e200] * 3)
    assert refused(glb, tmp_path / "a.glb").found == "a transform that is not finite"


def test_a_scene_that_shows_a_branch_without_its_trunk_is_refused(glb, tmp_path):
    trunk = glb.node(scale=[2, 2, 2])
    branch = glb.node(glb.mesh(glb.primitive(CORNERS, SIDES)), parent=trunk)
    glb.file.scenes[0].nodes = [branch]
    error = refused(glb, tmp_path / "a.glb")
    assert error.where == f"{tmp_path / 'a.glb'}, nodes[1]"
    assert error.found == "a node at the top of the scene that has a parent"


def test_joints_without_end_are_refused(glb, tmp_path):
    hang_on(glb, np.eye(4, dtype=np.float32), sets=MAX_JOINT_SETS + 1)
    error = refused(glb, tmp_path / "a.glb")
    assert (error.where, error.found) == (f"{tmp_path / 'a.glb'}, skins[0]", "17 sets of joints at each vertex")


def test_a_scene_of_more_parts_than_any_character_is_refused(glb, tmp_path):
    mesh = glb.mesh(*[glb.primitive(CORNERS, SIDES)] * 101)
    for _ in range(MAX_PARTS // 101 + 1):
        glb.node(mesh)
    error = refused(glb, tmp_path / "a.glb")
    assert error.found == "a scene with too many parts or vertices"
    assert error.expected == "at most 10,000 parts and 10,000,000 vertices"
