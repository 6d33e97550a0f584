from functools import partial

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import MAX_PARTS, load_character
from engine_bridge.character.document import Document
from engine_bridge.character.scene import MAX_JOINT_SETS, world_transforms
from puppetline.errors import MeshError

from ..refusals import refused_place
from .conftest import CORNERS, SIDES


def transform(**node):
    return world_transforms(Document({"nodes": [node]}))[0]


@pytest.mark.parametrize("size", [1e-320, 1e-200, 1, 10**30, 1e300])
def test_a_rotation_of_any_length_is_a_rotation_and_one_of_none_is_none(size):
    quarter = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    assert_allclose(transform(rotation=[0, 0, size, size]), quarter, atol=1e-15)
    assert_array_equal(transform(rotation=[0, 0, 0, 0]), np.eye(4))


def test_whole_numbers_of_more_than_64_bits_are_numbers():
    large = transform(scale=[10**30, 1, 1], translation=[0, 10**30, 0])
    assert_array_equal(large, [[1e30, 0, 0, 0], [0, 1, 0, 1e30], [0, 0, 1, 0], [0, 0, 0, 1]])


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


def endless_skin(glb, value):
    inverse = np.eye(4, dtype=np.float32)
    inverse[1, 2] = value
    hang_on(glb, inverse)


def endless_node(glb):
    above = glb.node(scale=[1e200] * 3)
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES)), parent=above, scale=[1e200] * 3)


def branch_without_its_trunk(glb):
    trunk = glb.node(scale=[2, 2, 2])
    glb.file.scenes[0].nodes = [glb.node(glb.mesh(glb.primitive(CORNERS, SIDES)), parent=trunk)]


def too_many_parts(glb):
    mesh = glb.mesh(*[glb.primitive(CORNERS, SIDES)] * 101)
    for _ in range(MAX_PARTS // 101 + 1):
        glb.node(mesh)


@pytest.mark.parametrize(
    ("damage", "place"),
    [
        *((partial(endless_skin, value=value), "nodes[1]") for value in (np.nan, np.inf, 1e30)),
        (endless_node, "nodes[1]"),
        (branch_without_its_trunk, "nodes[1]"),
        (partial(hang_on, inverse=np.eye(4, dtype=np.float32), sets=MAX_JOINT_SETS + 1), "skins[0]"),
        (too_many_parts, ""),
    ],
)
def test_a_scene_without_bounds_is_refused_with_its_place(glb, tmp_path, damage, place):
    damage(glb)
    path = glb.save(tmp_path / "a.glb")
    assert refused_place(MeshError, path, load_character, path) == place
