"""What a character's parts look like: colours, textures and opacity, for pictures of them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character
from engine_bridge.character.images import Images

DEFAULT_CUTOFF = 0.5
"""Opacity below which a point of a mask is not shown, if the file does not state it (glTF 2.0, section 3.9.4)."""


@dataclass(frozen=True)
class Material:
    """Appearance of one part of a character.

    Attributes
    ----------
    color : (4,) float32
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

    color: NDArray[np.float32]
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


def materials_of(character: Character) -> list[Material]:
    """Return the appearance of each part of a character; parts with one texture share its array.

    Raises
    ------
    MeshError
        Colours or texture coordinates are damaged.
    """
    document, images = character.document, Images(character.document)
    gltf, made = document.gltf, []
    for part in character.parts:
        primitive, count = (
            gltf["meshes"][gltf["nodes"][part.node]["mesh"]]["primitives"][part.primitive],
            len(part.vertices),
        )
        material: dict[str, Any] = dict(gltf["materials"][primitive["material"]]) if "material" in primitive else {}
        surface = material.get("pbrMetallicRoughness", {})
        own = document.attribute(primitive, "COLOR_0", count, 3, 4)
        if own is not None and own.shape[1] == 3:
            own = np.column_stack([own, np.ones(count)])
        image, uv = None, None
        if "baseColorTexture" in surface:
            texture = surface["baseColorTexture"]
            transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
            number = transform.get("texCoord", texture.get("texCoord", 0))
            uv = document.attribute(primitive, f"TEXCOORD_{number}", count, 2)
            image = None if uv is None else images.of_texture(texture["index"])
            uv = None if uv is None else _transformed(uv, transform)
        made.append(
            Material(
                color=np.array(surface.get("baseColorFactor", [1.0] * 4), np.float32),
                vertex_colors=None if own is None else own.astype(np.float32),
                image=image,
                uv=np.zeros((count, 2), np.float32) if uv is None else np.nan_to_num(uv).astype(np.float32),
                opacity=material.get("alphaMode", "OPAQUE"),
                cutoff=float(material.get("alphaCutoff", DEFAULT_CUTOFF)),
                unlit="KHR_materials_unlit" in material.get("extensions", {}),
                two_sided=material.get("doubleSided", "material" not in primitive),
            )
        )
    return made


def _transformed(uv: NDArray[Any], transform: dict[str, Any]) -> NDArray[Any]:
    """Return texture coordinates after the extension KHR_texture_transform."""
    turn = float(transform.get("rotation", 0.0))
    linear = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * transform.get("scale", [1, 1])
    moved: NDArray[Any] = uv @ linear.T + transform.get("offset", [0, 0])
    return moved
