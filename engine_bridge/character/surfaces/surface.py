"""Surfaces, which all readers return: pieces with one material each."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from puppetline.errors import MeshError

MAX_COORDINATE = 1e18
"""Maximum absolute coordinate of a mesh; its square fits into a float32."""

MAX_ORIGIN_DISTANCE = 10.0
"""Maximum distance of a surface from the origin, in diagonals, at which float32 positions are exact to 1e-6 of the
diagonal."""


@dataclass(frozen=True)
class ImageFile:
    """A PNG or JPEG file in memory.

    Attributes
    ----------
    name : str
        File name without its ending.
    mime : str
        ``image/png`` or ``image/jpeg``.
    content : bytes
    """

    name: str
    mime: str
    content: bytes = field(repr=False)


@dataclass(frozen=True)
class SurfaceMaterial:
    """Appearance of a piece in glTF's terms.

    Attributes
    ----------
    name : str
    base_color : (4,) float
        Linear RGB and opacity.
    metallic, roughness : float
        0 to 1.
    emissive : (3,) float
        Linear RGB, 0 to 1.
    texture, normal_texture : ImageFile or None
        Images of the base colour, which is multiplied by `base_color`, and of normals in tangent space.
    alpha_mode : str
        Interpretation of opacity.
    double_sided : bool
    """

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    metallic: float = 0.0
    roughness: float = 0.7
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    texture: ImageFile | None = None
    normal_texture: ImageFile | None = None
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    double_sided: bool = False


DEFAULT_MATERIAL = SurfaceMaterial(base_color=(0.62, 0.6, 0.57, 1.0))
"""SurfaceMaterial of pieces without colours."""


@dataclass(frozen=True)
class Piece:
    """Triangles of one object that have one material.

    Attributes
    ----------
    name : str
        Name of the object or group, empty if the file has none.
    positions : (n, 3) float64
    triangles : (t, 3) int64
    material : SurfaceMaterial
    normals : (n, 3) float64 or None
        Vectors of any length from the file; unit vectors after `engine_bridge.character.shading.shaded`.
    uvs : (n, 2) float64 or None
        Texture coordinates from the image's upper left corner, v down.
    colors : (n, 4) float64 or None
        Linear RGB and opacity, 0 to 1.
    """

    name: str
    positions: NDArray[np.float64]
    triangles: NDArray[np.int64]
    material: SurfaceMaterial = DEFAULT_MATERIAL
    normals: NDArray[np.float64] | None = None
    uvs: NDArray[np.float64] | None = None
    colors: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Surface:
    """Contents of a mesh file.

    Attributes
    ----------
    pieces : list of Piece
    notes : list of str
        Sentences about changes and omissions.
    faceted : bool
        Whether pieces without normals have hard edges between all triangles.
    files : dict
        Files that it names, see `engine_bridge.character.surfaces.files.Folder`.
    """

    pieces: list[Piece]
    notes: list[str] = field(default_factory=list)
    faceted: bool = False
    files: dict[tuple[str, str], str] = field(default_factory=dict)

    @property
    def origin(self) -> NDArray[np.float64]:
        """Origin (3,) of stored positions: the world's, or the middle, rounded to float32, of a far surface."""
        low = np.min([piece.positions.min(axis=0) for piece in self.pieces], axis=0)
        high = np.max([piece.positions.max(axis=0) for piece in self.pieces], axis=0)
        middle = (low + high) / 2
        if np.linalg.norm(middle) > MAX_ORIGIN_DISTANCE * np.linalg.norm(high - low):
            return middle.astype(np.float32).astype(np.float64)
        return np.zeros(3)


def linear(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert sRGB colours to linear ones; opacity in a fourth column is unchanged.

    Parameters
    ----------
    srgb : (n, 3) or (n, 4) float64
        Values from 0 to 1, or to 255 if any is greater than 1.

    Returns
    -------
    (n, 4) float64
    """
    values = np.nan_to_num(srgb, nan=1.0)
    values = np.clip(values / 255 if values.max(initial=0) > 1 else values, 0.0, 1.0)
    rgba = np.ones((len(values), 4))
    rgba[:, : values.shape[1]] = values
    rgba[:, :3] = srgb_to_linear(rgba[:, :3])
    return rgba


def srgb_to_linear(srgb: NDArray[np.floating]) -> NDArray[np.floating]:
    """Convert sRGB values from 0 to 1 to linear ones of the same shape and type (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).astype(srgb.dtype)


def upper_left(uvs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert texture coordinates (n, 2) from an image's lower left corner to its upper left corner, as in glTF."""
    return np.nan_to_num(np.column_stack([uvs[:, 0], 1 - uvs[:, 1]]), posinf=0.0, neginf=0.0)


def material_for(colors: NDArray[np.float64] | None) -> SurfaceMaterial:
    """Return the default material of a piece, which does not change vertex colours."""
    if colors is None:
        return DEFAULT_MATERIAL
    return SurfaceMaterial(alpha_mode="OPAQUE" if (colors[:, 3] == 1).all() else "BLEND")


def damaged(where: str | Path, found: str, expected: str) -> MeshError:
    """Return the error for a file that is not as it was exported."""
    return MeshError(where, found=found, expected=expected, fix="Export or download the mesh again.")


def outside(positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which positions (n, 3) are not finite or exceed the maximum coordinate."""
    return np.logical_not((np.abs(positions) <= MAX_COORDINATE).all(axis=1))


def count(number: int, one: str, more: str | None = None) -> str:
    """Return a number with a noun: ``1 face``, ``2,000 faces``; `more` is an irregular plural."""
    return f"{number:,} {one if number == 1 else more or one + 's'}"
