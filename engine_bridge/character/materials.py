"""What a character's parts look like: colours, textures and opacity, for pictures of them."""

import base64
import io
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import igl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from engine_bridge.character import schema
from engine_bridge.character.character import CharacterMesh
from engine_bridge.character.document import Document
from engine_bridge.character.surfaces.surface import srgb_to_linear

DEFAULT_CUTOFF = 0.5
"""Opacity below which a point of a mask is not shown, if the file does not state it (glTF 2.0, section 3.9.4)."""

MAX_PIXELS = 8192 * 8192
"""Maximum number of pixels of all images of a character together; an image that exceeds it is not shown."""

MAX_SIDE = 1024
"""Maximum width and height at which an image is kept, in pixels."""


@dataclass(frozen=True)
class Appearance:
    """Appearance of one part of a character.

    Attributes
    ----------
    color : (4,) float64
        Linear RGB and opacity.
    vertex_colors : (n, 4) float32 or None
        Linear RGB and opacity, by which the colour is multiplied.
    image : (h, w, 4) uint8 or None
        sRGB and opacity, by which the colour is multiplied.
    uv : (n, 2) float32
        Positions in the image, which repeats, from its top left corner; zeros if there is no image.
    opacity : str
        ``"OPAQUE"``, ``"MASK"`` or ``"BLEND"``, as in glTF.
    cutoff : float
        Opacity below which a point of a mask is not shown.
    unlit : bool
        Whether the colours are shown without light and shadow.
    two_sided : bool
        Whether triangles are seen from behind, too.
    """

    color: NDArray[np.float64]
    vertex_colors: NDArray[np.float32] | None
    image: NDArray[np.uint8] | None
    uv: NDArray[np.float32]
    opacity: str
    cutoff: float
    unlit: bool
    two_sided: bool

    @property
    def plain(self) -> bool:
        """Whether the part has neither colours nor a texture of its own."""
        return self.vertex_colors is None and self.image is None and bool((self.color == 1).all())

    @property
    def at_vertices(self) -> NDArray[np.float64]:
        """(n, 3) linear RGB: the part's colour times the vertex's, times the nearest pixel of the image."""
        colors = np.tile(self.color[:3], (len(self.uv), 1))
        if self.vertex_colors is not None:
            colors *= self.vertex_colors[:, :3]
        if self.image is not None:
            size = np.array(self.image.shape[1::-1])
            column, row = np.minimum((self.uv % 1.0 * size).astype(int), size - 1).T
            colors *= srgb_to_linear(self.image[row, column, :3].astype(np.float32) / np.float32(255))
        return colors


def materials_of(character: CharacterMesh) -> list[Appearance]:
    """Return the appearance of each part of a character; parts with one texture share its array.

    Raises
    ------
    MeshError
        Colours or texture coordinates are damaged.
    """
    document, images = character.document, Images(character.document)
    gltf, made = document.gltf, []
    for part in character.parts:
        primitive, count = character.primitive(part), len(part.vertices)
        material: dict[str, Any] = dict(gltf["materials"][primitive["material"]]) if "material" in primitive else {}
        surface = material.get("pbrMetallicRoughness", {})
        own = document.attribute(primitive, "COLOR_0", count, 3, 4)
        if own is not None and own.shape[1] == 3:
            own = np.column_stack([own, np.ones(count)])
        image, uv = None, None
        if "baseColorTexture" in surface:
            texture = surface["baseColorTexture"]
            transform = _transform(texture)
            number = transform.get("texCoord", texture.get("texCoord", 0))
            uv = document.attribute(primitive, f"TEXCOORD_{number}", count, 2)
            image = None if uv is None else images.of_texture(texture["index"])
            uv = None if uv is None else _transformed(uv, transform)
        made.append(
            Appearance(
                color=np.array(surface.get("baseColorFactor", [1.0] * 4), np.float64),
                vertex_colors=None if own is None else own.astype(np.float32),
                image=image,
                uv=np.zeros((count, 2), np.float32) if uv is None else np.nan_to_num(uv.astype(np.float32)),
                opacity=material.get("alphaMode", "OPAQUE"),
                cutoff=float(material.get("alphaCutoff", DEFAULT_CUTOFF)),
                unlit="KHR_materials_unlit" in material.get("extensions", {}),
                two_sided=material.get("doubleSided", "material" not in primitive),
            )
        )
    return made


def preview_colors(character: CharacterMesh) -> NDArray[np.float64] | None:
    """Return the colours (N, 3) of all vertices for previews, linear RGB; None if no part has colours or a material.

    Raises
    ------
    MeshError
        See `materials_of`.
    """
    primitives = [character.primitive(part) for part in character.parts]
    painted = ["material" in each or "COLOR_0" in each["attributes"] for each in primitives]
    if not any(painted):
        return None
    materials = zip(materials_of(character), painted, strict=True)
    return np.concatenate([each.at_vertices if own else np.full((len(each.uv), 3), 0.6) for each, own in materials])


def drawn_normals(character: CharacterMesh) -> NDArray[np.float64]:
    """Return unit normals (n, 3): the file's, or smooth ones for parts without normals; zero without a direction.

    Subnormal float32 numbers become zero, because graphics cards treat them as zero and would choose other tangents
    (docs/protocol.md).
    """
    parts = [
        igl.per_vertex_normals(part.vertices, part.triangles) if part.normals is None else part.normals
        for part in character.parts
    ]
    normals = np.nan_to_num(np.concatenate(parts))
    return np.where(np.abs(normals) < np.finfo(np.float32).tiny, 0.0, normals)


def _transform(texture: Mapping[str, Any]) -> dict[str, Any]:
    """Return the properties of a texture's extension KHR_texture_transform."""
    extensions = texture.get("extensions", {})
    found = extensions.get("KHR_texture_transform") if isinstance(extensions, dict) else None
    return found if isinstance(found, dict) else {}


@np.errstate(over="ignore", invalid="ignore")
def _transformed(uv: NDArray[Any], transform: dict[str, Any]) -> NDArray[Any]:
    """Return texture coordinates after the extension KHR_texture_transform; damaged properties change nothing."""
    try:
        turn = float(transform.get("rotation", 0.0))
        turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        scale, offset = (
            np.array(transform.get(name, [same] * 2), float) for name, same in (("scale", 1), ("offset", 0))
        )
        moved: NDArray[np.float32] = (uv @ (turned * scale).T + offset).astype(np.float32)
    except (TypeError, ValueError):
        return uv
    return moved


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
