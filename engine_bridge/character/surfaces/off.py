"""OFF as text: polygons, with normals (NOFF), colours (COFF) and texture coordinates (STOFF) of vertices."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.polygons import triangulate
from engine_bridge.character.surfaces.surface import Piece, Surface, count, damaged, linear, material_for, upper_left
from engine_bridge.character.surfaces.text import decoded, filled_lines, position, unreadable
from puppetline.errors import MeshError, at

KEYWORD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF(?![A-Za-z])")
HEAD = re.compile(rb"\A(?:\xef\xbb\xbf)?(?:\s|#.*\n)*(?:ST)?C?N?4?n?OFF(?![A-Za-z])")


def matches(head: bytes) -> bool:
    """Return whether a file begins with the keyword of an OFF file."""
    return HEAD.match(head) is not None


def read(path: Path, content: bytes) -> Surface:
    """Read an OFF file.

    Vertex colours are sRGB; colours of faces are omitted.

    Raises
    ------
    MeshError
        The file has no surface or a line that cannot be read; the message has the line.
    """
    if re.match(rb"\s*\w*OFF\s+BINARY", content[:100]):
        raise MeshError(path, found="a binary OFF file", expected="OFF as text", fix="Export the mesh as .ply or .obj.")
    lines = list(filled_lines(decoded(path, content), comment="#"))
    keyword = KEYWORD.match(lines[0][1]) if lines else None
    if keyword:  # counts may follow on its line, even without a space
        counts = lines[0][1][keyword.end() :].strip()
        lines[:1] = [(lines[0][0], counts)] if counts else []
    textured, colored, with_normals, *of_other_dimension = keyword.groups() if keyword else [None] * 5
    if any(of_other_dimension):
        raise MeshError(
            path, found="vertices with another dimension", expected="x, y and z", fix="Export the mesh as plain OFF."
        )
    vertices, faces = _counts(path, lines)
    needed = 3 + 3 * bool(with_normals) + 3 * bool(colored) + 2 * bool(textured)
    rows = []
    for number, line in lines[1 : vertices + 1]:
        words = line.split()
        try:
            rows.append(position(words) + [float(word) for word in words[3:]])
        except ValueError:
            rows.append([])
        if len(rows[-1]) < needed:
            raise unreadable(path, number, line, "'x y z' with finite numbers")
    width = min(map(len, rows))
    table = np.array([row[:width] for row in rows])
    corners, sizes, notes = _polygons(path, lines[vertices + 1 : vertices + faces + 1], vertices)
    if rest := len(lines) - 1 - vertices - faces:
        notes.insert(0, f"{count(rest, 'line')} after the last face omitted.")
    end = 6 if with_normals else 3
    colors = linear(table[:, end : width - 2 * bool(textured)][:, :4]) if colored else None
    piece = Piece(
        name="",
        positions=table[:, :3],
        triangles=corners[triangulate(table[corners, :3], sizes)[0]],
        material=material_for(colors),
        normals=table[:, 3:6] if with_normals else None,
        uvs=upper_left(table[:, -2:]) if textured else None,
        colors=colors,
    )
    return Surface([piece], notes)


def _counts(path: Path, lines: list[tuple[int, str]]) -> tuple[int, int]:
    """Return the numbers of vertices and faces, which the first line states and the other lines have."""
    expected = "the numbers of vertices, faces and edges"
    if not lines:
        raise damaged(path, "no counts", expected)
    number, line = lines[0]
    if not re.fullmatch(r"[0-9]+(\s+[0-9]+){1,2}", line):
        raise unreadable(path, number, line, expected)
    vertices, faces = (int(stated[:12]) for stated in line.split()[:2])
    there = len(lines) - 1
    if not vertices or not faces:
        raise damaged(at(path, line=number), repr(line), "at least one vertex and one face")
    if vertices + faces > there:
        announced = f"{count(vertices, 'vertex', 'vertices')} and {count(faces, 'face')} announced"
        expected = f"one line for each, more than the {there:,} in the file"
        raise damaged(at(path, line=number), announced, expected)
    return vertices, faces


def _polygons(
    path: Path, lines: list[tuple[int, str]], vertices: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], list[str]]:
    """Return the corners of all polygons (c,), the size of each polygon (p,), and notes about omissions."""
    corners: list[int] = []
    sizes = []
    colored = False
    for number, line in lines:
        size, *rest = line.split()
        try:
            polygon = list(map(int, rest[: int(size)]))
        except ValueError:
            polygon = [-1]
        if not all(0 <= corner < vertices for corner in polygon) or len(polygon) != int(size):
            raise unreadable(path, number, line, f"'n v1 … vn' with vertices from 0 to {vertices - 1}")
        corners += polygon
        sizes.append(len(polygon))
        colored |= len(rest) > len(polygon)
    notes = []
    if colored:
        notes.append("Colours of faces are omitted; glTF supports them at vertices only.")
    if few := sum(size < 3 for size in sizes):
        notes.append(f"{count(few, 'face')} with fewer than 3 corners omitted.")
    return np.array(corners, dtype=np.int64), np.array(sizes), notes
