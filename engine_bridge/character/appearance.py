"""What a picture can show of a primitive's look: one colour a vertex."""

import base64
import io
import warnings

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from engine_bridge.character import schema
from engine_bridge.character.document import Document
from engine_bridge.character.schema import Primitive

MAX_PIXELS = 8192 * 8192
"""Of all pictures of a character; whichever goes beyond is not shown."""


class Appearance:
    """The colours of a document's primitives, for previews.

    Parameters
    ----------
    document : Document
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._pixels = 0
        self._pictures: dict[int, NDArray[np.uint8] | None] = {}

    def of(self, primitive: Primitive, count: int) -> NDArray[np.float64] | None:
        """Return vertex colour times the material's colour times its texture where the vertex lies on it.

        Returns
        -------
        (count, 3) float64 or None
            Linear RGB; None where the file says nothing.
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
            picture = None if source is None else self._picture(source)
            if uv is not None and picture is not None:
                colors *= _sample(picture, uv)
        return colors

    def _picture(self, source: int) -> NDArray[np.uint8] | None:
        """Return the (height, width, 3) sRGB of a picture, or None where it cannot be opened."""
        if source not in self._pictures:
            try:
                self._pictures[source] = self._opened(self._document.gltf["images"][source])
            except Exception:
                self._pictures[source] = None
        return self._pictures[source]

    def _opened(self, image: schema.Image) -> NDArray[np.uint8]:
        if "bufferView" in image:
            view = self._document.gltf["bufferViews"][image["bufferView"]]
            start = view.get("byteOffset", 0)
            content = bytes(self._document.blob[start : start + view["byteLength"]])
        else:
            content = base64.b64decode(image.get("uri", "").partition(",")[2])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its size, which is checked here
            picture = Image.open(io.BytesIO(content), formats=("PNG", "JPEG", "WEBP"))
        self._pixels += picture.width * picture.height
        if self._pixels > MAX_PIXELS:
            raise ValueError(f"{self._pixels} pixels")
        picture.thumbnail((1024, 1024))
        return np.asarray(picture.convert("RGB"))


def _sample(picture: NDArray[np.uint8], uv: NDArray[np.floating]) -> NDArray[np.float32]:
    """Take the nearest pixel of each vertex in linear RGB; a picture repeats beyond its edges."""
    height, width = picture.shape[:2]
    place = np.nan_to_num(uv) % 1.0
    column = np.minimum((place[:, 0] * width).astype(int), width - 1)
    row = np.minimum((place[:, 1] * height).astype(int), height - 1)
    return _linear(picture[row, column].astype(np.float32) / np.float32(255))


def _linear(srgb: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).astype(np.float32)
