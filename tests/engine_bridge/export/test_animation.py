import json

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import load_character
from engine_bridge.export.animation import Keyframes, animate
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

from .conftest import REAL, assert_same_array, assert_same_primitive, between_keys, by_part, normal_angles


def test_the_khronos_validator_has_nothing_against_it_that_it_did_not_have_before(export, validate):
    def faults(path):
        return {(each["code"], each["severity"]) for each in validate(path)["messages"] if each["severity"] < 2}

    assert export.variant.name in REAL or not faults(export.variant.path)
    assert faults(export.path) <= faults(export.variant.path)


def test_three_plays_what_was_solved_at_the_keys_and_straight_lines_between(export, play, solved):
    expected = by_part(export.clip, between_keys(solved(export.clip)))
    played = play(export.path, 39)
    # what the exporter says it may be off by, and what float32 adds
    allowed = (export.summary.error + 2e-6) * export.clip.rig.mesh.diagonal
    for mesh, positions in zip(played.meshes, expected, strict=True):
        assert np.linalg.norm(mesh.positions - positions, axis=-1).max() <= allowed


@pytest.mark.parametrize("name", ["textured", "node_transforms"])
def test_normals_are_within_a_few_degrees_of_the_moved_surface(exports, play, solved, name):
    export = exports[name, True]
    mesh = export.clip.rig.mesh
    seen = np.concatenate([part.normals for part in play(export.path, 20).meshes], axis=1)
    assert np.percentile(normal_angles(seen, solved(export.clip)[::3], mesh), 99) < 3


def test_the_largest_error_is_the_one_that_is_printed(export, raw, solved):
    made, diagonal = raw(export.path), export.clip.rig.mesh.diagonal
    moved = solved(export.clip) - (0 if export.clip.rig.puppet.root is None else export.clip.root[:, None])
    worst = 0.0
    for part, expected in zip(export.clip.rig.character.parts, by_part(export.clip, moved), strict=True):
        primitive = made.file.meshes[made.file.nodes[part.node].mesh].primitives[part.primitive]
        rest = made.array(primitive.attributes.POSITION).astype(np.float64)
        targets = np.array([made.array(target["POSITION"]) for target in primitive.targets], dtype=np.float64)
        local = rest + np.tensordot(made.weights(part.node), targets, axes=1)
        linear, offset = part.to_world[:, :3, :3], part.to_world[:, :3, 3]
        world = np.einsum("nij,fnj->fni", np.broadcast_to(linear, (len(rest), 3, 3)), local) + offset
        worst = max(worst, np.linalg.norm(world - expected, axis=-1).max())
    if export.variant.name not in REAL:
        assert worst / diagonal == pytest.approx(export.summary.error, abs=1e-6)
    assert worst / diagonal <= export.summary.error + 1e-6 <= export.summary.tolerance + 1e-6


def test_content_of_the_original_file_is_kept_to_the_bit(export, raw):
    before, after = raw(export.variant.path), raw(export.path)
    for node, same in zip(before.file.nodes, after.file.nodes, strict=False):
        for key in ("name", "matrix", "rotation", "scale", "translation", "children", "skin", "extras"):
            assert getattr(node, key) == getattr(same, key)
        if node.mesh is not None:
            was, now = before.file.meshes[node.mesh], after.file.meshes[same.mesh]
            assert was.name == now.name
            for old, new in zip(was.primitives, now.primitives, strict=True):
                assert_same_primitive(before, old, after, new)
    for kind in ("materials", "textures", "samplers", "cameras", "extensions", "extensionsRequired", "extras"):
        assert getattr(before.file, kind) == getattr(after.file, kind)
    for old, new in zip(before.file.images, after.file.images, strict=True):
        assert old.name == new.name
        assert old.mimeType in (None, new.mimeType)  # a file beside has none
        assert picture(before, old, export.variant.path) == picture(after, new, export.path)
    for old, new in zip(before.file.skins, after.file.skins, strict=True):
        assert (old.joints, old.skeleton, old.name) == (new.joints, new.skeleton, new.name)
        assert_same_array(before, old.inverseBindMatrices, after, new.inverseBindMatrices)
    for old, new in zip(before.file.animations, after.file.animations[1:], strict=True):  # the first one is ours
        assert old.channels == new.channels
        for was, now in zip(old.samplers, new.samplers, strict=True):
            assert_same_array(before, was.input, after, now.input)
            assert_same_array(before, was.output, after, now.output)


def picture(made, image, path):
    return made.view(image.bufferView) if image.uri is None else (path.parent / image.uri).read_bytes()


def test_targets_have_names_and_those_that_were_there_keep_theirs_and_their_weights(exports, raw):
    export = exports["own_targets", True]
    made = raw(export.path)
    mesh, count = made.file.meshes[0], export.summary.targets
    assert mesh.extras == {"author": "test", "targetNames": ["smile", "frown", *(f"motion_{i}" for i in range(count))]}
    assert mesh.weights == [0.25, 0, *[0] * count]
    assert_array_equal(made.weights(0)[:, :2], np.tile([0.25, 0], (58, 1)))
    (animation,) = made.file.animations
    assert animation.name == "dance"
    assert {sampler.interpolation for sampler in animation.samplers} == {"LINEAR"}
    (clock,) = {sampler.input for sampler in animation.samplers}
    assert_allclose(made.array(clock)[:, 0], np.arange(58) / 30, rtol=1e-7)


def test_a_mesh_that_two_nodes_show_is_moved_by_each_in_its_own_way(exports, raw):
    made = raw(exports["shared_mesh", True].path)
    left, right = (made.file.nodes[index].mesh for index in (0, 1))
    assert left != right
    ours, theirs = (made.file.meshes[mesh].primitives[0] for mesh in (left, right))
    assert (vars(ours.attributes), ours.indices) == (vars(theirs.attributes), theirs.indices)


def test_the_root_is_one_node_above_all_others(exports, raw):
    for (name, root), export in exports.items():
        made = raw(export.path)
        if not root:
            assert [node.name for node in made.file.nodes].count("puppetline_root") == 0
            continue
        top, *hanging = made.file.scenes[made.file.scene or 0].nodes
        node = made.file.nodes[top]
        assert (node.name, top) == ("puppetline_root", len(made.file.nodes) - 1)
        before = raw(export.variant.path).file
        children = before.scenes[0].nodes if before.scenes else [0]
        assert (node.children + hanging) == children, name
        assert hanging == ([2] if name == "skinned" else [])
        channel = next(c for c in made.file.animations[0].channels if c.target.path == "translation")
        assert channel.target.node == top
        output = made.file.animations[0].samplers[channel.sampler].output
        assert_array_equal(made.array(output), export.clip.root)


def test_a_performer_who_stands_still_gives_a_valid_file_without_targets(
    record, standing, variants, write_puppet, tmp_path, raw, assert_valid_gltf
):
    log = record(tmp_path / "still.log", np.tile(standing, (5, 1, 1)))
    mesh = variants["own_targets"].path
    for root in (True, False):
        puppet = write_puppet(mesh.with_name(f"still_{root}.toml"), mesh.name, root=root)
        _, summary = convert(log, puppet, tmp_path / f"{root}.glb", Settings())
        assert summary.targets == 0
        assert_valid_gltf(tmp_path / f"{root}.glb")
        file = raw(tmp_path / f"{root}.glb").file
        assert [channel.target.path for a in file.animations for channel in a.channels] == ["translation"] * root
        assert file.meshes[0].weights == [0.25, 0]
        assert json.loads(json.dumps(file.meshes[0].extras))["targetNames"] == ["smile", "frown"]


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.uint16)
STILL = Keyframes("still", np.float32([0, 1]), np.zeros((2, 1), np.float32), np.zeros((2, 3), np.float32))


def animated_without_motion(path):
    """A character before and after export with a target that moves it by 1 in each direction, with weight 0."""
    character = load_character(path)
    moved = [(np.ones((1, *part.vertices.shape), np.float32), None) for part in character.parts]
    animate(character, STILL, moved.__getitem__).save(path)
    return character, load_character(path)


def test_a_primitive_without_positions_gets_no_targets(glb, tmp_path):
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES), gltf.Primitive(attributes=gltf.Attributes())))
    _, again = animated_without_motion(glb.save(tmp_path / "a.glb"))
    assert [len(each.get("targets", [])) for each in again.document.gltf["meshes"][0]["primitives"]] == [1, 0]


def test_a_mesh_scaled_to_zero_by_its_node_is_not_animated(glb, tmp_path):
    mesh = glb.mesh(glb.primitive(CORNERS, SIDES))
    glb.node(mesh)
    glb.node(mesh, scale=[1e-40] * 3)
    before, after = animated_without_motion(glb.save(tmp_path / "a.glb"))
    assert_array_equal(after.vertices, before.vertices)
    targets = [each["primitives"][0]["targets"][0]["POSITION"] for each in after.document.gltf["meshes"]]
    assert sorted(after.document.array(target).max() for target in targets) == [0, 1]
