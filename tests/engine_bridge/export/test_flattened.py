import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import load_character
from engine_bridge.character.materials import drawn_normals
from engine_bridge.export.flattened import flatten
from puppetline.errors import MeshError

from ..refusals import refused
from .conftest import Raw, primitives, unit


def numbers(character):
    """Two sets of numbers that differ between all vertices."""
    count = len(character.vertices)
    return [np.arange(2 * count, dtype=np.float32).reshape(count, 2), np.full((count, 2), 7, np.float32)]


@pytest.fixture
def flat(tmp_path):
    """Flatten a file; return the character, the document's path and its contents."""

    def make(path):
        character = load_character(path)
        output = tmp_path / "flat.glb"
        flatten(character, drawn_normals(character), numbers(character)).save(output)
        return character, output, Raw(output)

    return make


def test_tangents_turn_with_their_node_and_change_sides_in_a_mirror(glb, blob, flat, tmp_path):
    across, scale = unit(np.cross(blob.normals, [0.3, 0.5, 0.8])), [-2.0, 1.0, 0.5]
    side = np.where(np.arange(len(across)) % 3, np.float32(1), np.float32(-1))[:, None]
    stored = {"NORMAL": blob.normals, "TEXCOORD_0": blob.uv, "TANGENT": np.hstack([across, side])}
    glb.node(glb.mesh(glb.primitive(blob.vertices, blob.faces, **stored)), scale=scale)
    _, _, made = flat(glb.save(tmp_path / "a.glb"))
    (primitive,) = primitives(made)
    written = made.array(primitive.attributes.TANGENT)
    assert_allclose(written[:, :3], unit(across * scale), atol=1e-6)
    # the third direction, normal × tangent · side, is carried along as any other
    before = np.cross(blob.normals, across) * side * scale
    after = np.cross(made.array(primitive.attributes.NORMAL), written[:, :3]) * written[:, 3:]
    assert ((before * after).sum(axis=1) > 0).all()


def test_sets_of_the_file_beyond_the_second_make_room_and_a_picture_on_one_is_refused(glb, blob, flat, tmp_path):
    faces = blob.faces
    more = {f"TEXCOORD_{number}": blob.uv + np.float32(number) for number in range(4)}
    glb.show(blob.vertices, faces, NORMAL=blob.normals, material=0, **more)
    glb.file.images = [gltf.Image(uri="data:image/png;base64,iVBORw0KGgo=", mimeType="image/png")]
    glb.file.textures = [gltf.Texture(source=0)]
    glb.file.materials = [gltf.Material(emissiveTexture=gltf.TextureInfo(index=0, texCoord=1))]
    character, _, made = flat(glb.save(tmp_path / "a.glb"))
    (primitive,) = primitives(made)
    assert_array_equal(made.array(primitive.attributes.TEXCOORD_1), more["TEXCOORD_1"])
    assert_array_equal(made.array(primitive.attributes.TEXCOORD_2), numbers(character)[0])
    glb.file.materials[0].emissiveTexture.extensions = {"KHR_texture_transform": {"texCoord": 2}}
    refused(MeshError, flat, glb.save(tmp_path / "b.glb"))


def test_extensions_of_what_is_shown_stay_and_those_of_what_is_gone_go(glb, blob, flat, tmp_path):
    primitive = glb.primitive(blob.vertices, blob.faces, NORMAL=blob.normals, material=0)
    glb.file.materials = [gltf.Material(extensions={"KHR_materials_ior": {"ior": 1.3}})]
    glb.file.extensions = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    glb.node(glb.mesh(primitive), extensions={"KHR_lights_punctual": {"light": 0}})
    glb.file.extensionsUsed = ["KHR_materials_ior", "KHR_lights_punctual"]
    glb.file.asset.copyright = "somebody"
    _, _, made = flat(glb.save(tmp_path / "a.glb"))
    assert made.file.extensionsUsed == ["KHR_materials_ior"]
    assert made.file.materials == glb.file.materials
    assert made.file.extensions == {}
    assert made.file.asset.copyright == "somebody"
