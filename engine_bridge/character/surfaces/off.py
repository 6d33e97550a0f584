"""OFF as text: polygons, with normals (NOFF), colours (COFF) and texture coordinates (STOFF) of vertices."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.polygons import triangulate
from engine_bridge.character.surfaces.surface import Piece, Surface, count, damaged, linear, material_for, upper_left
from engine_bridge.character.surfaces.text import Rows, decoded, filled_lines, spans
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
    binary = re.match(rb"\s*\w*OFF\s+BINARY", content[:100])
    if binary:
        raise MeshError(path, found="a binary OFF file", expected="OFF as text", fix="Export the mesh as .ply or .obj.")
    lines = Rows(path, "the numbers of vertices, faces and edges")
    for number, line in filled_lines(decoded(path, content)):
        if text := line.partition("#")[0].strip():
            lines.lines.append(number)
            lines.texts.append(text)
    keyword = KEYWORD.match(lines.texts[0]) if len(lines) else None
    if keyword:  # counts may follow on its line, even without a space
        lines.texts[0] = lines.texts[0][keyword.end() :].strip()
        begin = 0 if lines.texts[0] else 1
        lines = replace(lines, lines=lines.lines[begin:], texts=lines.texts[begin:])
    textured, colored, with_normals, *of_other_dimension = keyword.groups() if keyword else [None] * 5
    if any(of_other_dimension):
        raise MeshError(
            path, found="vertices with another dimension", expected="x, y and z", fix="Export the mesh as plain OFF."
        )
    vertices, faces, notes = _divided(path, lines)
    needed = 3 + 3 * bool(with_normals) + 3 * bool(colored) + 2 * bool(textured)
    table = vertices.positions()
    if table.shape[1] < needed:
        vertices.refuse(vertices.widths < needed)
    end = 6 if with_normals else 3
    colors = linear(table[:, end : table.shape[1] - 2 * bool(textured)][:, :4]) if colored else None
    triangles, more_notes = _triangles(faces, table[:, :3])
    piece = Piece(
        name="",
        positions=table[:, :3],
        triangles=triangles,
        material=material_for(colors),
        normals=table[:, 3:6] if with_normals else None,
        uvs=upper_left(table[:, -2:]) if textured else None,
        colors=colors,
    )
    return Surface([piece], notes + more_notes)


def _divided(path: Path, lines: Rows) -> tuple[Rows, Rows, list[str]]:
    """Return the lines of vertices, the lines of faces, and notes about further lines."""
    if not len(lines):
        raise damaged(path, "no counts", lines.expected)
    counts = lines.texts[0].split()
    if not (2 <= len(counts) <= 3 and all(number.isascii() and number.isdigit() for number in counts)):
        raise lines.error(0)
    vertices, faces = (int(number[:12]) for number in counts[:2])
    where, there = at(path, line=lines.lines[0]), len(lines) - 1
    if not vertices or not faces:
        raise damaged(where, repr(lines.texts[0]), "at least one vertex and one face")
    if vertices + faces > there:
        announced = f"{count(vertices, 'vertex', 'vertices')} and {count(faces, 'face')} announced"
        raise damaged(where, announced, f"one line for each, more than the {there:,} in the file")
    points, polygons = slice(1, vertices + 1), slice(vertices + 1, vertices + faces + 1)
    rest = there - vertices - faces
    return (
        Rows(path, "'x y z' with finite numbers", lines.lines[points], lines.texts[points]),
        Rows(
            path,
            f"'n v1 … vn' with vertices from 0 to {vertices - 1}",
            lines.lines[polygons],
            lines.texts[polygons],
        ),
        [f"{count(rest, 'line')} after the last face omitted."] if rest else [],
    )


def _triangles(faces: Rows, positions: NDArray[np.float64]) -> tuple[NDArray[np.int64], list[str]]:
    """Return the faces as triangles, and notes about omissions."""
    values, widths = faces.numbers, faces.widths
    starts = np.cumsum(widths) - widths
    stated = values[starts]  # no line is empty
    faces.refuse(~((stated >= 0) & (stated < widths) & (stated == np.floor(stated))))
    sizes = stated.astype(np.int64)
    indices = values[spans(starts + 1, sizes)]
    wrong = ~((indices >= 0) & (indices < len(positions)) & (indices == np.floor(indices)))
    if wrong.any():
        raise faces.error(int(np.repeat(np.arange(len(sizes)), sizes)[np.argmax(wrong)]))
    corners = indices.astype(np.int64)
    notes = []
    if (widths > sizes + 1).any():
        notes.append("Colours of faces are omitted; glTF supports them at vertices only.")
    if (sizes < 3).any():
        notes.append(f"{count(int((sizes < 3).sum()), 'face')} with fewer than 3 corners omitted.")
    return corners[triangulate(positions[corners], sizes)[0]], notes
