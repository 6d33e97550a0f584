"""Compact files of every kind of character, played by three.js and compared with the solver."""

import numpy as np
import pygltflib as gltf
import pytest

from engine_bridge.character.document_reader import load_document
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings


@pytest.fixture
def distances(take, write_puppet, play, solved, assert_valid_gltf, tmp_path):
    """Convert a variant; return the summary, and the largest distance of each mesh from the solver in three.js."""

    def measure(variant, **choices):
        if choices.get("meshopt"):
            pytest.importorskip("meshoptimizer")
        puppet = write_puppet(tmp_path / "a.toml", variant.path)
        clip, summary = convert(take, puppet, tmp_path / "a.glb", Settings(**choices))
        assert_valid_gltf(tmp_path / "a.glb")
        played = play(tmp_path / "a.glb", len(clip.frames)).meshes
        follows = np.split(clip.rig.mesh.of_render, np.cumsum([len(part) for part in variant.shown])[:-1])
        expected = solved(clip)
        return summary, [
            np.linalg.norm(mesh.positions - (expected[:, of] + own), axis=-1).max() / clip.rig.mesh.diagonal
            for mesh, of, own in zip(played, follows, variant.offset, strict=True)
        ]

    return measure


def test_the_printed_error_is_that_of_the_file_in_three(variant, distances):
    summary, found = distances(variant, compact=True, meshopt=True)
    assert 0.9 * summary.error < max(found) <= summary.error + 1e-6
    assert summary.error <= summary.tolerance == 0.0005


@pytest.mark.parametrize("name", ["textured", "own_targets", "skinned"])
@pytest.mark.parametrize("form", ["morph", "frames"])
def test_integers_alone_have_the_printed_error(variants, distances, name, form):
    summary, found = distances(variants[name], compact=True, form=form)
    assert 0.9 * summary.error < max(found) <= summary.error + 1e-6
    assert summary.error <= summary.tolerance == 0.0005


@pytest.mark.parametrize("name", ["textured", "skinned"])
def test_compressed_floats_are_the_same_as_others(variants, distances, name):
    plain, shown = distances(variants[name])
    packed, same = distances(variants[name], meshopt=True)
    assert same == shown
    assert packed.bytes < plain.bytes


@pytest.mark.slow
@pytest.mark.parametrize("name", ["textured", "with_lines", "shared_mesh", "own_targets", "skinned"])
def test_a_compact_rig_is_within_the_printed_error(variants, distances, name):
    plain, _ = distances(variants[name], form="rig")
    summary, found = distances(variants[name], form="rig", compact=True, meshopt=True)
    assert max(found) <= summary.error + 1e-6
    assert plain.error < summary.error < plain.error + summary.tolerance + 1e-4
    assert summary.bytes < plain.bytes / 2


def test_what_is_not_part_of_the_surface_stays_bit_for_bit(variants, take, write_puppet, raw, tmp_path):
    """The mesh's own targets are scaled, but not rounded; its images, weights, joints and indices stay."""
    for name in ("textured", "own_targets", "skinned"):
        puppet = write_puppet(tmp_path / f"{name}.toml", variants[name].path)
        convert(take, puppet, tmp_path / "a.glb", Settings(compact=True))
        before, after = raw(variants[name].path), raw(tmp_path / "a.glb")
        for image, same in zip(before.file.images, after.file.images, strict=True):
            assert after.view(same.bufferView) == before.view(image.bufferView)
        old, new = before.file.meshes[0].primitives[0], after.file.meshes[0].primitives[0]
        np.testing.assert_array_equal(after.array(new.indices), before.array(old.indices))
        for attribute in ("JOINTS_0", "WEIGHTS_0"):
            if getattr(old.attributes, attribute) is not None:
                kept, given = (getattr(each.attributes, attribute) for each in (new, old))
                np.testing.assert_array_equal(after.array(kept), before.array(given))
        if name == "own_targets":
            scale = after.file.nodes[0].scale[0]
            for target, same in zip(old.targets, new.targets, strict=False):
                shown = after.array(same["POSITION"]) * scale
                np.testing.assert_allclose(shown, before.array(target["POSITION"]), rtol=2e-7)


def test_no_byte_is_in_the_file_without_a_use(variants, take, write_puppet, raw, tmp_path):
    for name in ("textured", "shared_mesh", "node_transforms"):
        puppet = write_puppet(tmp_path / f"{name}.toml", variants[name].path)
        convert(take, puppet, tmp_path / "a.glb", Settings(compact=True))
        made = raw(tmp_path / "a.glb")
        used = sum(view.byteLength + -view.byteLength % 4 for view in made.file.bufferViews)
        assert len(made.blob) <= used + 3


@pytest.mark.parametrize("change", ["children", "camera", "extensions", "scale"])
def test_a_node_whose_scale_moves_something_else_keeps_it(
    glb, take, write_puppet, play, solved, tmp_path, blob, change
):
    """Its targets are rounded floats."""
    mesh = glb.mesh(glb.primitive(blob.vertices, blob.faces.astype(np.uint32), NORMAL=blob.normals))
    node = glb.node(mesh, scale=[1, 1, 1])
    if change == "children":
        glb.node(parent=node, translation=[0, 3, 0])
    if change == "camera":
        glb.file.cameras = [gltf.Camera(type="perspective", perspective=gltf.Perspective(yfov=1, znear=0.1))]
        glb.file.nodes[node].camera = 0
    if change == "extensions":
        glb.file.extensionsUsed = ["KHR_lights_punctual"]
        glb.file.extensions = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
        glb.file.nodes[node].extensions = {"KHR_lights_punctual": {"light": 0}}
    if change == "scale":
        sampler = gltf.AnimationSampler(input=glb.add(np.float32([0, 1]), None), output=glb.add(np.ones((2, 3), "f4")))
        channel = gltf.AnimationChannel(sampler=0, target=gltf.AnimationChannelTarget(node=node, path="scale"))
        glb.file.animations.append(gltf.Animation(channels=[channel], samplers=[sampler]))
    puppet = write_puppet(tmp_path / "a.toml", glb.save(tmp_path / "character.glb"))
    clip, summary = convert(take, puppet, tmp_path / "a.glb", Settings(compact=True))
    document = load_document(tmp_path / "a.glb")
    assert document.gltf["nodes"][node]["scale"] == [1, 1, 1]
    (played,) = play(tmp_path / "a.glb", len(clip.frames)).meshes
    missed = played.positions - solved(clip)[:, clip.rig.mesh.of_render]
    assert np.linalg.norm(missed, axis=-1).max() <= (summary.error + 1e-6) * clip.rig.mesh.diagonal


def test_normals_are_about_as_exact_as_without(variants, take, write_puppet, play, tmp_path):
    puppet = write_puppet(tmp_path / "a.toml", variants["textured"].path)
    seen = []
    for choices in ({}, {"compact": True}, {"compact": True, "meshopt": True}):
        convert(take, puppet, tmp_path / "a.glb", Settings(**choices))
        seen.append(play(tmp_path / "a.glb", 20).meshes[0].normals)
    for normals in seen[1:]:
        angles = np.degrees(np.arccos(np.clip(np.einsum("fvc,fvc->fv", normals, seen[0]), -1, 1)))
        assert np.percentile(angles, 99) < 1.5
        assert np.median(angles) < 0.5
