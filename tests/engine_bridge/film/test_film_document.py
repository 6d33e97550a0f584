"""Films as one .glb: valid, and every character moves as its takes say."""

import numpy as np
import pytest

from engine_bridge.character.document_reader import load_document
from engine_bridge.film import scene as scenes
from engine_bridge.film.film_document import make_document
from engine_bridge.film.production import produce

from ..export.conftest import add_animation
from .conftest import placed, quiet

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
        diagonal = actor.footing.scale * float(actor.prepared.model.diagonal)
        away = np.abs(mesh.positions - placed(actor, range(frames)))
        assert away.max() < 0.0006 * diagonal  # the tolerance of morph targets


def test_rigged_characters_share_one_animation_and_keep_their_skins(write_scene, tmp_path):
    make_document(write_scene(SCENE.replace("HANDLES", "LIMBED")), tmp_path / "film.glb", quiet)
    made = load_document(tmp_path / "film.glb", (tmp_path / "film.glb").read_bytes()).gltf
    (animation,) = made["animations"]
    assert len(made["skins"]) == 2
    moved = {channel["target"]["node"] for channel in animation["channels"]}
    for skin in made["skins"]:
        assert len(moved & set(skin["joints"])) >= 6
    assert {"a", "b"} <= {made["nodes"][node].get("name") for node in made["scenes"][0]["nodes"]}


def test_animations_of_the_characters_files_and_their_arrays_are_left_out(
    write_scene, glb, blob, write_puppet, validate, tmp_path
):
    node = glb.show(blob.vertices, blob.faces, NORMAL=blob.normals)
    add_animation(glb, "own", node, "translation", [0, 1], np.zeros((2, 3)))
    glb.save(tmp_path / "own.glb")
    puppet = write_puppet(tmp_path / "own.toml", "own.glb")
    make_document(write_scene(SCENE.replace("HANDLES", str(puppet))), tmp_path / "film.glb", quiet)
    report = validate(tmp_path / "film.glb")
    assert (report["errors"], report["warnings"], report["infos"]) == (0, 0, 0)
