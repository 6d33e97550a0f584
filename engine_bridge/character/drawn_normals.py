"""Normals for drawing a character: those of its file, or smooth ones."""

import igl
import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character


def drawn_normals(character: Character) -> NDArray[np.float64]:
    """Return unit normals (n, 3): the file's, or smooth ones for parts without normals; zero without a direction.

    Subnormal float32 numbers become zero, because graphics cards treat them as zero and would choose other tangents
    (docs/protocol.md).
    """
    parts = [
        igl.per_vertex_normals(part.vertices, part.triangles) if part.normals is None else part.normals
        for part in character.parts
    ]
    normals = np.nan_to_num(np.concatenate(parts))
    return np.where(np.abs(normals) < np.finfo(np.float32).tiny, 0.0, normals)
