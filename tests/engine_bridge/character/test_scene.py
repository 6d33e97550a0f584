import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import load_character
from engine_bridge.character.document import Document
from engine_bridge.character.scene import world_transforms
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


def endless_node(glb):
    above = glb.node(scale=[1e200] * 3)
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES)), parent=above, scale=[1e200] * 3)


def branch_without_its_trunk(glb):
    trunk = glb.node(scale=[2, 2, 2])
    glb.file.scenes[0].nodes = [glb.node(glb.mesh(glb.primitive(CORNERS, SIDES)), parent=trunk)]


@pytest.mark.parametrize(("damage", "place"), [(endless_node, "nodes[1]"), (branch_without_its_trunk, "nodes[1]")])
def test_a_scene_without_bounds_is_refused_with_its_place(glb, tmp_path, damage, place):
    damage(glb)
    path = glb.save(tmp_path / "a.glb")
    assert refused_place(MeshError, path, load_character, path) == place
