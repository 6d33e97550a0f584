"""Finds the vertices of corners that have separate indices of position, texture coordinates and normal."""

import numpy as np
from numpy.typing import NDArray

from solver.surface.winding import distinct_rows


def distinct_corners(corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the distinct corners, which become a mesh's vertices.

    Parameters
    ----------
    corners : (c, k) int64
        Indices, −1 for none.

    Returns
    -------
    first : (n,) int64
        Index of the first corner of each kind, ascending.
    vertex_of : (c,) int64
        Vertex of each corner, as an index into `first`.
    """
    first, kind = distinct_rows(corners)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[kind]
