"""Colours of primitives for previews, one per vertex."""

import base64
import io
import warnings

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from engine_bridge.character import schema
from engine_bridge.character.document import Document
from engine_bridge.character.schema import Primitive
from engine_bridge.character.surfaces.surface import srgb_to_linear

MAX_PIXELS = 8192 * 8192
"""Maximum number of pixels of all images of a character together; an image that exceeds it is not shown."""


class Appearance:
    """The colours of a document's primitives, for previews.

    Parameters
    ----------
    document : Document
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._pixels = 0
        self._images: dict[int, NDArray[np.uint8] | None] = {}

    def of(self, primitive: Primitive, count: int) -> NDArray[np.float64] | None:
        """Return vertex colour times the material's colour times its texture at the vertex.

        Returns
        -------
        (count, 3) float64 or None
            Linear RGB; None if the file has no colours.
        """
        own = self._document.attribute(primitive, "COLOR_0", count, 3, 4)
        material = self._document.gltf["materials"][primitive["material"]] if "material" in primitive else None
        if own is None and material is None:
            return None
        surface = (material or {}).get("pbrMetallicRoughness", {})
        colors = np.tile(np.array(surface.get("baseColorFactor", [1.0] * 4), dtype=np.float64)[:3], (count, 1))
        if own is not None:
            colors *= own[:, :3]
        if "baseColorTexture" in surface:
            texture = surface["baseColorTexture"]
            uv = self._document.attribute(primitive, f"TEXCOORD_{texture.get('texCoord', 0)}", count, 2)
            source = self._document.gltf["textures"][texture["index"]].get("source")
            image = None if source is None else self._image(source)
            if uv is not None and image is not None:
                colors *= _sample(image, uv)
        return colors

    def _image(self, source: int) -> NDArray[np.uint8] | None:
        """Return the sRGB pixels (height, width, 3) of an image, or None if it cannot be opened."""
        if source not in self._images:
            try:
                self._images[source] = self._open(self._document.gltf["images"][source])
            except Exception:
                self._images[source] = None
        return self._images[source]

    def _open(self, image: schema.Image) -> NDArray[np.uint8]:
        if "bufferView" in image:
            content = self._document.view(image["bufferView"])
        else:
            content = base64.b64decode(image.get("uri", "").partition(",")[2])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about the size, which is checked here
            opened = Image.open(io.BytesIO(content), formats=("PNG", "JPEG", "WEBP"))
        self._pixels += opened.width * opened.height
        if self._pixels > MAX_PIXELS:
            raise ValueError(f"{self._pixels} pixels")
        opened.thumbnail((1024, 1024))
        return np.asarray(opened.convert("RGB"))


def _sample(image: NDArray[np.uint8], uv: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the nearest pixel of each vertex in linear RGB; the image repeats beyond its edges."""
    height, width = image.shape[:2]
    place = np.nan_to_num(uv) % 1.0
    column = np.minimum((place[:, 0] * width).astype(int), width - 1)
    row = np.minimum((place[:, 1] * height).astype(int), height - 1)
    return srgb_to_linear(image[row, column].astype(np.float32) / np.float32(255))
