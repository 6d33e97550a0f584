"""Wavefront OBJ: positions, vertex colours and faces, whatever else stands in the file."""

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from puppetline.errors import MeshError, at

CONTINUED = "\t \t"
"""Stands for the end of a line that goes on in the next."""


def read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64] | None]:
    """Read an OBJ file; polygons are split into fans.

    Lines may be continued with a backslash, and indices may count backwards from the last vertex.

    Returns
    -------
    vertices : (n, 3) float64
    triangles : (t, 3) int64
    colors : (n, 3) float64 or None
        The values 4 to 6 of the vertex lines, where all of them have such.

    Raises
    ------
    MeshError
        With the line that cannot be read.
    """
    vertices: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    text = path.read_text(encoding="utf-8", errors="replace").replace("\\\n", CONTINUED)
    number = 1
    for line in text.split("\n"):
        kind, *fields = line.split() or [""]
        try:
            if kind == "v":
                vertices.append([float(field) for field in fields])
            elif kind == "f":
                corners = [_index(field, len(vertices)) for field in fields]
                triangles += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
        except ValueError as error:
            raise MeshError(
                at(path, line=number),
                found=repr(line.strip()[:60]),
                expected="'v x y z' with numbers, or 'f a b c' with vertex indices from 1",
                fix="Export the mesh again, or remove that line.",
            ) from error
        number += 1 + line.count(CONTINUED)
    table = _table(path, vertices)
    colors = table[:, 3:6] if table.shape[1] >= 6 else None
    return table[:, :3], np.array(triangles, dtype=np.int64).reshape(-1, 3), colors


def _index(field: str, count: int) -> int:
    """Return the vertex of a face corner like ``7``, ``7/2/3`` or ``-1``, counted from 0."""
    index = int(field.partition("/")[0])
    if index == 0:
        raise ValueError("OBJ counts from 1")
    return index - 1 if index > 0 else count + index


def _table(path: Path, vertices: list[list[float]]) -> NDArray[np.float64]:
    widths = {len(vertex) for vertex in vertices}
    if not vertices or min(widths) < 3:
        raise MeshError(
            path,
            found="a vertex with fewer than 3 coordinates" if vertices else "no vertices",
            expected="'v x y z' lines",
            fix="Check that this is a mesh, and export it again.",
        )
    width = min(widths)
    return np.array([vertex[:width] for vertex in vertices], dtype=np.float64)
