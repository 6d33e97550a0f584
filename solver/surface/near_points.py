"""Groups points that are nearly at the same position, and the connected components that this takes."""

import numpy as np
import scipy
from numpy.typing import NDArray

CELLS_PER_BLOCK_SIDE = 64
"""Number of cells, each one weld tolerance wide, along each side of a block."""


def connected_components(count: int, a: NDArray[np.integer], b: NDArray[np.integer]) -> NDArray[np.int32]:
    """Return the (count,) number of the connected component of each node of a graph with edges from a to b, (e,)."""
    graph = scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]


def group_near(points: NDArray[np.float64], tolerance: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Group points that are no farther apart than the tolerance, if all others are much farther apart.

    A grid of cells alone would separate neighbours in adjacent cells. A search for pairs alone would take too long in a
    file with thousands of vertices at one position. So the search for pairs takes one point per cell.

    Parameters
    ----------
    points : (n, 3) float64
    tolerance : float
        At least 2⁻²¹ of the extent of the points along each axis.

    Returns
    -------
    first : (p,) int64
        The first point of each group, ascending, so that neighbours in memory stay neighbours.
    place_of : (n,) int64
        The group of each point.
    """
    cells = np.round((points - points.min(axis=0)) / tolerance).astype(np.int64)
    _, first, cell_of = np.unique(_codes(cells), return_index=True, return_inverse=True)
    near = np.flatnonzero(_may_have_neighbours(cells[first]))
    a, b = near[scipy.spatial.cKDTree(points[first[near]]).query_pairs(tolerance, output_type="ndarray")].T
    label = connected_components(len(first), a, b)
    _, first, place_of = np.unique(label[cell_of], return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[place_of]


def _codes(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Combine the three coordinates of each cell, less than 2²¹, into one integer."""
    return (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]


def _may_have_neighbours(cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which cells are at the boundary of their block of cells, or not the only one in it."""
    block, inside = np.divmod(cells, CELLS_PER_BLOCK_SIDE)
    at_wall = ((inside == 0) | (inside == CELLS_PER_BLOCK_SIDE - 1)).any(axis=1)
    _, block_of, cells_in = np.unique(_codes(block), return_inverse=True, return_counts=True)
    return at_wall | (cells_in[block_of] > 1)
