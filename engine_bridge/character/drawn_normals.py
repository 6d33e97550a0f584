"""The normals that a character is drawn with: those of its file, or smooth ones where it has none."""

import igl
import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character


def drawn_normals(character: Character) -> NDArray[np.float64]:
    """Return unit normals (n, 3): the file's, or smooth ones for parts without; zero where there is no direction.

    What is too small for a float32 of full precision is zero: graphics cards take it for that, and would choose other
    tangents (docs/protocol.md).
    """
    made = [
        igl.per_vertex_normals(part.vertices, part.triangles) if part.normals is None else part.normals
        for part in character.parts
    ]
    normals = np.nan_to_num(np.concatenate(made))
    return np.where(np.abs(normals) < np.finfo(np.float32).tiny, 0.0, normals)
