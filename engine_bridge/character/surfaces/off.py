"""OFF in its text form: polygons, with normals (NOFF), colours (COFF) and texture coordinates (STOFF) of vertices."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.polygons import triangulate
from engine_bridge.character.surfaces.surface import Piece, Surface, count, damaged, linear, material_for, upper_left
from engine_bridge.character.surfaces.text import Rows, decoded, lines_of, spans
from puppetline.errors import MeshError, at

KEYWORD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF(?![A-Za-z])")
HEAD = re.compile(rb"\A(?:\xef\xbb\xbf)?(?:\s|#.*\n)*(?:ST)?C?N?4?n?OFF(?![A-Za-z])")


def matches(head: bytes) -> bool:
    """Tell whether a file begins with the keyword of an OFF."""
    return HEAD.match(head) is not None


def read(path: Path, content: bytes) -> Surface:
    """Read an OFF file.

    Vertex colours are taken as sRGB; those of faces are left out.

    Raises
    ------
    MeshError
        With the line that cannot be read.
    """
    binary = re.match(rb"\s*\w*OFF\s+BINARY", content[:100])
    if binary:
        raise MeshError(path, found="a binary OFF file", expected="OFF as text", fix="Export the mesh as .ply or .obj.")
    lines = _Lines(path, content)
    keyword = KEYWORD.match(lines.text(0)) if len(lines) else None
    if keyword:
        lines.take(keyword.end())
    textured, colored, with_normals, *of_other_dimension = keyword.groups() if keyword else [None] * 5
    if any(of_other_dimension):
        raise MeshError(
            path, found="vertices in another space", expected="x, y and z", fix="Export the mesh as plain OFF."
        )
    vertices, faces, notes = _rows(path, lines)
    needed = 3 + 3 * bool(with_normals) + 3 * bool(colored) + 2 * bool(textured)
    table = vertices.positions()
    if table.shape[1] < needed:
        vertices.refuse(vertices.numbers[1] < needed)
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


class _Lines:
    """The lines that hold something besides a comment."""

    def __init__(self, path: Path, content: bytes) -> None:
        self._path = path
        lines = lines_of(decoded(path, content))
        filled = lines.starts < lines.comments
        self._data = lines.data
        self.numbers, self._starts, self._ends = lines.numbers[filled], lines.starts[filled], lines.comments[filled]

    def __len__(self) -> int:
        return len(self.numbers)

    def text(self, line: int) -> str:
        return self._data[self._starts[line] : self._ends[line]].tobytes().decode().strip()

    def take(self, characters: int) -> None:
        """Take ASCII characters from the first line: more may follow there, even without a space."""
        self._starts[0] += characters
        if not self.text(0):
            self.numbers, self._starts, self._ends = self.numbers[1:], self._starts[1:], self._ends[1:]

    def rows(self, which: slice, expected: str) -> Rows:
        return Rows(self._path, expected, self._data, self.numbers[which], self._starts[which], self._ends[which])


def _rows(path: Path, lines: _Lines) -> tuple[Rows, Rows, list[str]]:
    """Divide the lines after the keyword into those of vertices and those of faces, and note what is left."""
    expected = "the numbers of vertices, faces and edges"
    if not len(lines):
        raise damaged(path, "no counts", expected)
    line, text = int(lines.numbers[0]), lines.text(0)
    counts = text.split()
    if not (2 <= len(counts) <= 3 and all(number.isascii() and number.isdigit() for number in counts)):
        raise damaged(at(path, line=line), repr(text[:60]), expected)
    vertices, faces = (int(number[:12]) for number in counts[:2])
    if not vertices or not faces:
        raise damaged(at(path, line=line), repr(text), "a surface: points have none")
    rest = len(lines) - 1 - vertices - faces
    if rest < 0:
        raise damaged(
            at(path, line=line),
            f"{count(vertices, 'vertex', 'vertices')} and {count(faces, 'face')} announced",
            f"a line for each, and not {len(lines) - 1:,} in all",
        )
    vertex_rows = lines.rows(slice(1, vertices + 1), "'x y z' with finite numbers")
    face_rows = lines.rows(
        slice(vertices + 1, vertices + faces + 1), f"'n v1 … vn' with vertices from 0 to {vertices - 1}"
    )
    return vertex_rows, face_rows, [f"{count(rest, 'line')} after the last face left out."] if rest else []


def _triangles(faces: Rows, positions: NDArray[np.float64]) -> tuple[NDArray[np.int64], list[str]]:
    """Read the faces as triangles, and note what they have besides."""
    values, widths = faces.numbers
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
        notes.append("Colours of faces left out: glTF has them at vertices.")
    if (sizes < 3).any():
        notes.append(f"{count(int((sizes < 3).sum()), 'face')} of fewer than 3 corners left out.")
    return corners[triangulate(positions[corners], sizes)[0]], notes
