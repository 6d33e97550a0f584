"""Finds the vertices of corners that have separate indices of position, texture coordinates and normal."""

import numpy as np
from numpy.typing import NDArray

from solver.surface.winding import lexicographic_order


def unique_rows(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find distinct rows in linear time.

    Parameters
    ----------
    rows : (r, k) int64
        Integers from −1 on; the time is also proportional to the largest one.

    Returns
    -------
    first : (n,) int64
        Index of the first row of each kind; kinds are sorted lexicographically.
    kind : (r,) int64
        Kind of each row, as an index into `first`.
    """
    order = lexicographic_order(rows + 1, int(rows.max(initial=-1)) + 2)
    new = np.zeros(len(rows), dtype=np.bool_)
    new[:1] = True
    for column in rows.T:
        ordered = column[order]
        new[1:] |= ordered[1:] != ordered[:-1]
    kind = np.empty(len(rows), dtype=np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


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
    first, kind = unique_rows(corners)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[kind]
