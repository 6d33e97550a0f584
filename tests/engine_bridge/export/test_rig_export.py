"""Characters with rigs that are made: joints of handles, what hangs on a character, lines, and directions."""

from itertools import product

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

from ..character.conftest import CORNERS, SIDES
from .conftest import Raw, add_animation


@pytest.fixture
def rigged(take, write_puppet, tmp_path, assert_valid_gltf):
    """Rig a file by handles; return the valid export as it is read back, and the summary."""

    def make(mesh, **options):
        puppet = write_puppet(tmp_path / "rigged.toml", mesh, **options)
        _, summary = convert(take, puppet, tmp_path / "rigged.glb", Settings(form="rig"))
        assert_valid_gltf(tmp_path / "rigged.glb")
        return Raw(tmp_path / "rigged.glb"), summary

    return make


def test_handles_become_joints_below_the_root(exported):
    file = Raw(exported("textured", "rig").path).file
    (skin,), (animation,) = file.skins, file.animations
    (root,) = file.nodes[skin.skeleton].children
    assert skin.joints == [root, *(handles := file.nodes[root].children)]
    names = [file.nodes[joint].name for joint in (skin.skeleton, *skin.joints)]
    assert names == ["skeleton", "root", "hand_left", "hand_right", "head", "foot_left", "foot_right"]
    moved = {(channel.target.node, channel.target.path) for channel in animation.channels}
    assert moved == {(root, "translation"), *product(handles, ("rotation", "translation"))}


def test_lines_stand_on_the_skeleton_itself_where_their_node_is(variants, rigged, tmp_path):
    before = Raw(variants["skinned"].path)
    (mesh,) = before.file.meshes
    bound = mesh.primitives[0].attributes.POSITION
    mesh.primitives.append(gltf.Primitive(attributes=gltf.Attributes(POSITION=bound), mode=gltf.LINE_STRIP))
    next(node for node in before.file.nodes if node.name == "elsewhere").translation = [1, 2, 3]
    before.file.save(tmp_path / "lined.glb")
    made, _ = rigged("lined.glb")
    surface, lines = (primitive.attributes for primitive in made.file.meshes[0].primitives)
    assert_allclose(made.array(lines.POSITION), before.array(bound) + np.float32([1, 2, 3]), atol=1e-6)
    assert_allclose(made.array(surface.POSITION), variants["skinned"].shown[0], atol=1e-5)
    assert not made.array(lines.JOINTS_0).any()


@pytest.fixture
def furnished(glb, blob, tmp_path):
    """The figure under a moving node, a hat on its node, and animations: of the node, of the hat, of a smile.

    Each of them once by the node and once by a pointer.
    """
    above = glb.node(name="above", translation=[0, 0, 1])
    tangents = np.pad(np.roll(blob.normals, 1, axis=1), [(0, 0), (0, 1)], constant_values=1)
    smile = [{"POSITION": np.float32(blob.vertices * [0.0, 0.1, 0.2])}]
    surface = glb.primitive(blob.vertices, blob.faces, targets=smile, NORMAL=blob.normals, TANGENT=tangents)
    turn = Rotation.from_euler("y", 90, degrees=True).as_quat().tolist()
    body = glb.node(glb.mesh(surface, weights=[0.5]), above, name="body", rotation=turn, scale=[-2.0, 2.0, 2.0])
    hat = glb.node(parent=body, name="hat", translation=[0, 2, 0])
    glb.file.extensionsUsed = ["KHR_animation_pointer"]
    for name, node, path, values in (
        ("walk", above, "translation", [[0, 0, 0], [1, 0, 0]]),
        ("tip", hat, "translation", [[0, 2, 0], [0, 3, 0]]),
        ("grin", body, "weights", [0, 1]),
    ):
        add_animation(glb, name, node, path, [0, 1], values)
        add_animation(glb, f"pointed {name}", node, path, [0, 1], values, pointer=f"/nodes/{node}/{path}")
    return glb.save(tmp_path / "furnished.glb")


def test_a_node_comes_to_the_top_and_what_hangs_on_it_stays(furnished, rigged):
    handles = '[[handle]]\nname = "head"\nposition = [0.6, 4.2, 1.0]\njoint = "head"\n'
    made, summary = rigged(furnished, handles=handles)
    file = made.file
    nodes = {node.name: node for node in file.nodes}
    body, (place,) = nodes["body"], (file.nodes[child] for child in nodes["above"].children)
    assert (body.translation, body.rotation, body.scale, body.matrix, body.children) == (None, None, None, None, [])
    assert file.nodes.index(body) in file.scenes[0].nodes
    assert (place.mesh, place.name, place.scale) == (None, None, [-2, 2, 2])
    assert [file.nodes[child].name for child in place.children] == ["hat"]
    assert [animation.name for animation in file.animations] == ["dance", "tip", "pointed tip", "grin", "pointed grin"]
    assert any("2 of the file's animations" in note for note in summary.notes)
    before = Raw(furnished)
    old, new = (f.file.meshes[0].primitives[0].attributes.TANGENT for f in (before, made))
    turned = before.array(old)[:, :3] @ (Rotation.from_euler("y", 90, degrees=True).as_matrix() @ np.diag([-1, 1, 1])).T
    assert_allclose(made.array(new)[:, :3], turned, atol=1e-6)
    assert_array_equal(made.array(new)[:, 3], -1)


@pytest.mark.parametrize("scale", [[0, 0, 0], [-1, 1, 0]])
def test_directions_that_are_scaled_to_nothing_point_up(scale, glb, blob, rigged, tmp_path):
    towards_z = {"NORMAL": np.float32([[0, 0, 1]] * 4), "TANGENT": np.float32([[0, 0, 1, -1]] * 4)}
    glb.show(blob.vertices, blob.faces, NORMAL=blob.normals)
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES, **towards_z)), scale=scale, name="hidden")
    made, _ = rigged(glb.save(tmp_path / "hidden.glb"))
    hidden = next(node for node in made.file.nodes if node.name == "hidden")
    attributes = made.file.meshes[hidden.mesh].primitives[0].attributes
    shown = [made.array(getattr(attributes, name)) for name in ("POSITION", "NORMAL", "TANGENT")]
    assert_array_equal(np.hstack(shown), np.hstack([CORNERS * np.float32(scale), [[0, 1, 0, 0, 1, 0, -1]] * 4]))
