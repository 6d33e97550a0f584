"""What every reader gives: pieces of surface with one material each."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from puppetline.errors import MeshError

MAX_COORDINATE = 1e18
"""Coordinates beyond it are no mesh's; the square of any below it still fits a float32."""


@dataclass(frozen=True)
class Picture:
    """A whole PNG or JPEG file.

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
class Material:
    """How a piece looks, in glTF's terms.

    Attributes
    ----------
    name : str
    base_color : (4,) float
        Linear RGB and opacity.
    metallic, roughness : float
        0 to 1.
    emissive : (3,) float
        Linear RGB, 0 to 1.
    texture, normal_texture : Picture or None
        Base colour, which is multiplied with `base_color`, and normals in tangent space.
    alpha_mode : str
        What opacity means.
    double_sided : bool
    """

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    metallic: float = 0.0
    roughness: float = 0.7
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    texture: Picture | None = None
    normal_texture: Picture | None = None
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    double_sided: bool = False


DEFAULT_MATERIAL = Material(base_color=(0.62, 0.6, 0.57, 1.0))
"""For what comes without any colour."""


@dataclass(frozen=True)
class Piece:
    """Triangles of one object that have one material.

    Attributes
    ----------
    name : str
        The object's or group's, empty where the file names none.
    positions : (n, 3) float64
    triangles : (t, 3) int64
    material : Material
    normals : (n, 3) float64 or None
        As the file has them, of any length; unit vectors after `engine_bridge.character.shading.shaded`.
    uvs : (n, 2) float64 or None
        From the picture's upper left corner, v down.
    colors : (n, 4) float64 or None
        Linear RGB and opacity, 0 to 1.
    """

    name: str
    positions: NDArray[np.float64]
    triangles: NDArray[np.int64]
    material: Material = DEFAULT_MATERIAL
    normals: NDArray[np.float64] | None = None
    uvs: NDArray[np.float64] | None = None
    colors: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Surface:
    """All that was read from a file.

    Attributes
    ----------
    pieces : list of Piece
    notes : list of str
        What was changed or could not be carried.
    faceted : bool
        Pieces without normals are shown with a hard edge between any two triangles.
    files : dict
        The files that it names, see `engine_bridge.character.surfaces.files.Folder`.
    """

    pieces: list[Piece]
    notes: list[str] = field(default_factory=list)
    faceted: bool = False
    files: dict[tuple[str, str], str] = field(default_factory=dict)


def linear(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn sRGB colours into linear ones (IEC 61966-2-1), opacity in a fourth column unchanged.

    Parameters
    ----------
    srgb : (n, 3) or (n, 4) float64
        From 0 to 1, or to 255 where any is beyond 1.

    Returns
    -------
    (n, 4) float64
    """
    values = np.nan_to_num(srgb, nan=1.0)
    values = np.clip(values / 255 if values.max(initial=0) > 1 else values, 0.0, 1.0)
    rgba = np.ones((len(values), 4))
    rgba[:, : values.shape[1]] = values
    rgba[:, :3] = np.where(rgba[:, :3] <= 0.04045, rgba[:, :3] / 12.92, ((rgba[:, :3] + 0.055) / 1.055) ** 2.4)
    return rgba


def upper_left(uvs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn (n, 2) texture coordinates from a picture's lower left corner into glTF's, from its upper left."""
    return np.nan_to_num(np.column_stack([uvs[:, 0], 1 - uvs[:, 1]]), posinf=0.0, neginf=0.0)


def material_for(colors: NDArray[np.float64] | None) -> Material:
    """Return the material of a piece that has none of its own: it leaves vertex colours as they are."""
    if colors is None:
        return DEFAULT_MATERIAL
    return Material(alpha_mode="OPAQUE" if (colors[:, 3] == 1).all() else "BLEND")


def damaged(where: str | Path, found: str, expected: str) -> MeshError:
    """Make the error for a file that cannot be what was exported."""
    return MeshError(where, found=found, expected=expected, fix="Export or download the mesh again.")


def outside(positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark the (n, 3) positions that are not finite or farther away than any mesh."""
    return np.logical_not((np.abs(positions) <= MAX_COORDINATE).all(axis=1))


def count(number: int, one: str, more: str | None = None) -> str:
    """Write a number of things: ``1 face``, ``2,000 faces``; `more` where that is not `one` with an s."""
    return f"{number:,} {one if number == 1 else more or one + 's'}"
