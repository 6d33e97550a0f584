"""Films as one .glb: valid, and every character moves as its takes say."""

import numpy as np
import pygltflib as gltf
import pytest

from engine_bridge.character.document_reader import load_document
from engine_bridge.film import scene as scenes
from engine_bridge.film.film_document import make_document
from engine_bridge.film.production import produce
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units

from .conftest import quiet

SCENE = """
[[character]]
name = "a"
puppet = "HANDLES"
position = [-1, 0.5]
turn = 40
height = 1.5

[[character]]
name = "b"
puppet = "HANDLES"
position = [1, 0]
height = 2.5

[[take]]
character = "a"
file = "TAKE"
stop = 1

[[take]]
character = "a"
file = "TAKE"
start = 0.6
stop = 1
position = [-2, 0]
turn = 10

[[take]]
character = "b"
file = "TAKE"
at = 0.2
stop = 0.8
"""


@pytest.mark.slow
def test_characters_are_where_their_takes_put_them(write_scene, play, assert_valid_gltf, tmp_path):
    path = write_scene(SCENE)
    summary = make_document(path, tmp_path / "film.glb", quiet)
    assert_valid_gltf(tmp_path / "film.glb")
    production = produce(path, scenes.load(path), quiet)
    production.extents(quiet)
    frames = production.frames
    assert summary.frames == frames
    played = play(tmp_path / "film.glb", frames)
    np.testing.assert_allclose(played.times, np.arange(frames) / 30, atol=1e-5)
    assert len(played.meshes) == 2
    for actor, mesh in zip(production.actors, played.meshes, strict=True):
        prepared = actor.prepared
        binding = Binding(prepared.model, prepared.character.vertices, prepared.mesh.of_render)
        diagonal = actor.footing.scale * float(prepared.model.diagonal)
        for frame in range(frames):
            linear = actor.to_stage(frame)
            expected = binding.vertices(to_file_units(actor.pose(frame).R, prepared.model)) @ linear[:3] + linear[3]
            assert np.abs(mesh.positions[frame] - expected).max() < 0.0006 * diagonal  # the tolerance of morph targets


def test_rigged_characters_share_one_animation_and_keep_their_skins(write_scene, tmp_path):
    make_document(write_scene(SCENE.replace("HANDLES", "LIMBED")), tmp_path / "film.glb", quiet)
    made = load_document(tmp_path / "film.glb", (tmp_path / "film.glb").read_bytes()).gltf
    (animation,) = made["animations"]
    assert len(made["skins"]) == 2
    moved = {channel["target"]["node"] for channel in animation["channels"]}
    for skin in made["skins"]:
        assert len(moved & set(skin["joints"])) >= 6
    names = [made["nodes"][node].get("name") for node in made["scenes"][0]["nodes"]]
    assert {"a", "b"} <= set(names)


def test_animations_of_the_characters_files_and_their_arrays_are_left_out(
    write_scene, glb, blob, write_puppet, validate, tmp_path
):
    times, way = np.array([0, 1], np.float32), np.zeros((2, 3), np.float32)
    node = glb.node(glb.mesh(glb.primitive(blob.vertices, blob.faces.astype(np.uint32), NORMAL=blob.normals)))
    sampler = gltf.AnimationSampler(input=glb.add(times, None), output=glb.add(way, None))
    channel = gltf.AnimationChannel(sampler=0, target=gltf.AnimationChannelTarget(node=node, path="translation"))
    glb.file.animations = [gltf.Animation(name="own", samplers=[sampler], channels=[channel])]
    glb.save(tmp_path / "own.glb")
    puppet = write_puppet(tmp_path / "own.toml", "own.glb")
    make_document(write_scene(SCENE.replace("HANDLES", str(puppet))), tmp_path / "film.glb", quiet)
    report = validate(tmp_path / "film.glb")
    assert (report["errors"], report["warnings"], report["infos"]) == (0, 0, 0)
