"""Colours of primitives for previews, one per vertex."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.document import Document
from engine_bridge.character.images import Images
from engine_bridge.character.schema import Primitive
from engine_bridge.character.surfaces.surface import srgb_to_linear


class Appearance:
    """The colours of a document's primitives, for previews.

    Parameters
    ----------
    document : Document
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._images = Images(document)

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
            image = self._images.of_texture(texture["index"])
            if uv is not None and image is not None:
                colors *= _sample(image, uv)
        return colors


def _sample(image: NDArray[np.uint8], uv: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the nearest pixel of each vertex in linear RGB; the image repeats beyond its edges."""
    height, width = image.shape[:2]
    place = np.nan_to_num(uv) % 1.0
    column = np.minimum((place[:, 0] * width).astype(int), width - 1)
    row = np.minimum((place[:, 1] * height).astype(int), height - 1)
    return srgb_to_linear(image[row, column, :3].astype(np.float32) / np.float32(255))
