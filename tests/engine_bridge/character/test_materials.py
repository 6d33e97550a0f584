"""Materials of parts: colours, textures, opacity, and what a file leaves open."""

import io

import numpy as np
import pygltflib as gltf
import pytest
from PIL import Image

from engine_bridge.character.character import load_character
from engine_bridge.character.materials import materials_of

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
UV = np.array([[0, 0], [1, 0], [0, 1]], np.float32)


@pytest.fixture
def material(glb, tmp_path):
    """Return the material of a triangle with a glTF material and attributes."""

    def read(made=None, image=None, **attributes):
        if made is not None:
            glb.file.materials = [made]
        if image is not None:
            png = io.BytesIO()
            Image.fromarray(image).save(png, "PNG")
            glb.file.images = [gltf.Image(bufferView=glb.view(png.getvalue()), mimeType="image/png")]
            glb.file.textures = [gltf.Texture(source=0)]
        glb.node(glb.mesh(glb.primitive(CORNERS, material=None if made is None else 0, **attributes)))
        (found,) = materials_of(load_character(glb.save(tmp_path / "a.glb")))
        return found

    return read


def test_a_part_without_a_material_is_plain_and_has_two_sides(material):
    found = material()
    assert found.plain
    assert found.two_sided
    assert found.opacity == "OPAQUE"


def test_colours_and_opacity_are_those_of_the_file(material):
    surface = gltf.PbrMetallicRoughness(baseColorFactor=[0.1, 0.2, 0.3, 0.4])
    colors = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    found = material(
        gltf.Material(pbrMetallicRoughness=surface, alphaMode="MASK", alphaCutoff=0.3, doubleSided=True), COLOR_0=colors
    )
    np.testing.assert_allclose(found.color, [0.1, 0.2, 0.3, 0.4], atol=1e-7)
    np.testing.assert_array_equal(found.vertex_colors, np.column_stack([colors, np.ones(3)]))
    assert (found.opacity, found.cutoff, found.two_sided, found.unlit) == ("MASK", 0.3, True, False)


def test_a_texture_keeps_its_opacity_and_its_transform(material):
    image = np.random.default_rng(1).integers(0, 255, (4, 6, 4), dtype=np.uint8)
    texture = gltf.TextureInfo(
        index=0, extensions={"KHR_texture_transform": {"offset": [0.5, 0.25], "scale": [2, 3], "rotation": np.pi / 2}}
    )
    surface = gltf.PbrMetallicRoughness(baseColorTexture=texture)
    found = material(gltf.Material(pbrMetallicRoughness=surface), image, TEXCOORD_0=UV)
    np.testing.assert_array_equal(found.image, image)
    # the extension's matrix: translation · rotation · scale, and a positive angle is counter-clockwise in an image
    np.testing.assert_allclose(found.uv, [[0.5, 0.25], [0.5, 0.25 - 2], [0.5 + 3, 0.25]], atol=1e-6)


def test_a_damaged_image_leaves_the_colour(material):
    surface = gltf.PbrMetallicRoughness(baseColorTexture=gltf.TextureInfo(index=0))
    made = gltf.Material(pbrMetallicRoughness=surface, extensions={"KHR_materials_unlit": {}})
    found = material(made, np.zeros((2, 2, 4), np.uint8))
    assert found.image is None  # there are no texture coordinates
    assert found.unlit
