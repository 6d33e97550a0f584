"""Vertices out of corners that name their position, texture coordinates and normal apart."""

import numpy as np
from numpy.typing import NDArray

from solver.surface.winding import in_order


def unique_rows(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find equal rows in linear time.

    Parameters
    ----------
    rows : (r, k) int64
        From −1 to some number that is not much larger than r.

    Returns
    -------
    first : (n,) int64
        The first row of each kind, the kinds sorted by their first entries, then by the second ones and so on.
    kind : (r,) int64
        As an index into `first`.
    """
    order = in_order(rows + 1, int(rows.max(initial=-1)) + 2)
    new = np.zeros(len(rows), dtype=np.bool_)
    new[:1] = True
    for column in rows.T:
        ordered = column[order]
        new[1:] |= ordered[1:] != ordered[:-1]
    kind = np.empty(len(rows), dtype=np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


def distinct_corners(corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the distinct_corners corners, which are a mesh's vertices.

    Parameters
    ----------
    corners : (c, k) int64
        Indices from −1 on.

    Returns
    -------
    first : (n,) int64
        The first corner of each kind, ascending.
    vertex_of : (c,) int64
        The vertex, as an index into `first`, that each corner becomes.
    """
    first, kind = unique_rows(corners)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[kind]
