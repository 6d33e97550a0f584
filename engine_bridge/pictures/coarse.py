"""Fewer triangles for the same surface, for shadows, whose edges are soft."""

import numpy as np
from numpy.typing import NDArray


def coarse_triangles(vertices: NDArray[np.float64], triangles: NDArray[np.int64], cell: float) -> NDArray[np.int64]:
    """Return triangles between some of the vertices, one in each cell of a grid (Rossignac and Borrel 1993).

    Parameters
    ----------
    vertices : (n, 3) float64
    triangles : (t, 3) int64
    cell : float
        Width of a cell, in units of the vertices. Details that are smaller may go.

    Returns
    -------
    (u, 3) int64
        u ≤ t; those with three different vertices, each once.
    """
    used, corners = np.unique(triangles, return_inverse=True)
    cells = np.floor((vertices[used] - vertices[used].min(axis=0, initial=np.inf)) / cell).astype(np.int64)
    _, first, of_cell = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    chosen = used[first][of_cell.reshape(-1)][corners].reshape(-1, 3)
    a, b, c = np.sort(chosen, axis=1).T
    _, once = np.unique(np.stack([a, b, c], axis=1), axis=0, return_index=True)
    once = np.sort(once)
    return chosen[once[(a[once] < b[once]) & (b[once] < c[once])]]
