"""The .glb for shaders compared with the scene message, vertex by vertex."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_array_equal, assert_equal

from engine_bridge.character.character import load_character
from engine_bridge.character.materials import preview_colors
from engine_bridge.cli.main import main
from engine_bridge.export.shader_mesh import write_shader_mesh
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.service.protocol.scene import DecodedScene, StreamedCharacter
from puppetline.errors import OutputError, PuppetError

from ..refusals import refused, refused_place
from .conftest import Raw, primitives


def column(made, name):
    """One attribute of all surfaces, one after another."""
    return np.concatenate([made.array(getattr(each.attributes, name)) for each in primitives(made)])


def scene_of(path):
    return DecodedScene.decode(StreamedCharacter("character", load_prepared(path), 1).scene)


def assert_is_the_scene(made, scene):
    """Assert that the file has the same data at each vertex as the scene message."""
    arrays, count, fields = scene.arrays, scene.facts["vertices"], scene.facts["fields"]
    assert_array_equal(column(made, "POSITION"), arrays["positions"])
    directed = arrays["normals"].any(axis=1)
    assert_array_equal(column(made, "NORMAL")[directed], arrays["normals"][directed])
    isoline_coordinates = np.hstack([column(made, f"TEXCOORD_{number}") for number in range(2, 6)])
    assert_array_equal(isoline_coordinates, np.pad(arrays["ladder"], [(0, 0), (0, 8 - fields)]))
    assert_array_equal(column(made, "TEXCOORD_6"), np.column_stack([np.arange(count), np.zeros(count)]))
    assert len(primitives(made)) == len(scene.facts["parts"])
    for surface, part in zip(primitives(made), scene.facts["parts"], strict=True):
        (first, vertices), (start, triangles) = part["vertices"], part["triangles"]
        there = made.array(surface.indices).reshape(-1, 3).astype(np.int64)
        assert_array_equal(there + first, arrays["triangles"][start : start + triangles])
        assert there.max() < vertices


def test_the_file_says_of_every_vertex_what_the_scene_message_says(blob_puppet, blob_file, tmp_path, assert_valid_gltf):
    summary = write_shader_mesh(blob_puppet, tmp_path / "a.glb")
    scene = scene_of(blob_puppet)
    assert_is_the_scene(Raw(tmp_path / "a.glb"), scene)
    assert_valid_gltf(tmp_path / "a.glb")
    assert (summary.output, summary.bytes) == (str(tmp_path / "a.glb"), (tmp_path / "a.glb").stat().st_size)
    assert (summary.vertices, summary.triangles) == (scene.facts["vertices"], scene.facts["triangles"])
    assert (summary.surfaces, summary.fields) == (1, 5)
    result = CliRunner().invoke(main, ["shader-mesh", str(blob_puppet), "-o", str(tmp_path / "b.glb"), "--json"])
    assert json.loads(result.output) == {**asdict(summary), "output": str(tmp_path / "b.glb"), "notes": []}
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()
    content = blob_file.read_bytes()
    refused(OutputError, write_shader_mesh, blob_puppet, blob_file)
    assert blob_file.read_bytes() == content


def test_more_fields_than_a_vertex_has_room_for_are_refused(blob_file, write_puppet, tmp_path):
    many = write_puppet(blob_file.with_name("many.toml"), blob_file.name, more="[solver]\nfields = 9\nisolines = 4\n")
    place = refused_place(PuppetError, many, write_shader_mesh, many, tmp_path / "a.glb")
    assert place == "[solver], fields"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name", ["textured", "several_primitives", "mixed_primitives", "node_transforms", "skinned", "bare_scene"]
)
def test_parts_with_all_that_a_vertex_may_carry_are_those_of_the_scene(
    variants, name, write_puppet, tmp_path, assert_valid_gltf
):
    puppet = write_puppet(tmp_path / "a.toml", variants[name].path)
    write_shader_mesh(puppet, tmp_path / "a.glb")
    assert_valid_gltf(tmp_path / "a.glb")
    before, made = Raw(variants[name].path), Raw(tmp_path / "a.glb")
    assert_is_the_scene(made, scene_of(puppet))
    colors = [preview_colors(load_character(each)) for each in (tmp_path / "a.glb", variants[name].path)]
    assert_equal(*colors)
    for kind in ("materials", "textures", "samplers"):
        assert getattr(made.file, kind) == getattr(before.file, kind)
    for own, image in zip(made.file.images, before.file.images, strict=True):
        assert (own.name, own.mimeType) == (image.name, image.mimeType)
        assert made.view(own.bufferView) == before.view(image.bufferView)
