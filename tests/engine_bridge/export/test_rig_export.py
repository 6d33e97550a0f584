"""All variants of the figure with rigs that are made, read by pygltflib and played by three.js."""

import json
from pathlib import Path

import numpy as np
import pygltflib as gltf
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

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


def parts(made, clip):
    """The primitives of the character's parts."""
    return [made.file.meshes[made.file.nodes[p.node].mesh].primitives[p.primitive] for p in clip.rig.character.parts]


def follows(clip):
    counts = [len(part.vertices) for part in clip.rig.character.parts]
    return np.split(clip.rig.mesh.of_render, np.cumsum(counts)[:-1])


def test_the_khronos_validator_has_nothing_against_any(rigs, node):
    reports = json.loads(node("validate.mjs", *[summary.output for _, _, summary in rigs.values()]))
    for path, report in reports.items():
        assert (report["errors"], report["warnings"]) == (0, 0), (path, report["messages"])


def test_three_plays_what_was_solved_within_the_reported_error(rig, play, solved):
    variant, clip, summary = rig
    expected = solved(clip)
    diagonal = clip.rig.mesh.diagonal
    seen = {}
    for mesh in play(Path(summary.output), FRAMES).meshes:
        seen.setdefault(mesh.positions.shape[1], []).append(mesh.positions)
    # nodes at the top of the scene may stand in another order: each part is looked for among those of its size
    for of, own in zip(follows(clip), variant.offset, strict=True):
        off = [np.linalg.norm(positions - expected[:, of] - own, axis=-1).max() for positions in seen[len(of)]]
        assert min(off) <= (summary.error + 2e-6) * diagonal
    assert sum(map(len, seen.values())) == len(clip.rig.character.parts)


def test_the_rest_pose_is_exact(rig, raw):
    _, clip, summary = rig
    made = raw(summary.output)
    table = made.file.skins[0]
    inverse = made.array(table.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    places = np.array([made.file.nodes[joint].translation or [0, 0, 0] for joint in table.joints], dtype=np.float64)
    inverse[:, :3, 3] += np.float32(places)
    np.testing.assert_array_equal(inverse, np.tile(np.eye(4), (len(inverse), 1, 1)))
    for part, primitive in zip(clip.rig.character.parts, parts(made, clip), strict=True):
        positions = made.array(primitive.attributes.POSITION).astype(np.float64)
        mesh = made.file.meshes[made.file.nodes[part.node].mesh]
        for target, weight in zip(primitive.targets, mesh.weights or [], strict=False):
            positions += weight * made.array(target["POSITION"])
        assert np.abs(positions - part.vertices).max() < 1e-6 * clip.rig.mesh.diagonal


def test_normals_are_those_of_the_surface_at_rest(rig, raw):
    _, clip, summary = rig
    made = raw(summary.output)
    for part, primitive in zip(clip.rig.character.parts, parts(made, clip), strict=True):
        if part.normals is not None:
            normals = made.array(primitive.attributes.NORMAL)[:, :3]
            np.testing.assert_allclose(normals, part.normals, atol=0.02 if "own" in summary.output else 1e-4)


def test_triangles_face_outwards(rig, raw):
    """Triangles have the same winding as in the world, including mirrored ones."""
    _, clip, summary = rig
    made = raw(summary.output)
    for part, primitive in zip(clip.rig.character.parts, parts(made, clip), strict=True):
        if primitive.mode in (None, gltf.TRIANGLES) and primitive.indices is not None:
            corners = made.array(primitive.indices).reshape(-1, 3).astype(np.int64)
            np.testing.assert_array_equal(corners, part.triangles)


def test_content_that_does_not_move_is_kept_to_the_bit(rig, raw):
    variant, clip, summary = rig
    before, after = raw(variant.path), raw(summary.output)
    kept = variant.name in IN_THE_WORLD
    for number, part in enumerate(clip.rig.character.parts):
        was, now = (f.file.meshes[f.file.nodes[part.node].mesh] for f in (before, after))
        assert (was.name, was.extras, was.weights) == (now.name, now.extras, now.weights)
        old, new = was.primitives[part.primitive], now.primitives[part.primitive]
        assert old.material == new.material
        if MIRRORED.get(variant.name) != number:
            assert old.mode == new.mode
            assert_same(before, old.indices, after, new.indices)
        for name, accessor in vars(old.attributes).items():
            moved = ("JOINTS_0", "WEIGHTS_0") if kept else ("JOINTS_0", "WEIGHTS_0", "POSITION", "NORMAL")
            if name not in moved:
                assert_same(before, accessor, after, getattr(new.attributes, name))
    for kind in ("materials", "textures", "samplers"):
        assert getattr(before.file, kind) == getattr(after.file, kind)
    for old, new in zip(before.file.images, after.file.images, strict=True):
        assert before.view(old.bufferView) == after.view(new.bufferView)
    assert [node.name for node in before.file.nodes] == [
        node.name for node in after.file.nodes[: len(before.file.nodes)]
    ]


def assert_same(before, old, after, new):
    if old is None:
        assert new is None
        return
    assert before.array(old).tobytes() == after.array(new).tobytes()


def test_vertices_at_one_place_have_the_same_weights(rigs, raw):
    _, clip, summary = rigs["several_primitives"]
    made = raw(summary.output)
    left, right = parts(made, clip)
    of_left, of_right = follows(clip)
    shared, i, j = np.intersect1d(of_left, of_right, return_indices=True)
    assert len(shared) > 20
    for name in ("JOINTS_0", "WEIGHTS_0"):
        a, b = (made.array(getattr(primitive.attributes, name)) for primitive in (left, right))
        np.testing.assert_array_equal(a[i], b[j])


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


def test_lines_stand_on_the_skeleton_itself(rigs, raw):
    _, _, summary = rigs["with_lines"]
    made = raw(summary.output)
    lines, _ = made.file.meshes[0].primitives
    assert lines.mode == gltf.LINE_STRIP
    np.testing.assert_array_equal(made.array(lines.attributes.JOINTS_0), np.zeros((10, 4)))
    np.testing.assert_array_equal(made.array(lines.attributes.WEIGHTS_0), np.tile([1, 0, 0, 0], (10, 1)))


def test_own_targets_stay_with_their_weights(rigs, raw):
    _, _, summary = rigs["own_targets"]
    mesh = raw(summary.output).file.meshes[0]
    assert mesh.weights == [0.25, 0]
    assert mesh.extras == {"author": "test", "targetNames": ["smile", "frown"]}


def test_a_skeleton_of_its_own_is_replaced_and_said_to_be(rigs, raw):
    _, _, summary = rigs["skinned"]
    file = raw(summary.output).file
    assert "The character's own skeleton is replaced." in summary.notes
    assert [table.name for table in file.skins] == ["skeleton"]
    assert {node.skin for node in file.nodes if node.mesh is not None} == {0}


@pytest.fixture
def furnished(glb, blob, tmp_path):
    """The figure under a moving node, a hat on its node, and animations: of the node, of the hat, of a smile.

    Each of them once by the node and once by a pointer.
    """
    smile = (blob.vertices * [0.0, 0.1, 0.2]).astype(np.float32)
    faces = blob.faces.astype(np.uint32)
    above = glb.node(name="above", translation=[0, 0, 1])
    tangents = np.column_stack([np.roll(blob.normals, 1, axis=1), np.ones(len(smile), np.float32)])
    more = {"NORMAL": blob.normals, "TANGENT": tangents}
    surface = glb.primitive(blob.vertices, faces, targets=[{"POSITION": smile}], **more)
    body = glb.node(glb.mesh(surface, weights=[0.5]), above, name="body")
    glb.file.nodes[body].rotation = Rotation.from_euler("y", 90, degrees=True).as_quat().tolist()
    glb.file.nodes[body].scale = [-2.0, 2.0, 2.0]
    hat = glb.node(parent=body, name="hat", translation=[0, 2, 0])
    clock = glb.add(np.float32([0, 1]), None)

    def animation(name, node, path, values):
        sampler = gltf.AnimationSampler(input=clock, output=glb.add(np.float32(values), None))
        target = gltf.AnimationChannelTarget(node=node, path=path)
        channel = gltf.AnimationChannel(sampler=0, target=target)
        glb.file.animations.append(gltf.Animation(name=name, samplers=[sampler], channels=[channel]))

    animation("walk", above, "translation", [[0, 0, 0], [1, 0, 0]])
    animation("tip", hat, "translation", [[0, 2, 0], [0, 3, 0]])
    animation("grin", body, "weights", [0, 1])

    def pointer_animation(name, pointer, values):
        animation(name, None, "pointer", values)
        target = glb.file.animations[-1].channels[0].target
        target.extensions = {"KHR_animation_pointer": {"pointer": pointer}}

    glb.file.extensionsUsed = ["KHR_animation_pointer"]
    pointer_animation("pointed walk", f"/nodes/{above}/translation", [[0, 0, 0], [1, 0, 0]])
    pointer_animation("pointed tip", f"/nodes/{hat}/scale", [[1, 1, 1], [2, 2, 2]])
    pointer_animation("pointed grin", f"/nodes/{body}/weights", [0, 1])
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
    assert [animation.name for animation in file.animations] == ["dance", "tip", "grin", "pointed tip", "pointed grin"]
    assert "Omitted 2 of the file's animations, which moved the character's nodes or skeleton." in summary.notes
    before, made = raw(furnished), raw(tmp_path / "out.glb")
    old, new = (f.file.meshes[0].primitives[0].attributes.TANGENT for f in (before, made))
    turned = before.array(old)[:, :3] @ (Rotation.from_euler("y", 90, degrees=True).as_matrix() @ np.diag([-1, 1, 1])).T
    np.testing.assert_allclose(made.array(new)[:, :3], turned, atol=1e-6)
    np.testing.assert_array_equal(made.array(new)[:, 3], -1)


@pytest.mark.parametrize("scale", [[0, 0, 0], [1, 1, 0], [-1, 1, 0]])
def test_directions_that_are_scaled_to_nothing_point_up(
    scale, glb, blob, short_take, write_puppet, tmp_path, raw, assert_valid_gltf
):
    count, faces = len(blob.vertices), blob.faces.astype(np.uint32)
    towards_z = {
        "NORMAL": np.tile(np.float32([0, 0, 1]), (count, 1)),
        "TANGENT": np.tile(np.float32([0, 0, 1, -1]), (count, 1)),
    }
    glb.node(glb.mesh(glb.primitive(blob.vertices, faces, NORMAL=blob.normals)))
    glb.node(glb.mesh(glb.primitive(blob.vertices, faces, **towards_z)), scale=scale, name="hidden")
    glb.save(tmp_path / "hidden.glb")
    puppet = write_puppet(tmp_path / "hidden.toml", "hidden.glb")
    convert(short_take, puppet, tmp_path / "out.glb", Settings(form="rig"))
    assert_valid_gltf(tmp_path / "out.glb")
    made = raw(tmp_path / "out.glb")
    hidden = next(node for node in made.file.nodes if node.name == "hidden")
    attributes = made.file.meshes[hidden.mesh].primitives[0].attributes
    np.testing.assert_array_equal(made.array(attributes.POSITION), blob.vertices * np.float32(scale))
    np.testing.assert_array_equal(made.array(attributes.NORMAL), np.tile([0, 1, 0], (count, 1)))
    np.testing.assert_array_equal(made.array(attributes.TANGENT), np.tile([0, 1, 0, -1], (count, 1)))


def test_lines_without_joints_stand_where_their_node_is(
    variants, short_take, write_puppet, tmp_path, raw, assert_valid_gltf
):
    before = raw(variants["skinned"].path)
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
    np.testing.assert_allclose(made.array(lines.POSITION), before.array(bound) + np.float32([1, 2, 3]), atol=1e-6)
    np.testing.assert_allclose(made.array(surface.POSITION), variants["skinned"].shown[0], atol=1e-5)
    np.testing.assert_array_equal(made.array(lines.JOINTS_0), 0)
