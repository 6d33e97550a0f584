"""All variants of the figure with rigs that are made, read by pygltflib and played by three.js."""

from pathlib import Path

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

from .conftest import Raw, add_animation, assert_same_primitive

FRAMES = 20
MIRRORED = {"node_transforms": 0, "shared_mesh": 1}
"""Variants with a mirrored part, and its number; its triangles must be flipped."""
IN_THE_WORLD = {"textured", "colored", "float_colors", "without_normals", "without_indices", "several_primitives"}
"""Variants whose vertices are in world coordinates already."""


@pytest.fixture(scope="module")
def short_take(record, dance, tmp_path_factory):
    """A recording of every third frame of the dance."""
    frames = dance()[::3]
    assert len(frames) == FRAMES
    return record(tmp_path_factory.mktemp("short") / "dance.log", frames)


@pytest.fixture(scope="module")
def rigs(variants, short_take, write_puppet):
    """All variants with a joint per handle: the variant, the clip and the summary."""

    def make(variant):
        puppet = write_puppet(variant.path.with_name(f"{variant.name}_rig.toml"), variant.path.name)
        output = variant.path.with_name(f"{variant.name}_rig.glb")
        return variant, *convert(short_take, puppet, output, Settings(form="rig"))

    return {name: make(variant) for name, variant in variants.items()}


@pytest.fixture
def rig(variant, rigs):
    """Each variant in turn."""
    return rigs[variant.name]


def test_three_plays_what_was_solved_within_the_reported_error_from_a_valid_file(rig, play, solved, assert_valid_gltf):
    _, clip, summary = rig
    assert_valid_gltf(Path(summary.output))
    expected = solved(clip)
    seen = {}
    for mesh in play(Path(summary.output), FRAMES).meshes:
        seen.setdefault(mesh.positions.shape[1], []).append(mesh.positions)
    # nodes at the top of the scene may stand in another order: each part is looked for among those of its size
    for place in clip.rig.character.vertex_slices:
        positions = expected[:, clip.rig.mesh.of_render[place]]
        off = [np.linalg.norm(found - positions, axis=-1).max() for found in seen[positions.shape[1]]]
        assert min(off) <= (summary.error + 2e-6) * clip.rig.mesh.diagonal
    assert sum(map(len, seen.values())) == len(clip.rig.character.parts)


def test_the_rest_pose_is_the_surface_with_its_normals_and_its_winding(rig, raw):
    variant, clip, summary = rig
    made = raw(summary.output)
    (table,) = made.file.skins
    assert table.name == "skeleton"
    inverse = made.array(table.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    places = np.array([made.file.nodes[joint].translation or [0, 0, 0] for joint in table.joints], dtype=np.float64)
    inverse[:, :3, 3] += np.float32(places)
    assert_array_equal(inverse, np.tile(np.eye(4), (len(inverse), 1, 1)))
    weights_of = {}
    for part, place in zip(clip.rig.character.parts, clip.rig.character.vertex_slices, strict=True):
        mesh = made.file.meshes[made.file.nodes[part.node].mesh]
        primitive = mesh.primitives[part.primitive]
        named = primitive.attributes
        positions = made.array(named.POSITION).astype(np.float64)
        for target, weight in zip(primitive.targets, mesh.weights or [], strict=False):
            positions += weight * made.array(target["POSITION"])
        assert np.abs(positions - part.vertices).max() < 1e-6 * clip.rig.mesh.diagonal
        if part.normals is not None:
            within = 0.02 if variant.name == "own_targets" else 1e-4
            assert_allclose(made.array(named.NORMAL)[:, :3], part.normals, atol=within)
        if primitive.mode in (None, gltf.TRIANGLES) and primitive.indices is not None:
            corners = made.array(primitive.indices).reshape(-1, 3).astype(np.int64)
            assert_array_equal(corners, part.triangles)
        shares = np.hstack([made.array(named.JOINTS_0), made.array(named.WEIGHTS_0)]).tolist()
        for vertex, own in zip(clip.rig.mesh.of_render[place].tolist(), shares, strict=True):
            assert weights_of.setdefault(vertex, own) == own  # vertices at one place move together


def test_content_that_does_not_move_is_kept_to_the_bit(rig, raw):
    variant, clip, summary = rig
    before, after = raw(variant.path), raw(summary.output)
    moved = {"JOINTS_0", "WEIGHTS_0"} | (set() if variant.name in IN_THE_WORLD else {"POSITION", "NORMAL"})
    for number, part in enumerate(clip.rig.character.parts):
        was, now = (f.file.meshes[f.file.nodes[part.node].mesh] for f in (before, after))
        assert (was.name, was.extras, was.weights) == (now.name, now.extras, now.weights)
        old, new = was.primitives[part.primitive], now.primitives[part.primitive]
        flipped = MIRRORED.get(variant.name) == number
        assert_same_primitive(before, old, after, new, moved | ({"indices"} if flipped else set()))
    for kind in ("materials", "textures", "samplers"):
        assert getattr(before.file, kind) == getattr(after.file, kind)
    for old, new in zip(before.file.images, after.file.images, strict=True):
        assert before.view(old.bufferView) == after.view(new.bufferView)
    names = [node.name for node in after.file.nodes]
    assert [node.name for node in before.file.nodes] == names[: len(before.file.nodes)]
    assert ("The character's own skeleton is replaced." in summary.notes) == (variant.name == "skinned")


def test_handles_become_joints_below_the_root(rigs, raw):
    _, _, summary = rigs["textured"]
    file = raw(summary.output).file
    (table,) = file.skins
    skeleton = file.nodes[table.skeleton]
    assert skeleton.name == "skeleton"
    (root,) = skeleton.children
    handles = file.nodes[root].children
    assert table.joints == [root, *handles]
    names = [file.nodes[joint].name for joint in table.joints]
    assert names == ["root", "hand_left", "hand_right", "head", "foot_left", "foot_right"]
    tops = file.scenes[file.scene].nodes
    assert all(file.nodes[top].skin == 0 for top in tops if top != table.skeleton)
    (animation,) = file.animations
    assert animation.name == "dance"
    moved = {(channel.target.node, channel.target.path) for channel in animation.channels}
    of_handles = {(joint, path) for joint in handles for path in ("rotation", "translation")}
    assert moved == of_handles | {(root, "translation")}


def test_lines_stand_on_the_skeleton_itself_where_their_node_is(
    variants, rigs, short_take, write_puppet, tmp_path, raw, assert_valid_gltf
):
    made = raw(rigs["with_lines"][2].output)
    lines, _ = made.file.meshes[0].primitives
    assert lines.mode == gltf.LINE_STRIP
    assert_array_equal(made.array(lines.attributes.JOINTS_0), np.zeros((10, 4)))
    assert_array_equal(made.array(lines.attributes.WEIGHTS_0), np.tile([1, 0, 0, 0], (10, 1)))

    before = Raw(variants["skinned"].path)
    (mesh,) = before.file.meshes
    bound = mesh.primitives[0].attributes.POSITION
    mesh.primitives.append(gltf.Primitive(attributes=gltf.Attributes(POSITION=bound), mode=gltf.LINE_STRIP))
    next(node for node in before.file.nodes if node.name == "elsewhere").translation = [1, 2, 3]
    before.file.save(tmp_path / "lined.glb")
    puppet = write_puppet(tmp_path / "lined.toml", "lined.glb")
    convert(short_take, puppet, tmp_path / "out.glb", Settings(form="rig"))
    assert_valid_gltf(tmp_path / "out.glb")
    made = raw(tmp_path / "out.glb")
    surface, lines = (primitive.attributes for primitive in made.file.meshes[0].primitives)
    assert_allclose(made.array(lines.POSITION), before.array(bound) + np.float32([1, 2, 3]), atol=1e-6)
    assert_allclose(made.array(surface.POSITION), variants["skinned"].shown[0], atol=1e-5)


@pytest.fixture
def furnished(glb, blob, tmp_path):
    """The figure under a moving node, a hat on its node, and animations: of the node, of the hat, of a smile.

    Each of them once by the node and once by a pointer.
    """
    smile = (blob.vertices * [0.0, 0.1, 0.2]).astype(np.float32)
    above = glb.node(name="above", translation=[0, 0, 1])
    tangents = np.column_stack([np.roll(blob.normals, 1, axis=1), np.ones(len(smile), np.float32)])
    more = {"NORMAL": blob.normals, "TANGENT": tangents}
    surface = glb.primitive(blob.vertices, blob.faces, targets=[{"POSITION": smile}], **more)
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


def test_a_node_comes_to_the_top_and_what_hangs_on_it_stays(
    furnished, short_take, write_puppet, tmp_path, raw, assert_valid_gltf
):
    handles = '[[handle]]\nname = "head"\nposition = [0.6, 4.2, 1.0]\njoint = "head"\n'
    puppet = write_puppet(tmp_path / "furnished.toml", "furnished.glb", handles=handles)
    _, summary = convert(short_take, puppet, tmp_path / "out.glb", Settings(form="rig"))
    assert_valid_gltf(tmp_path / "out.glb")
    file = raw(tmp_path / "out.glb").file
    body = next(node for node in file.nodes if node.name == "body")
    assert (body.translation, body.rotation, body.scale, body.matrix, body.children) == (None, None, None, None, [])
    assert file.nodes.index(body) in file.scenes[0].nodes
    (place,) = (file.nodes[child] for child in next(node for node in file.nodes if node.name == "above").children)
    assert (place.mesh, place.name, place.scale) == (None, None, [-2, 2, 2])
    assert [file.nodes[child].name for child in place.children] == ["hat"]
    assert [animation.name for animation in file.animations] == ["dance", "tip", "pointed tip", "grin", "pointed grin"]
    assert any("2 of the file's animations" in note for note in summary.notes)
    before, made = raw(furnished), raw(tmp_path / "out.glb")
    old, new = (f.file.meshes[0].primitives[0].attributes.TANGENT for f in (before, made))
    turned = before.array(old)[:, :3] @ (Rotation.from_euler("y", 90, degrees=True).as_matrix() @ np.diag([-1, 1, 1])).T
    assert_allclose(made.array(new)[:, :3], turned, atol=1e-6)
    assert_array_equal(made.array(new)[:, 3], -1)


@pytest.mark.parametrize("scale", [[0, 0, 0], [-1, 1, 0]])
def test_directions_that_are_scaled_to_nothing_point_up(
    scale, glb, blob, short_take, write_puppet, tmp_path, raw, assert_valid_gltf
):
    count, faces = len(blob.vertices), blob.faces
    towards_z = {
        name: np.tile(np.float32(value), (count, 1))
        for name, value in (("NORMAL", [0, 0, 1]), ("TANGENT", [0, 0, 1, -1]))
    }
    glb.show(blob.vertices, faces, NORMAL=blob.normals)
    glb.node(glb.mesh(glb.primitive(blob.vertices, faces, **towards_z)), scale=scale, name="hidden")
    glb.save(tmp_path / "hidden.glb")
    puppet = write_puppet(tmp_path / "hidden.toml", "hidden.glb")
    convert(short_take, puppet, tmp_path / "out.glb", Settings(form="rig"))
    assert_valid_gltf(tmp_path / "out.glb")
    made = raw(tmp_path / "out.glb")
    hidden = next(node for node in made.file.nodes if node.name == "hidden")
    attributes = made.file.meshes[hidden.mesh].primitives[0].attributes
    assert_array_equal(made.array(attributes.POSITION), blob.vertices * np.float32(scale))
    assert_array_equal(made.array(attributes.NORMAL), np.tile([0, 1, 0], (count, 1)))
    assert_array_equal(made.array(attributes.TANGENT), np.tile([0, 1, 0, -1], (count, 1)))
