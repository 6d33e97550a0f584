import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import from_document
from engine_bridge.rigging.made_rig import make_rig
from engine_bridge.rigging.rig_document import rigged_document


@pytest.fixture(scope="module")
def made(limbed_figure):
    return make_rig(limbed_figure)


@pytest.fixture(scope="module")
def rigged(limbed_figure, made):
    """The document, and the nodes of the joints."""
    document, nodes, _ = rigged_document(limbed_figure.character, made, limbed_figure.mesh.of_render)
    return document, nodes


def test_a_turned_joint_turns_its_vertices_about_it(rigged, limbed_figure, made):
    """Linear blend skinning by the weights, with the elbow bent by hand."""
    document, nodes = (rigged[0].copy(), rigged[1])
    elbow = made.skeleton.names.index("leftLowerArm")
    node = document.gltf["nodes"][nodes[elbow]]
    quarter = Rotation.from_euler("x", 90, degrees=True)  # about its own axis
    node["rotation"] = (Rotation.from_quat(node["rotation"]) * quarter).as_quat().tolist()
    axes, head = made.skeleton.axes[elbow], made.skeleton.joints[elbow].head
    turn = axes @ quarter.as_matrix() @ axes.T
    below = [name in ("leftLowerArm", "leftHand") for name in made.skeleton.names]
    joints, weights = (
        made.weights.bones[limbed_figure.mesh.of_render],
        made.weights.weights[limbed_figure.mesh.of_render],
    )
    share, rest = (np.array(below)[joints] * weights).sum(axis=1, keepdims=True), limbed_figure.character.vertices
    expected = (1 - share) * rest + share * ((rest - head) @ turn.T + head)
    assert_allclose(from_document(document).vertices, expected, atol=1e-6)


def test_a_t_pose_is_where_the_surface_was_straightened_and_more_influences_are_in_a_second_set(
    limbed_figure, tmp_path, assert_valid_gltf
):
    straight = make_rig(limbed_figure, in_t_pose=True, influences=8)
    document, _, _ = rigged_document(limbed_figure.character, straight, limbed_figure.mesh.of_render)
    expected = straight.bind.vertices(limbed_figure.mesh.vertices)[limbed_figure.mesh.of_render]
    assert_allclose(from_document(document).vertices, expected, atol=1e-5)
    attributes = document.gltf["meshes"][0]["primitives"][0]["attributes"]
    sets = [document.array(attributes[f"WEIGHTS_{number}"]) for number in (0, 1)]
    assert_array_equal(np.hstack(sets), straight.weights.weights[limbed_figure.mesh.of_render])
    document.save(tmp_path / "straight.glb")
    assert_valid_gltf(tmp_path / "straight.glb")
