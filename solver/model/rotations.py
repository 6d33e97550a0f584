"""One rotation per isoline from the deformed surface: from the covariance of its edges.

It uses *strips*, the triangles that an isoline crosses, and begins with a linear map of the control variables R, so
that the iteration does not compute vertices. Rotations are for row vectors: x' = x · Rot.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.fields import blends
from solver.surface.mesh import SolverMesh

RotationMode = Literal["clusters", "covariance"]

NEAREST_TRIANGLES = 10
"""Number of triangles of an isoline that crosses none."""


def crossed_triangles(
    isoline_coordinates: NDArray[np.float64], faces: NDArray[np.int64], isolines: int
) -> list[NDArray[np.int64]]:
    """List the triangles that each isoline crosses.

    An isoline in the gap between two separate parts crosses none and has the nearest triangles instead.

    Parameters
    ----------
    isoline_coordinates : (n, n_e) float64
    faces : (t, 3) int64
    isolines : int

    Returns
    -------
    list of n_e · n_iso int64 arrays
        Indices of faces, ascending.
    """
    crossed = []
    for coordinates in isoline_coordinates.T:
        corners = coordinates[faces]
        low, high = corners.min(axis=1), corners.max(axis=1)
        first = np.ceil(low).astype(np.int64)
        count = np.where(low < high, np.floor(high).astype(np.int64) + 1 - first, 0)
        face = np.repeat(np.arange(len(faces)), count)
        level = np.arange(len(face)) - np.repeat(np.cumsum(count) - count - first, count)
        order = np.argsort(level, kind="stable")
        strips = np.split(face[order], np.searchsorted(level[order], np.arange(1, isolines)))
        for isoline, strip in enumerate(strips):
            if not len(strip):
                away = np.abs(corners.mean(axis=1) - isoline)
                strips[isoline] = np.sort(np.argsort(away, kind="stable")[:NEAREST_TRIANGLES])
        crossed += strips
    return crossed


def covariance_map(
    mesh: SolverMesh,
    strips: list[NDArray[np.int64]],
    isoline_coordinates: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Build Q: S = Q R stacks, for each isoline, Σ area · e_restᵀ e_def over the edges of its whole strip.

    Parameters
    ----------
    mesh : SolverMesh
        In the units of the model.
    strips : list of n_e · n_iso int64 arrays
        From `crossed_triangles`.
    isoline_coordinates : (n, n_e) float64
    weights : (n_e,) float64

    Returns
    -------
    (3 · isolines, 4 · isolines) float64
    """
    below, upper = blends(isoline_coordinates, len(strips) // len(weights))
    Q = np.zeros((3 * len(strips), 4 * len(strips)))
    for isoline, strip in enumerate(strips):
        _add_covariance(mesh.vertices, mesh.faces[strip], below, upper, weights, Q[3 * isoline : 3 * isoline + 3])
    return Q


@compiled
def _add_covariance(rest, faces, below, upper, weights, rows):
    """Add the covariances of faces: each corner is in two edges."""
    isolines = rows.shape[1] // (4 * len(weights))
    edge, h = np.empty(3), np.ones(4)
    for f in range(len(faces)):
        a, b, c = rest[faces[f, 0]], rest[faces[f, 1]], rest[faces[f, 2]]
        area = 0.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            area += ((b[y] - a[y]) * (c[z] - a[z]) - (b[z] - a[z]) * (c[y] - a[y])) ** 2
        area = 0.5 * np.sqrt(area)
        for v in faces[f]:
            for x in range(3):
                h[x] = rest[v, x]
                edge[x] = area * ((h[x] - a[x]) + (h[x] - b[x]) + (h[x] - c[x]))
            for i in range(len(weights)):
                column = 4 * (i * isolines + below[v, i])
                highest = weights[i] * upper[v, i]
                lowest = weights[i] - highest
                for x in range(3):
                    for k in range(4):
                        rows[x, column + k] += lowest * edge[x] * h[k]
                        rows[x, column + 4 + k] += highest * edge[x] * h[k]
