"""Vertices out of corners that name their position, texture coordinates and normal apart."""

import numpy as np
from numpy.typing import NDArray


def distinct(corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the distinct corners, which are a mesh's vertices.

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
    key = corners[:, 0]
    for column in corners.T[1:]:  # renumbered each time, so that the products stay small
        _, key = np.unique(key * (int(column.max(initial=0)) + 2) + column + 1, return_inverse=True)
    _, first, vertex_of = np.unique(key, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[vertex_of]
