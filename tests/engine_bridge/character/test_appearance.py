import io

import numpy as np
import pytest
from PIL import Image

from engine_bridge.character import schema
from engine_bridge.character.appearance import Appearance
from engine_bridge.character.document import Document

UV = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [1.75, -0.25]], np.float32)
"""The middles of 2 × 2 pixels, the last one in another repetition of the image."""


def encoded(picture, kind="PNG"):
    file = io.BytesIO()
    picture.save(file, kind)
    return file.getvalue()


@pytest.fixture
def painted():
    """Return the colours of 4 vertices in a document whose materials have one image each."""

    def colors(*pictures):
        document = Document(schema.empty())
        gltf = document.gltf
        attributes = {"POSITION": document.add(np.zeros((4, 3), np.float32)), "TEXCOORD_0": document.add(UV)}
        for number, content in enumerate(pictures):
            gltf["images"].append({"bufferView": document.add_view(content)})
            gltf["textures"].append({"source": number})
            gltf["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}})
        look = Appearance(document)
        return [look.of({"attributes": attributes, "material": number}, 4) for number in range(len(pictures))]

    return colors


def test_a_vertex_has_the_linear_colour_of_its_pixel(painted):
    pixels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [188, 188, 188]]], np.uint8)
    (colors,) = painted(encoded(Image.fromarray(pixels)))
    grey = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(colors, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [grey] * 3], atol=1e-6)


def test_an_unreadable_picture_or_one_that_gltf_lacks_is_left_out(painted):
    postscript = encoded(Image.new("RGB", (2, 2)), "EPS")
    for colors in painted(b"", b"\x89PNG", postscript, b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n"):
        np.testing.assert_array_equal(colors, np.ones((4, 3)))


def test_pictures_are_shown_as_long_as_there_is_room(painted):
    black, large = encoded(Image.new("1", (2, 2))), encoded(Image.new("1", (8192, 8191)))
    first, second, third = painted(black, large, large)
    assert (first.max(), second.max(), third.min()) == (0, 0, 1)
