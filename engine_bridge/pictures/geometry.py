"""The characters of a film, arranged for drawing: everything about them but where their vertices are."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Part
from engine_bridge.character.materials import Appearance
from engine_bridge.character.surfaces.surface import srgb_to_linear
from engine_bridge.pictures.coarse import coarse_triangles
from engine_bridge.pictures.textures import Textures, textures_of

CLAY = (0.60, 0.40, 0.27)
"""Linear RGB colour of a mesh without colours."""

SHADOW_CELL = 0.012
"""Width of the cells of the surface that casts shadows, as a share of its character's size; less than a penumbra."""

FINE_SHARE = 0.02
"""Side of triangles, as a share of their character's size, up to which light is computed at vertices."""

OPACITIES = OPAQUE, MASK, BLEND = range(3)
"""Numbers of glTF's kinds of opacity."""

LINEAR = srgb_to_linear(np.linspace(0, 1, 256, dtype=np.float32))
"""Linear light of the numbers of sRGB."""


class Surfaces(NamedTuple):
    """All characters as one surface of n vertices, t triangles and p parts, each with a material.

    Attributes
    ----------
    triangles : (t, 3) int32
    part : (t,) int32
        Of each triangle.
    colors : (n, 4) float32
        Linear RGB and opacity, without the texture.
    uv : (n, 2) float32
    image : (p,) int32
        Number of the texture; −1 for none.
    opacity : (p,) int8
        One of `OPACITIES`.
    cutoff : (p,) float32
    unlit, two_sided : (p,) bool
        See `Appearance`.
    fine : (p,) bool
        Whether triangles are so small that light is computed at their vertices, once for all those around each.
    textures : Textures
    """

    triangles: NDArray[np.int32]
    part: NDArray[np.int32]
    colors: NDArray[np.float32]
    uv: NDArray[np.float32]
    image: NDArray[np.int32]
    opacity: NDArray[np.int8]
    cutoff: NDArray[np.float32]
    unlit: NDArray[np.bool_]
    two_sided: NDArray[np.bool_]
    fine: NDArray[np.bool_]
    textures: Textures


class Geometry(NamedTuple):
    """Characters, whose vertices stand one character after another, and within it one part after another.

    Attributes
    ----------
    surfaces : Surfaces
    casting : (c, 3) int32
        Triangles that cast shadows.
    starts : list of int
        Number of the first vertex of each character, and of all vertices.
    transparent : list of (u,) int32
        Of each character, the triangles of its parts that mix with what is behind them.
    """

    surfaces: Surfaces
    casting: NDArray[np.int32]
    starts: list[int]
    transparent: list[NDArray[np.int32]]


def geometry_of(characters: Sequence[tuple[Sequence[Part], Sequence[Appearance]]]) -> Geometry:
    """Return the characters of a film, from the parts of each and their materials."""
    parts = [part for drawn, _ in characters for part in drawn]
    materials = [material for _, own in characters for material in own]
    vertices = _joined([part.vertices for part in parts], 3, np.float64)
    first_vertices = np.cumsum([0, *(len(part.vertices) for part in parts)])
    triangles = [part.triangles + first for part, first in zip(parts, first_vertices, strict=False)]
    first_triangles = np.cumsum([0, *map(len, triangles)])
    images = {id(each.image): each.image for each in materials if each.image is not None}
    numbers = {key: number for number, key in enumerate(images)}
    casting, starts, transparent, fine = [], [0], [], list[bool]()
    for drawn, _ in characters:
        own = range(len(fine), len(fine) + len(drawn))
        size = float(np.ptp(vertices[starts[-1] : first_vertices[own.stop]], axis=0).max())
        blended = [each for each in own if materials[each].opacity == "BLEND"]
        solid = _joined([triangles[each] for each in own if each not in blended], 3)
        casting.append(coarse_triangles(vertices, solid, max(SHADOW_CELL * size, 1e-12)))
        transparent.append(_joined([np.arange(*first_triangles[each : each + 2]) for each in blended]))
        fine += [are_fine(vertices, triangles[each], size) for each in own]
        starts.append(int(first_vertices[own.stop]))
    surfaces = Surfaces(
        triangles=_joined(triangles, 3),
        part=np.repeat(np.arange(len(parts), dtype=np.int32), np.diff(first_triangles)),
        colors=_joined([_colors(each) for each in materials], 4, np.float32),
        uv=_joined([each.uv for each in materials], 2, np.float32),
        image=np.array([-1 if each.image is None else numbers[id(each.image)] for each in materials], np.int32),
        opacity=np.array([("OPAQUE", "MASK", "BLEND").index(each.opacity) for each in materials], np.int8),
        cutoff=np.array([each.cutoff for each in materials], np.float32),
        unlit=np.array([each.unlit for each in materials], np.bool_),
        two_sided=np.array([each.two_sided for each in materials], np.bool_),
        fine=np.array(fine, np.bool_),
        textures=textures_of(list(images.values()), LINEAR),
    )
    return Geometry(surfaces, _joined(casting, 3), starts, transparent)


def _joined(arrays: Sequence[NDArray[Any]], columns: int | None = None, kind: type = np.int32) -> NDArray[Any]:
    """Return arrays (n,) or (n, columns), of which there may be none, one after another."""
    empty: NDArray[Any] = np.zeros((0, columns) if columns else 0, kind)
    return np.concatenate([empty, *arrays]).astype(kind)


def _colors(material: Appearance) -> NDArray[np.float32]:
    """Return the colours (n, 4) of a part's vertices, linear RGB and opacity."""
    color = np.array((*CLAY, 1.0) if material.plain else material.color, np.float32)
    colors = np.tile(color, (len(material.uv), 1))
    if material.vertex_colors is not None:
        colors *= material.vertex_colors
    if material.opacity == "OPAQUE":  # glTF: opacity is ignored
        colors[:, 3] = 1
    return colors


def are_fine(vertices: NDArray[np.float64], triangles: NDArray[np.int64], size: float) -> bool:
    """Return whether the mean area of triangles is that of small ones, see `FINE_SHARE`, for a character's size."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return not len(areas) or bool(np.sqrt(2 * areas.mean()) <= FINE_SHARE * size)
