"""Materials of parts: colours, textures, opacity, and what a file leaves open."""

import igl
import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from engine_bridge.character.character import load_character
from engine_bridge.character.materials import drawn_normals, materials_of, preview_colors

from ..conftest import encoded
from .conftest import CORNERS, SIDES


@pytest.fixture
def material(glb, tmp_path):
    """Return the material of a triangle with a glTF material and attributes."""

    def read(made=None, image=None, **attributes):
        if made is not None:
            glb.file.materials = [made]
        if image is not None:
            glb.file.images = [gltf.Image(bufferView=glb.view(encoded(Image.fromarray(image))), mimeType="image/png")]
            glb.file.textures = [gltf.Texture(source=0)]
        glb.show(CORNERS[:3], material=None if made is None else 0, **attributes)
        (found,) = materials_of(load_character(glb.save(tmp_path / "a.glb")))
        return found

    return read


def test_a_part_without_a_material_is_plain_and_has_two_sides(material):
    found = material()
    assert (found.plain, found.two_sided, found.opacity) == (True, True, "OPAQUE")


def test_colours_and_opacity_are_those_of_the_file(material):
    surface = gltf.PbrMetallicRoughness(baseColorFactor=[0.1, 0.2, 0.3, 0.4])
    colors = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    found = material(
        gltf.Material(pbrMetallicRoughness=surface, alphaMode="MASK", alphaCutoff=0.3, doubleSided=True), COLOR_0=colors
    )
    assert_allclose(found.color, [0.1, 0.2, 0.3, 0.4], atol=1e-7)
    assert_array_equal(found.vertex_colors, np.column_stack([colors, np.ones(3)]))
    assert (found.opacity, found.cutoff, found.two_sided, found.unlit) == ("MASK", 0.3, True, False)


def test_a_texture_keeps_its_opacity_and_its_transform(material):
    image = np.random.default_rng(1).integers(0, 255, (4, 6, 4), dtype=np.uint8)
    texture = gltf.TextureInfo(
        index=0, extensions={"KHR_texture_transform": {"offset": [0.5, 0.25], "scale": [2, 3], "rotation": np.pi / 2}}
    )
    surface = gltf.PbrMetallicRoughness(baseColorTexture=texture)
    found = material(
        gltf.Material(pbrMetallicRoughness=surface), image, TEXCOORD_0=np.float32([[0, 0], [1, 0], [0, 1]])
    )
    assert_array_equal(found.image, image)
    # the extension's matrix: translation · rotation · scale, and a positive angle is counter-clockwise in an image
    assert_allclose(found.uv, [[0.5, 0.25], [0.5, 0.25 - 2], [0.5 + 3, 0.25]], atol=1e-6)


def test_an_image_without_texture_coordinates_leaves_the_colour(material):
    surface = gltf.PbrMetallicRoughness(baseColorTexture=gltf.TextureInfo(index=0))
    made = gltf.Material(pbrMetallicRoughness=surface, extensions={"KHR_materials_unlit": {}})
    found = material(made, np.zeros((2, 2, 4), np.uint8))
    assert (found.image, found.unlit) == (None, True)


MIDDLES = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [1.75, -0.25]], np.float32)
"""The middles of 2 × 2 pixels, the last one in another repetition of the image."""


TINT = np.array([0.5, 0.2, 1])
"""The materials' colour times that of the vertices."""


@pytest.fixture
def painted(glb, tmp_path):
    """Return the colours of 4 vertices in a file whose materials have one image each, and of a part without one."""

    def colors(*pictures):
        primitives = [glb.primitive(CORNERS, SIDES)]
        more = {"TEXCOORD_0": MIDDLES, "COLOR_0": np.uint8([[255, 51, 255, 255]] * 4)}
        for number, content in enumerate(pictures):
            glb.file.images.append(gltf.Image(bufferView=glb.view(content), mimeType="image/png"))
            glb.file.textures.append(gltf.Texture(source=number))
            texture = gltf.TextureInfo(index=number)
            surface = gltf.PbrMetallicRoughness(baseColorTexture=texture, baseColorFactor=[0.5, 1, 1, 1])
            glb.file.materials.append(gltf.Material(pbrMetallicRoughness=surface))
            primitives.append(glb.primitive(CORNERS, SIDES, material=number, **more))
        glb.node(glb.mesh(*primitives))
        return np.split(preview_colors(load_character(glb.save(tmp_path / "a.glb"))), len(primitives))

    return colors


def test_a_vertex_has_the_linear_colour_of_its_pixel_times_its_own_and_that_of_the_material(painted):
    pixels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [188, 188, 188]]], np.uint8)
    plain, colors = painted(encoded(Image.fromarray(pixels)))
    grey = ((188 / 255 + 0.055) / 1.055) ** 2.4
    assert_allclose(colors, TINT * [[1, 0, 0], [0, 1, 0], [0, 0, 1], [grey] * 3], atol=1e-6)
    assert_allclose(plain, [[0.6] * 3] * 4, atol=1e-7)


def test_an_unreadable_picture_or_one_that_gltf_lacks_is_left_out(painted):
    postscript = encoded(Image.new("RGB", (2, 2)), "EPS")
    for colors in painted(b"", b"\x89PNG", postscript, b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n")[1:]:
        assert_allclose(colors, [TINT] * 4, atol=1e-7)


def test_pictures_are_shown_as_long_as_there_is_room(painted):
    black, large = encoded(Image.new("1", (2, 2))), encoded(Image.new("1", (8192, 8191)))
    _, first, second, third = painted(black, large, large)
    assert (first.max(), second.max(), third.max()) == (0, 0, 1)


def test_normals_have_no_numbers_that_a_graphics_card_takes_for_zero(glb, tmp_path, blob):
    normals = np.tile(np.float32([-3.5e-39, -1.0, 2e-38]), (len(blob.vertices), 1))
    glb.show(blob.vertices, blob.faces, NORMAL=normals)
    drawn = drawn_normals(load_character(glb.save(tmp_path / "upside_down.glb")))
    assert_array_equal(drawn, np.tile([0.0, -1.0, np.float32(2e-38)], (len(normals), 1)))


def test_a_file_without_normals_gets_smooth_ones(glb, tmp_path, blob):
    with_normals = glb.primitive(blob.vertices, blob.faces, NORMAL=blob.normals)
    without = glb.primitive(blob.vertices, blob.faces)
    glb.node(glb.mesh(with_normals, without))
    normals = drawn_normals(load_character(glb.save(tmp_path / "two.glb")))
    smooth = igl.per_vertex_normals(blob.vertices.astype(float), blob.faces)
    assert_allclose(normals, np.concatenate([blob.normals, smooth]), atol=1e-6)
