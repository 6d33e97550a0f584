"""A Puppet3D shows, in each mode, the solver's results for the frames that it gets."""

import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from engine_bridge.export.live_basis import LiveBasis
from engine_bridge.export.shader_mesh import write_shader_mesh

from ..stage import performed

CONTROLS, VERTICES, MORPHS = range(3)
SAMPLES = 20
APART = 6
"""Frames between two samples, so that the character has moved."""
ALIKE = 1e-5
"""Of the diagonal: what positions may differ in f32. What is promised is 1e-4."""


def between(stage, told, what):
    """Blend what belongs to the two frames that are shown."""
    first, second = (what(stage.sent[told[name]]).astype(float) for name in ("sequence", "next_sequence"))
    return (1 - told["share"]) * first + told["share"] * second


def vertices_and_normals(stage, controls):
    return stage.character.binding.vertices_and_normals(controls.astype(np.float32))


def controls_of(frame):
    return frame.pose.controls


@pytest.fixture
def show(start_godot, tmp_path):
    """Have Godot show a stage's character; return positions at rest, where a Puppet3D tells them, and what it tells of
    some frames, with the positions of its vertices."""

    def run(stage, **settings):
        stage.is_playing, file = True, tmp_path / "shown.bin"
        asked = {"settings": {"port": stage.port, **settings}, "samples": SAMPLES, "apart": APART, "file": str(file)}
        told = start_godot("show_puppet.gd", json.dumps(asked)).finish(300)
        rest, shown = np.split(np.fromfile(file, "<f4").reshape(-1, 3), [-SAMPLES * len(stage.character.rest)])
        assert np.ptp(np.split(shown, SAMPLES), axis=0).max() > 0.01 * stage.diagonal
        return rest, list(zip((each for each in told if "sequence" in each), np.split(shown, SAMPLES), strict=True))

    return run


@pytest.fixture
def check_shader(start_godot, screen, read_pixels, tmp_path):
    """Compare positions, normals and bounds of what the graphics card draws."""

    def check(stage, **settings):
        stage.is_playing, diagonal, rest = True, stage.diagonal, stage.character.rest
        box = [(rest.min(axis=0) - diagonal).tolist(), (np.ptp(rest, axis=0) + 2 * diagonal).tolist()]
        asked = {"settings": {"port": stage.port, **settings}, "samples": 3, "apart": 20, "box": box}
        asked |= {"file": str(tmp_path / "pixels")}
        told = start_godot("shade_puppet.gd", json.dumps(asked), screen=screen()).finish(600)
        told = [result for result in told if "sequence" in result]
        weights, slopes = stage.character.prepared.model.weights, np.abs(stage.character.binding._slopes)
        # by how many isolines places change at most over a diagonal along the surface
        steepest = diagonal * np.linalg.norm(np.einsum("e,nex->nx", weights, slopes), axis=1).max()
        shown = read_pixels(tmp_path / "pixels", 3, len(rest), box)
        for each, (positions, normals, _) in zip(told, shown, strict=True):
            controls = between(stage, each, controls_of)
            lost = np.finfo(np.float32).eps * np.abs(controls[..., :3]).max()  # where large transforms cancel out
            lost *= 1 + steepest  # and normals add up their differences
            where, turned = vertices_and_normals(stage, controls)
            assert np.abs(positions - where).max() <= ALIKE * diagonal
            some = np.linalg.norm(turned, axis=1) > 0.5  # where there is no direction, the shader has to make one up
            assert np.abs(normals - turned)[some].max() <= 1e-4 + 10 * lost
            low, high = np.array(each["bounds"])
            assert (low - where.min(axis=0)).max() <= ALIKE * diagonal
            assert (where.max(axis=0) - high).max() <= ALIKE * diagonal
            assert np.prod(high - low) <= 4.0 * np.prod(np.ptp(where, axis=0))

    return check


def check_vertices(show, stage, mode=VERTICES):
    for told, positions in show(stage, mode=mode)[1]:
        expected, _ = stage.sent[told["sequence"]].vertices_and_normals
        assert np.abs(positions - expected).max() <= ALIKE * stage.diagonal


@pytest.fixture
def own_mesh(add_glb, tmp_path):
    """Import a puppet's mesh for the addon's shader."""

    def make(puppet, settings=None):
        path = tmp_path / ("other.glb" if settings else "own.glb")
        write_shader_mesh(puppet, path)
        return add_glb(path, settings)

    return make


SETTINGS = {"generate_lods": "false", "create_shadow_meshes": "false", "ensure_tangents": "false"}
SETTINGS = {f"meshes/{name}": value for name, value in (SETTINGS | {"force_disable_compression": "true"}).items()}
"""Every setting of the import that changes vertices, in another way than by default."""


def test_the_graphics_card_shows_the_same(check_shader, stage, own_mesh, blob_puppet):
    check_shader(stage)
    for settings in None, SETTINGS:
        check_shader(stage, mesh_source=own_mesh(blob_puppet, settings))


def test_morphs_are_as_near_as_the_service_says_though_the_root_is_elsewhere_turned_and_scaled(
    show, new_stage, project, add_glb, blob_puppet, take, baked
):
    (project / "moved.tscn").write_text(
        f'[gd_scene load_steps=2 format=3]\n[ext_resource type="PackedScene" path="{add_glb(baked)}" id="1"]\n'
        '[node name="Moved" instance=ExtResource("1")]\n'
        "transform = Transform3D(0, 0, 2, 0, 2, 0, -2, 0, 0, 0.5, -2, 1)\n"
    )
    stage = new_stage(performed(blob_puppet, take, basis=lambda prepared: LiveBasis.load(baked, prepared)))
    rest, shown = show(stage, mode=MORPHS, mesh_source="res://moved.tscn")
    to_file = np.linalg.inv([[0, 0, 2], [0, 2, 0], [-2, 0, 0]]).T
    # the importer has an order of its own
    near, number = cKDTree(stage.character.rest).query((rest - [0.5, -2, 1]) @ to_file)
    assert near.max() <= ALIKE * stage.diagonal
    once = np.unique(stage.character.prepared.mesh.of_render[number], return_index=True)[1]
    for told, positions in shown:
        expected, _ = vertices_and_normals(stage, between(stage, told, controls_of))
        away = (positions - [0.5, -2, 1]) @ to_file - expected[number]
        rms = np.sqrt((away[once] ** 2).sum(axis=1).mean()) / stage.diagonal
        # morph targets leave of the solver's vertices as much as the service says
        left = max(stage.sent[told[name]].morphs.residual for name in ("sequence", "next_sequence"))
        assert rms <= left + ALIKE


@pytest.mark.parametrize("mode", [CONTROLS, VERTICES])
def test_a_character_that_stays_in_its_place(show, stage, mode):
    blended = False
    for told, positions in show(stage, mode=mode, follow_root=False)[1]:
        blended |= 0.1 < told["share"] < 0.9
        told["share"] *= mode == CONTROLS  # vertices are not blended
        expected, _ = vertices_and_normals(stage, between(stage, told, controls_of))
        root = between(stage, told, lambda frame: frame.pose.root)
        assert np.abs(positions - (expected - root)).max() <= ALIKE * stage.diagonal
    assert blended or mode == VERTICES
    assert np.ptp([frame.pose.root for frame in stage.sent.values()], axis=0).max() > 0.05 * stage.diagonal


def test_more_fields_than_a_vertex_has_room_for_come_vertex_by_vertex(show, new_stage, blob_file, write_puppet, take):
    more = "[solver]\nfields = 9\nisolines = 6"
    puppet = write_puppet(blob_file.with_name("nine_fields.toml"), blob_file.name, more=more)
    check_vertices(show, new_stage(performed(puppet, take)), mode=CONTROLS)


def test_more_parts_than_a_mesh_has_room_for(
    show, check_shader, new_stage, blob, new_glb, write_puppet, take, tmp_path
):
    glb = new_glb()
    pieces = [np.unique(faces, return_inverse=True) for faces in np.array_split(blob.faces, 300)]
    parts = [
        glb.primitive(blob.vertices[which], faces.astype(np.uint32), NORMAL=blob.normals[which].astype(np.float32))
        for which, faces in pieces
    ]
    glb.node(glb.mesh(*parts))
    puppet = write_puppet(tmp_path / "parts.toml", glb.save(tmp_path / "parts.glb").name)
    stage = new_stage(performed(puppet, take))
    check_shader(stage)
    check_vertices(show, stage)
