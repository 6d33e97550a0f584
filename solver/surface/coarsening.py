"""Coarse versions of large surfaces: a sample of their vertices, and linear interpolation from it.

The surface is divided into cells around vertices that are at least a given distance apart. Cells that meet form a
coarse triangulation, and every vertex is at a point of one of its triangles (R. Wiersma et al., *A Fast Geometric
Multigrid Method for Curved Surfaces*, SIGGRAPH 2023). The sample follows the edges of the mesh, so that surfaces that
are near each other in space only do not mix.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.surface.surface_tree import closest
from solver.surface.winding import distinct_rows, edges_of

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

SAMPLES_PER_SQUARE_RADIUS = 0.66
"""Number of samples per square of the sampling distance on a flat surface."""


@dataclass(frozen=True, eq=False)
class CoarseSurface:
    """A sample of a surface's vertices.

    Attributes
    ----------
    samples : (c,) int64
        Vertices of the surface, ascending.
    interpolation : (n, c) sparse float64
        Maps values at the samples to all vertices: up to three entries per row, each positive, with sum 1.
    """

    samples: NDArray[np.int64]
    interpolation: "csr_matrix"


def coarse_surface(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], L: "csr_matrix", area: float, count: int
) -> CoarseSurface:
    """Sample a surface evenly.

    Where the mesh itself is coarser than the sample, all of its vertices are samples. Parts that are in contact share
    cells, so that a part smaller than a cell follows the surface around it.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (t, 3) int64
    L : (n, n) sparse
        A matrix whose entries are at neighbours on the surface, and at contacts between parts that hold.
    area : float
        Area of the surface.
    count : int
        Number of samples, approximately, for a mesh without larger triangles.
    """
    radius = float(np.sqrt(SAMPLES_PER_SQUARE_RADIUS * area / count))
    samples, owner = _cells(L.indptr, L.indices, vertices, radius)
    elements = _elements(owner[faces])
    starts, of_sample = _incident(elements, len(samples))
    first, columns, values = _interpolate(vertices, samples, owner, elements, starts, of_sample)
    interpolation = scipy.sparse.csr_matrix((values, columns, first), shape=(len(vertices), len(samples)))
    return CoarseSurface(samples, interpolation)


@compiled
def _cells(starts, neighbours, points, radius):
    """Choose samples at least a radius apart, and assign each vertex to the nearest sample that it is connected to.

    Returns
    -------
    samples : (c,) int64
    owner : (n,) int32
        Index of the sample in whose cell each vertex is.
    """
    n = len(points)
    owner, square = np.full(n, -1, dtype=np.int32), np.full(n, np.float32(radius * radius), dtype=np.float32)
    samples, queue = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int32)
    count = 0
    for seed in range(n):
        if owner[seed] >= 0:
            continue
        samples[count], owner[seed], square[seed], queue[0] = seed, count, 0, seed
        top = 1
        while top:
            top -= 1
            v = queue[top]
            for entry in range(starts[v], starts[v + 1]):
                u = neighbours[entry]
                away = np.float32(0.0)
                for x in range(3):
                    away += np.float32(points[u, x] - points[seed, x]) ** 2
                if away < square[u]:
                    if top == len(queue):
                        queue = np.append(queue, np.empty_like(queue))
                    owner[u], square[u], queue[top] = count, away, u
                    top += 1
        count += 1
    return samples[:count].copy(), owner


def _elements(corners: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the coarse triangles (e, 3) of faces whose corners are in the given cells.

    Two cells that meet without a third one are an edge, as a triangle with two equal corners.
    """
    corners = np.sort(corners, axis=1).astype(np.int64)
    kind = np.count_nonzero(np.diff(corners, axis=1), axis=1)
    triangles, pairs = _distinct(corners[kind == 2]), _distinct(corners[kind == 1][:, [0, 2]])
    sides, _, _ = edges_of(triangles)
    both = np.concatenate([sides, pairs])
    first, _ = distinct_rows(both)
    alone = both[np.sort(first[first >= len(sides)])]
    return np.concatenate([triangles, alone[:, [0, 1, 1]]])


def _distinct(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the different rows in lexicographic order."""
    return rows[distinct_rows(rows)[0]]


def _incident(elements: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the elements at each sample, in compressed rows."""
    starts = np.append(0, np.cumsum(np.bincount(elements.ravel(), minlength=count)))
    return starts, np.argsort(elements.ravel(), kind="stable") // 3


@compiled
def _interpolate(vertices, samples, owner, elements, starts, of_sample):
    """Return the compressed rows of the matrix that interpolates in the element nearest to each vertex."""
    n = len(vertices)
    first = np.zeros(n + 1, dtype=np.int32)
    columns, values = np.empty(3 * n, dtype=np.int32), np.empty(3 * n)
    blend, best, corner = np.empty(3), np.empty(3), np.empty(3, dtype=np.int64)
    for v in range(n):
        sample = owner[v]
        least, corner[0], best[0], best[1], best[2] = np.inf, sample, 1.0, 0.0, 0.0
        for place in range(starts[sample], starts[sample + 1]):
            a, b, c = elements[of_sample[place]]
            square = closest(vertices[v], vertices[samples[a]], vertices[samples[b]], vertices[samples[c]], blend)
            if square < least:
                least = square
                corner[0], corner[1], corner[2] = a, b, c
                best[0], best[1], best[2] = blend[0], blend[1], blend[2]
        end = first[v]
        for k in range(3):
            if best[k] > 0:
                columns[end], values[end] = corner[k], best[k]
                end += 1
        first[v + 1] = end
    return first, columns[: first[n]].copy(), values[: first[n]].copy()
