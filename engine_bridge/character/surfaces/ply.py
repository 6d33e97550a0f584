"""PLY: polygons or triangle strips, with normals, colours and texture coordinates."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.ply_tables import Table, read_tables
from engine_bridge.character.surfaces.polygons import distinct_corners, triangulate
from engine_bridge.character.surfaces.surface import (
    Piece,
    Surface,
    SurfaceMaterial,
    count,
    damaged,
    linear,
    material_for,
    outside,
    upper_left,
)
from puppetline.errors import MeshError, at

POSITION = ("x", "y", "z")
NORMAL = ("nx", "ny", "nz")
COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
OPACITY = ("alpha", "diffuse_alpha", "a")
TEXTURE_COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
CORNERS = ("vertex_indices", "vertex_index")
TEXTURE_CORNERS = "texcoord"
"""Property with the texture coordinates of a face's corners, which MeshLab writes."""

FULL_SCALE = {np.dtype(np.uint8): 255.0, np.dtype(np.uint16): 65535.0}
"""Largest value of a colour by type."""

SUPPORTED_PROPERTIES = {
    "vertex": {*POSITION, *NORMAL, *OPACITY, *(name for names in COLORS + TEXTURE_COORDINATES for name in names)},
    "face": {*CORNERS, TEXTURE_CORNERS},
    "tristrips": set(CORNERS),
}
"""Properties that are read, by element."""


def read(path: Path, content: bytes) -> Surface:
    """Read a PLY file.

    Vertex colours are sRGB. Texture coordinates of vertices or of the corners of faces belong to the image that a
    comment ``TextureFile`` names.

    Raises
    ------
    MeshError
        The file has no surface or a part that cannot be read; the message has the line, or the element and row.
    """
    tables, images = read_tables(path, content)
    vertex, notes = tables.get("vertex", {}), _ignored(tables)
    folder = Folder(path, notes)
    positions = _positions(path, vertex)
    triangles, uvs_of_corners = _triangles(path, tables, positions, notes)
    normals, colors, uvs = _numbers(vertex, NORMAL), _colors(vertex, notes), _texture_coordinates(vertex)
    if uvs_of_corners is not None:
        _, uv = np.unique(uvs_of_corners, axis=0, return_inverse=True)
        used = triangles.ravel()
        first, vertex_of = distinct_corners(np.column_stack([used, uv.ravel()]))
        lost = len(positions) - len(np.unique(used))
        if lost:
            notes.append(f"{count(lost, 'vertex', 'vertices')} without a face omitted.")
        kept = used[first]
        positions, triangles, uvs = positions[kept], vertex_of.reshape(-1, 3), uvs_of_corners[first]
        normals, colors = (None if values is None else values[kept] for values in (normals, colors))
    material = material_for(colors)
    if uvs is not None:
        uvs = upper_left(uvs)
        material = _textured(path, images, folder) or material
    elif images:
        notes.append(f"The image {images[0][1]!r} is omitted, because there are no texture coordinates.")
    return Surface([Piece("", positions, triangles, material, normals, uvs, colors)], notes, files=folder.files)


def _positions(path: Path, vertex: Table) -> NDArray[np.float64]:
    positions = _numbers(vertex, POSITION)
    if positions is None or not len(positions):
        raise damaged(path, "no vertices", "a PLY file whose vertices have x, y and z")
    wrong = outside(positions)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise damaged(at(path, field=f"vertex {row}"), str(positions[row].tolist()), "finite coordinates")
    return positions


def _triangles(
    path: Path, tables: dict[str, Table], positions: NDArray[np.float64], notes: list[str]
) -> tuple[NDArray[np.int64], NDArray[np.float64] | None]:
    """Return the triangles (t, 3), and the texture coordinates (3 t, 2) of their corners if faces have them."""
    if polygons := _lists(path, tables, "face", CORNERS):
        values, sizes = polygons
        corners = _indices(path, "face", values, sizes, len(positions))
        triangles, _ = triangulate(positions[corners], sizes)
        few = int((sizes < 3).sum())
        if few:
            notes.append(f"{count(few, 'face')} with fewer than 3 corners omitted.")
        of_corners = _lists(path, tables, "face", (TEXTURE_CORNERS,))
        if of_corners and np.array_equal(of_corners[1], 2 * sizes):
            return corners[triangles], _floats(of_corners[0]).reshape(-1, 2)[triangles.ravel()]
        if of_corners:
            notes.append("Texture coordinates are omitted, because some faces have none.")
        return corners[triangles], None
    if strips := _lists(path, tables, "tristrips", CORNERS):
        values, sizes = strips
        return _unrolled(_indices(path, "tristrips", values, sizes, len(positions), least=-1), sizes), None
    raise MeshError(
        path,
        found="no faces",
        expected="a PLY file with faces",
        fix="Export the mesh, or reconstruct a surface from the points (MeshLab: Screened Poisson).",
    )


def _lists(
    path: Path, tables: dict[str, Table], element: str, names: tuple[str, ...]
) -> tuple[NDArray[Any], NDArray[np.int64]] | None:
    """Return the values and the lengths of the lists of the first column that exists and is not empty."""
    for column in (tables[element][name] for name in names if name in tables.get(element, {})):
        if column.lengths is None:
            raise damaged(at(path, field=f"element {element}"), "one corner per face", "a list of corners")
        if len(column.values):
            return column.values, column.lengths
    return None


def _indices(
    path: Path, element: str, values: NDArray[Any], lengths: NDArray[np.int64], vertices: int, least: int = 0
) -> NDArray[np.int64]:
    """Return the vertices that the rows of an element name; refuse indices outside the range from `least` on."""
    wrong = ~((values >= least) & (values < vertices) & (values == np.floor(values)))
    if wrong.any():
        first = int(np.argmax(wrong))
        row = int(np.searchsorted(np.cumsum(lengths), first, side="right"))
        raise damaged(
            at(path, field=f"{element} {row}"), f"vertex {values[first]:.15g}", f"vertices from 0 to {vertices - 1:,}"
        )
    return values.astype(np.int64)


def _unrolled(corners: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the triangles of strips, which end at −1 or with their list, without degenerate ones."""
    row = np.repeat(np.arange(len(lengths)), lengths)
    index = np.arange(len(corners))
    begins = np.ones(len(corners), dtype=bool)
    begins[1:] = (corners[:-1] < 0) | (row[1:] != row[:-1])
    odd = (index - np.maximum.accumulate(np.where(begins, index, 0)))[:-2] % 2 == 1
    triangles = np.column_stack([corners[:-2], corners[1:-1], corners[2:]])
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    a, b, c = triangles.T
    return triangles[(triangles >= 0).all(axis=1) & (row[:-2] == row[2:]) & (a != b) & (b != c) & (c != a)]


def _numbers(vertex: Table, names: tuple[str, ...]) -> NDArray[np.float64] | None:
    """Return columns side by side, or None if one is missing."""
    columns = [_floats(vertex[name].values) for name in names if name in vertex and vertex[name].lengths is None]
    return np.column_stack(columns) if len(columns) == len(names) else None


def _floats(values: NDArray[Any]) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one
        return values.astype(np.float64)


def _texture_coordinates(vertex: Table) -> NDArray[np.float64] | None:
    found = (_numbers(vertex, names) for names in TEXTURE_COORDINATES)
    return next((coordinates for coordinates in found if coordinates is not None), None)


def _colors(vertex: Table, notes: list[str]) -> NDArray[np.float64] | None:
    """Return linear colours; integer types have the range 0 to 255 or 65535, others that of `linear`."""
    rgb = next((names for names in COLORS if _numbers(vertex, names) is not None), None)
    if rgb is None:
        return None
    opacity = next(((name,) for name in OPACITY if _numbers(vertex, (name,)) is not None), ())
    columns = [vertex[name] for name in (*rgb, *opacity)]
    colors = linear(np.column_stack([column.values / FULL_SCALE.get(column.kind, 1.0) for column in columns]))
    if not colors[:, 3].any():
        notes.append("All vertices would be invisible and were made opaque.")
        colors[:, 3] = 1
    return colors


def _textured(path: Path, images: list[tuple[int, str]], folder: Folder) -> SurfaceMaterial | None:
    """Return a material with the file's image, or None without one."""
    if len(images) > 1:
        folder.notes.append(f"{count(len(images), 'image')} named; only the first is used.")
    for line, name in images[:1]:
        image = folder.image(name, path.parent, at(path, line=line))
        if image:
            return SurfaceMaterial(texture=image)
    return None


def _ignored(tables: dict[str, Table]) -> list[str]:
    """Return a note about ignored elements and properties."""
    names = [
        f"{element} {name}" if element in SUPPORTED_PROPERTIES else element
        for element, table in tables.items()
        for name in table
        if name not in SUPPORTED_PROPERTIES.get(element, ())
    ]
    return [f"Ignored: {', '.join(dict.fromkeys(names))}."] if names else []
