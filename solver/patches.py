"""Patches: triangles that meet two by two at their edges, and can be wound alike."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def wound_alike(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Wind the triangles of each patch like its first one.

    An edge joins two triangles where it has no third. Each triangle stands for two nodes of a graph, as it is wound and
    the other way round, and an edge links those that agree. Time and memory grow with the number of triangles, however
    many of them share an edge: `igl.bfs_orient` takes its square.

    Parameters
    ----------
    faces : (t, 3) int64
        With three different corners each.

    Returns
    -------
    wound : (t, 3) int64
        The triangles of a patch that has one side only, such as a Möbius strip, stay as they are.
    patch : (t,) int64
        Numbered from 0 in the order of their first triangles.
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    least, most = np.minimum(start, end), np.maximum(start, end)
    order = np.argsort(least * (int(most.max(initial=0)) + 1) + most, kind="stable")
    new = np.ones(len(order) + 1, dtype=bool)
    new[1:-1] = (np.diff(least[order]) != 0) | (np.diff(most[order]) != 0)
    firsts = np.nonzero(new)[0]
    double = firsts[:-1][np.diff(firsts) == 2]
    one, other = order[double], order[double + 1]
    crossed = start[one] == start[other]  # both pass the edge in the same direction
    a, b = 2 * (one // 3), 2 * (other // 3)
    links = np.concatenate([a, a + 1]), np.concatenate([b + crossed, b + 1 - crossed])
    count = 2 * len(faces)
    side = connected_components(coo_matrix((np.ones(len(links[0])), links), shape=(count, count)), directed=False)[1]
    as_it_is, turned = side[::2], side[1::2]
    _, first, patch = np.unique(np.minimum(as_it_is, turned), return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    against = as_it_is != as_it_is[first][patch]
    return np.where(against[:, None], faces[:, ::-1], faces), rank[patch]
