"""Images of a document, for pictures of its character."""

import base64
import io
import warnings

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from engine_bridge.character import schema
from engine_bridge.character.document import Document

MAX_PIXELS = 8192 * 8192
"""Maximum number of pixels of all images of a character together; an image that exceeds it is not shown."""

MAX_SIDE = 1024
"""Maximum width and height at which an image is kept, in pixels."""


class Images:
    """The images of a document, which are opened when they are first used.

    Parameters
    ----------
    document : Document
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._pixels = 0
        self._images: dict[int, NDArray[np.uint8] | None] = {}

    def of_texture(self, texture: int) -> NDArray[np.uint8] | None:
        """Return the sRGB pixels and opacity (height, width, 4) of a texture, or None if it cannot be opened."""
        source = self._document.gltf["textures"][texture].get("source")
        if source is None:
            return None
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
        opened.thumbnail((MAX_SIDE, MAX_SIDE))
        return np.asarray(opened.convert("RGBA"))
