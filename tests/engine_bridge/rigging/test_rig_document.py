import json

import numpy as np
import pytest

from engine_bridge.character.character import from_document
from engine_bridge.character.scene import skinning, world_transforms
from engine_bridge.performance.rig import load_rig
from engine_bridge.rigging.made_rig import make_rig
from engine_bridge.rigging.rig_document import rigged_document


@pytest.fixture(scope="module")
def made(limbed_rig):
    return make_rig(limbed_rig)


@pytest.fixture(scope="module")
def rigged(limbed_rig, made):
    """The document, and the nodes of the joints."""
    document, nodes, _ = rigged_document(limbed_rig.character, made, limbed_rig.mesh.of_render)
    return document, nodes


def test_the_character_is_where_it_was(rigged, limbed_rig):
    again = from_document(rigged[0])
    np.testing.assert_allclose(again.vertices, limbed_rig.character.vertices, atol=1e-6 * limbed_rig.mesh.diagonal)
    np.testing.assert_array_equal(again.triangles, limbed_rig.character.triangles)


def test_joints_have_their_names_places_and_axes(rigged, made):
    document, nodes = rigged
    world = world_transforms(document)[nodes]
    assert [document.gltf["nodes"][node]["name"] for node in nodes] == list(made.skeleton.names)
    np.testing.assert_allclose(world[:, :3, 3], made.skeleton.heads, atol=1e-9)
    np.testing.assert_allclose(world[:, :3, :3], made.skeleton.axes, atol=1e-9)
    for joint, node in zip(made.skeleton.joints, nodes, strict=True):
        above = nodes[joint.parent] if joint.parent >= 0 else nodes[0] - 1
        assert node in document.gltf["nodes"][above]["children"]


def test_a_turned_joint_turns_its_vertices_about_it(rigged, limbed_rig, made):
    """Linear blend skinning by the weights, with the elbow bent by hand."""
    document, nodes = (rigged[0].copy(), rigged[1])
    elbow = made.skeleton.names.index("leftLowerArm")
    turn = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # about its own x axis
    x, y, z, w = document.gltf["nodes"][nodes[elbow]]["rotation"]
    a, b, c, d = turn
    product = [w * a + x * d + y * c - z * b, w * b - x * c + y * d + z * a, w * c + x * b - y * a + z * d]
    document.gltf["nodes"][nodes[elbow]]["rotation"] = [*product, w * d - x * a - y * b - z * c]
    node = limbed_rig.character.parts[0].node
    primitive = document.gltf["meshes"][document.gltf["nodes"][node]["mesh"]]["primitives"][0]
    rest = limbed_rig.character.vertices
    moved = skinning(document, primitive, document.gltf["nodes"][node]["skin"], len(rest), world_transforms(document))
    placed = np.einsum("nij,nj->ni", moved[:, :3, :3], rest) + moved[:, :3, 3]
    axes, head = made.skeleton.axes[elbow], made.skeleton.joints[elbow].head
    quarter = axes @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) @ axes.T
    below = [name in ("leftLowerArm", "leftHand") for name in made.skeleton.names]
    joints, weights = made.weights.bones[limbed_rig.mesh.of_render], made.weights.weights[limbed_rig.mesh.of_render]
    share = (np.array(below)[joints] * weights).sum(axis=1, keepdims=True)
    expected = (1 - share) * rest + share * ((rest - head) @ quarter.T + head)
    np.testing.assert_allclose(placed, expected, atol=1e-6)


def test_a_transform_of_the_whole_moves_vertices_and_joints(limbed_rig, made):
    everywhere = np.eye(4)
    everywhere[:3] = [[0, 0, -2, 1], [0, 2, 0, 3], [2, 0, 0, -1]]
    document, nodes, _ = rigged_document(limbed_rig.character, made, limbed_rig.mesh.of_render, everywhere)
    expected = limbed_rig.character.vertices @ everywhere[:3, :3].T + everywhere[:3, 3]
    np.testing.assert_allclose(from_document(document).vertices, expected, atol=1e-5)
    places = world_transforms(document)[nodes][:, :3, 3]
    np.testing.assert_allclose(places, made.skeleton.heads @ everywhere[:3, :3].T + everywhere[:3, 3], atol=1e-9)


def test_a_t_pose_is_where_the_surface_was_straightened(limbed_rig):
    straight = make_rig(limbed_rig, in_t_pose=True)
    document, _, _ = rigged_document(limbed_rig.character, straight, limbed_rig.mesh.of_render)
    expected = straight.bind.vertices(limbed_rig.mesh.vertices)[limbed_rig.mesh.of_render]
    np.testing.assert_allclose(from_document(document).vertices, expected, atol=1e-5)


def test_more_than_four_influences_are_in_a_second_set(limbed_rig):
    eight = make_rig(limbed_rig, influences=8)
    document, _, _ = rigged_document(limbed_rig.character, eight, limbed_rig.mesh.of_render)
    attributes = document.gltf["meshes"][0]["primitives"][0]["attributes"]
    sets = [document.array(attributes[f"WEIGHTS_{number}"]) for number in (0, 1)]
    np.testing.assert_array_equal(np.hstack(sets), eight.weights.weights[limbed_rig.mesh.of_render])


def test_the_khronos_validator_has_nothing_against_rigs(node, limbed_puppet, tmp_path):
    rig = load_rig(limbed_puppet)
    files = []
    for in_t_pose in (False, True):
        made = make_rig(rig, in_t_pose=in_t_pose)
        files.append(tmp_path / f"{in_t_pose}.glb")
        rigged_document(rig.character, made, rig.mesh.of_render)[0].save(files[-1])
    for report in json.loads(node("validate.mjs", *map(str, files))).values():
        assert (report["errors"], report["warnings"]) == (0, 0), report["messages"]
