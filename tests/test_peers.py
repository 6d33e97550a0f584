"""The outside readers themselves, on a file small enough to work out by hand."""

import numpy as np
import pygltflib as gltf
import pytest

from .engine_bridge.conftest import Glb

BASE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
UP = np.tile(np.float32([0, 0, 1]), (4, 1))
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)
MOVES = np.array([[[0, 0, 2], [0, 0, 0], [0, 0, 0], [0, 0, 0]], [[1, 0, 0]] * 4], np.float32)
TURNS = np.array([[[1, 0, 0]] * 4, [[0, 3, -1], [0, 0, 0], [0, 0, 0], [0, 0, 0]]], np.float32)
KEYS = np.array([0, 1, 2], np.float32)
WEIGHTS = np.array([[0, 0], [1, 0], [0, 0.5]], np.float32)
TRANSLATIONS = np.array([[0, 0, 0], [0, 10, 0], [4, 10, 0]], np.float32)


@pytest.fixture
def quad():
    """Two triangles with two morph targets, both morphed and moved by an animation."""
    glb = Glb()
    targets = [{"POSITION": move, "NORMAL": turn} for move, turn in zip(MOVES, TURNS, strict=True)]
    glb.node(glb.mesh(glb.primitive(BASE, FACES, targets=targets, NORMAL=UP), weights=[0, 0]), name="quad")
    keys = glb.add(KEYS, None)
    tracks = {"weights": glb.add(WEIGHTS.ravel(), None), "translation": glb.add(TRANSLATIONS, None)}
    glb.file.animations = [
        gltf.Animation(
            samplers=[gltf.AnimationSampler(input=keys, output=output) for output in tracks.values()],
            channels=[
                gltf.AnimationChannel(sampler=i, target=gltf.AnimationChannelTarget(node=0, path=path))
                for i, path in enumerate(tracks)
            ],
        )
    ]
    return glb


def test_three_plays_the_positions_and_normals_worked_out_by_hand(quad, play, tmp_path):
    played = play(quad.save(tmp_path / "quad.glb"), 5)
    np.testing.assert_array_equal(played.times, [0, 0.5, 1, 1.5, 2])
    (mesh,) = played.meshes
    assert mesh.name == "quad"

    # At 0.5 s: half of target 0, half of the way up. At 1.5 s: half of target 0, a quarter of 1, half of the way right.
    np.testing.assert_array_equal(mesh.positions[0], BASE)
    np.testing.assert_allclose(mesh.positions[1], [[0, 5, 1], [1, 5, 0], [1, 6, 0], [0, 6, 0]], rtol=1e-6)
    np.testing.assert_allclose(mesh.positions[2], [[0, 10, 2], [1, 10, 0], [1, 11, 0], [0, 11, 0]], rtol=1e-6)
    np.testing.assert_allclose(
        mesh.positions[3], [[2.25, 10, 1], [3.25, 10, 0], [3.25, 11, 0], [2.25, 11, 0]], rtol=1e-6
    )
    np.testing.assert_allclose(mesh.positions[4], [[4.5, 10, 0], [5.5, 10, 0], [5.5, 11, 0], [4.5, 11, 0]], rtol=1e-6)

    np.testing.assert_array_equal(mesh.normals[0], UP)
    half, diagonal = np.sqrt([0.2, 0.5])
    np.testing.assert_allclose(mesh.normals[1], [[half, 0, 2 * half]] * 4, rtol=1e-6)
    np.testing.assert_allclose(mesh.normals[2], [[diagonal, 0, diagonal]] * 4, rtol=1e-6)
    lifted = np.array([0, 1.5, 0.5]) / np.sqrt(2.5)  # UP + TURNS[1] / 2
    np.testing.assert_allclose(mesh.normals[4], [lifted, [0, 0, 1], [0, 0, 1], [0, 0, 1]], rtol=1e-6)


def test_normals_go_to_the_world_by_the_inverse_transpose(quad, play, tmp_path):
    quad.file.nodes[0].scale = [2, 1, 1]
    (mesh,) = play(quad.save(tmp_path / "quad.glb"), 3).meshes
    np.testing.assert_allclose(mesh.positions[2], BASE * [2, 1, 1] + [5, 10, 0], rtol=1e-6)  # 4 + 2 · 0.5
    np.testing.assert_allclose(mesh.normals[1], np.array([[0.5, 0, 1]] * 4) / np.sqrt(1.25), rtol=1e-6)


def test_three_plays_a_textured_mesh_without_its_texture(quad, play, tmp_path):
    plain = play(quad.save(tmp_path / "plain.glb"), 3)
    quad.file.images = [gltf.Image(uri="nowhere.png")]
    quad.file.textures = [gltf.Texture(source=0)]
    quad.file.materials = [
        gltf.Material(pbrMetallicRoughness=gltf.PbrMetallicRoughness(baseColorTexture=gltf.TextureInfo(index=0)))
    ]
    quad.file.meshes[0].primitives[0].material = 0
    textured = play(quad.save(tmp_path / "textured.glb"), 3)
    np.testing.assert_array_equal(textured.meshes[0].positions, plain.meshes[0].positions)


def test_the_validator_accepts_a_good_file(quad, validate, assert_valid_gltf, tmp_path):
    path = quad.save(tmp_path / "good.glb")
    report = validate(path)
    assert (report["errors"], report["warnings"]) == (0, 0)
    assert_valid_gltf(path)


def test_the_validator_names_the_accessor_without_bounds(quad, validate, assert_valid_gltf, tmp_path):
    positions = quad.file.meshes[0].primitives[0].attributes.POSITION
    quad.file.accessors[positions].min = None
    path = quad.save(tmp_path / "broken.glb")
    (message,) = validate(path)["messages"]
    assert message["code"] == "MESH_PRIMITIVE_POSITION_ACCESSOR_WITHOUT_BOUNDS"
    assert message["pointer"] == "/meshes/0/primitives/0/attributes/POSITION"
    with pytest.raises(pytest.fail.Exception, match=message["code"]):
        assert_valid_gltf(path)


def test_the_validator_reads_buffers_beside_the_file(quad, validate, tmp_path):
    quad.save(tmp_path / "quad.glb")
    file = gltf.GLTF2().load_binary(tmp_path / "quad.glb")
    (tmp_path / "a buffer.bin").write_bytes(file.binary_blob())
    file.buffers[0].uri = "a%20buffer.bin"
    file.save_json(tmp_path / "quad.gltf")
    assert validate(tmp_path / "quad.gltf")["errors"] == 0
    (tmp_path / "a buffer.bin").unlink()
    assert validate(tmp_path / "quad.gltf")["messages"][0]["code"] == "IO_ERROR"
