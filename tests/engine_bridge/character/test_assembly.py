import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from engine_bridge.character.assembly import assemble
from engine_bridge.character.character import from_document, load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.surfaces.surface import DEFAULT_MATERIAL, ImageFile, Piece, Surface, SurfaceMaterial

from .conftest import CORNERS, SIDES


@pytest.fixture
def skin(tmp_path):
    Image.new("RGB", (4, 4), "red").save(tmp_path / "skin.png")
    return ImageFile("skin", "image/png", (tmp_path / "skin.png").read_bytes())


@pytest.fixture
def saved(tmp_path, assert_valid_gltf):
    """Write a surface as a .glb, validate the file, and read it."""

    def run(surface):
        assemble(surface, "figure").save(tmp_path / "figure.glb")
        if not any(piece.material.normal_texture for piece in surface.pieces):
            # it would warn of tangents, which are better left to the viewer where a surface is to be deformed
            assert_valid_gltf(tmp_path / "figure.glb")
        return load_document(tmp_path / "figure.glb")

    return run


def test_a_piece_becomes_a_primitive_with_all_that_it_has(saved, skin):
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    uvs, colors = rng.normal(size=(4, 2)), rng.random((4, 4))
    glass = SurfaceMaterial(
        "glass", (0.1, 0.2, 0.3, 0.5), 0.25, 0.75, (0, 1, 0), skin, skin, "BLEND", double_sided=True
    )
    document = saved(Surface([Piece("", CORNERS * 0.1, SIDES, glass, normals, uvs, colors)]))
    gltf = document.gltf
    ((primitive,),) = (mesh["primitives"] for mesh in gltf["meshes"])
    for name, values in (("POSITION", CORNERS * 0.1), ("NORMAL", normals), ("TEXCOORD_0", uvs)):
        assert_array_equal(document.array(primitive["attributes"][name]), values.astype(np.float32))
    assert_allclose(document.array(primitive["attributes"]["COLOR_0"]), colors, atol=0.5 / 65535 + 1e-7)
    assert_array_equal(document.array(primitive["indices"]), SIDES.ravel())
    assert gltf["materials"] == [
        {
            "name": "glass",
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.1, 0.2, 0.3, 0.5],
                "metallicFactor": 0.25,
                "roughnessFactor": 0.75,
                "baseColorTexture": {"index": 0},
            },
            "normalTexture": {"index": 0},
            "emissiveFactor": [0, 1, 0],
            "alphaMode": "BLEND",
            "doubleSided": True,
        }
    ]
    (image,) = gltf["images"]
    assert ImageFile(image["name"], image["mimeType"], document.view(image["bufferView"])) == skin
    assert gltf["nodes"] == [{"name": "figure", "mesh": 0}]


def test_pieces_of_one_name_are_one_mesh_and_materials_and_pictures_are_there_once(saved, skin):
    red, same = SurfaceMaterial("a", (1, 0, 0, 1), texture=skin), SurfaceMaterial("a", (1, 0, 0, 1), texture=skin)
    blue = SurfaceMaterial("b", (0, 0, 1, 1), texture=ImageFile("skin", "image/png", bytes(skin.content)))
    named = [("arm", red), ("", DEFAULT_MATERIAL), ("leg", same), ("arm", blue)]
    gltf = saved(Surface([Piece(name, CORNERS, SIDES, made, uvs=np.zeros((4, 2))) for name, made in named])).gltf
    shown = [gltf["nodes"][index] for index in gltf["scenes"][gltf["scene"]]["nodes"]]
    materials = [[each["material"] for each in gltf["meshes"][node["mesh"]]["primitives"]] for node in shown]
    assert [node["name"] for node in shown] == ["arm", "figure", "leg"]
    assert [gltf["meshes"][node["mesh"]]["name"] for node in shown] == ["arm", "figure", "leg"]
    assert materials == [[0, 2], [1], [0]]
    assert [len(gltf[name]) for name in ("materials", "textures", "images")] == [3, 1, 1]


@pytest.mark.parametrize(("vertices", "kind"), [(4, 5123), (65535, 5123), (65536, 5125)])
def test_indices_are_as_small_as_they_may_be(saved, vertices, kind):
    positions = np.random.default_rng(6).random((vertices, 3))
    triangles = np.array([[0, 1, vertices - 1], [1, 2, vertices - 1]])
    document = saved(Surface([Piece("", positions, triangles)]))
    indices = document.gltf["meshes"][0]["primitives"][0]["indices"]
    assert document.gltf["accessors"][indices]["componentType"] == kind
    assert_array_equal(document.array(indices), triangles.ravel())


def test_a_surface_far_from_the_origin_keeps_its_shape_and_its_place(saved, tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices = ball.vertices + np.array([5e5, 4.6e6, 120])
    pieces = [Piece(name, vertices, half) for name, half in zip("ab", np.split(ball.faces, 2), strict=True)]
    left, right = (node["translation"] for node in saved(Surface(pieces)).gltf["nodes"])
    assert left == right == np.float32(left).tolist()
    for character in (from_document(assemble(Surface(pieces), "ball")), load_character(tmp_path / "figure.glb")):
        assert_allclose(character.vertices, np.tile(vertices, (2, 1)), rtol=0, atol=1e-6 * np.sqrt(12))
