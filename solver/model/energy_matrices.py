"""Products of the tall sparse matrices of a reduced model, a chunk of rows at a time.

Rows are grouped by cluster, whose vertices lie between the same isolines, so that a chunk has few columns that are not
zero. These are multiplied as dense matrices by BLAS, in memory that does not grow with the mesh.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.fields import blends

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MAX_CHUNK_ROWS = 384
"""Largest number of rows in a chunk. Larger chunks have more columns that are not zero; smaller ones more overhead."""


class Products(NamedTuple):
    """Products of the tall matrices.

    Attributes
    ----------
    A : (4m, 4m) float64
        (KW)ᵀ(KW).
    B : (4m, 3m) float64
        (KW)ᵀ M^(−1/2) W_δ.
    gram : (4m, 4m) float64
        The Gram matrix WᵀW.
    dirichlet : (4m, 4m) float64
        −WᵀLW of the surface, without contacts.
    B_clusters : (4m, 3r) float64
        (KW)ᵀ M^(−1/2) δ over the vertices of each cluster.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    gram: NDArray[np.float64]
    dirichlet: NDArray[np.float64]
    B_clusters: NDArray[np.float64]


def products(
    L: "csr_matrix",
    surface: "csr_matrix",
    mass: NDArray[np.float64],
    rest: NDArray[np.float64],
    isoline_coordinates: NDArray[np.float64],
    weights: NDArray[np.float64],
    isolines: int,
    cluster: NDArray[np.int32],
) -> Products:
    """Multiply W, K W, M^(−1/2) W_δ and M^(−1/2) δ, with K = M^(−1/2) L, δ = L rest and W_δ = w_i φ_ik(v) δ(v).

    Parameters
    ----------
    L : (n, n) sparse float64
        Operator of the energy, with contacts between parts.
    surface : (n, n) sparse float64
        Operator without contacts; the same object as L for a mesh of one part.
    mass : (n,) float64
        Diagonal of M.
    rest : (n, 3) float64
        Rest positions x.
    isoline_coordinates : (n, n_e) float64
    weights : (n_e,) float64
        Field weights.
    isolines : int
        n_iso; the model has m = n_e · n_iso isolines.
    cluster : (n,) int32
        Rotation cluster of each vertex, from 0 to r − 1.
    """
    m = len(weights) * isolines
    r = int(cluster.max()) + 1
    sums = Products(*(np.zeros((4 * m, columns)) for columns in (4 * m, 3 * m, 4 * m, 4 * m, 3 * r)))
    below, upper = blends(isoline_coordinates, isolines)
    levels = np.arange(isolines)
    order = np.lexsort((*below.T[::-1], cluster))
    for rows in _chunks(order, cluster):
        lowest, highest = _span(rows, L.indptr, L.indices, below)
        others = (mass, rest, below, upper, weights, lowest, highest)
        W, KW, W_delta, delta = _rows(rows, L, *others)
        untied = KW if surface is L else _rows(rows, surface, *others)[1]
        there = np.flatnonzero((lowest[:, None] <= levels) & (levels <= highest[:, None]))
        four, three = _columns(there, 4), _columns(there, 3)
        sums.gram[np.ix_(four, four)] += W.T @ W
        sums.A[np.ix_(four, four)] += KW.T @ KW
        sums.B[np.ix_(four, three)] += KW.T @ W_delta
        sums.dirichlet[np.ix_(four, four)] -= W.T @ (np.sqrt(mass[rows])[:, None] * untied)
        sums.B_clusters[np.ix_(four, _columns(cluster[rows[:1]], 3))] += KW.T @ delta
    return sums._replace(dirichlet=(sums.dirichlet + sums.dirichlet.T) / 2)


def _chunks(order: NDArray[np.int64], cluster: NDArray[np.int32]) -> Iterator[NDArray[np.int64]]:
    """Split vertices in order into chunks of at most `MAX_CHUNK_ROWS` of one cluster."""
    for members in np.split(order, np.flatnonzero(np.diff(cluster[order])) + 1):
        if len(members):
            yield from np.array_split(members, -(-len(members) // MAX_CHUNK_ROWS))


def _columns(isolines: NDArray[np.integer], each: int) -> NDArray[np.int64]:
    return (each * isolines[:, None] + np.arange(each)).ravel()


@compiled
def _span(rows, starts, neighbours, below):
    """Return the lowest and highest isoline of each field next to a vertex of some rows of L."""
    count = below.shape[1]
    lowest, highest = below[rows[0]].copy(), below[rows[0]].copy()
    for v in rows:
        for entry in range(starts[v], starts[v + 1]):
            for i in range(count):
                level = below[neighbours[entry], i]
                lowest[i] = min(lowest[i], level)
                highest[i] = max(highest[i], level)
    for i in range(count):
        highest[i] += 1
    return lowest, highest


def _rows(
    rows: NDArray[np.int64],
    L: "csr_matrix",
    mass: NDArray[np.float64],
    rest: NDArray[np.float64],
    below: NDArray[np.int64],
    upper: NDArray[np.float64],
    weights: NDArray[np.float64],
    lowest: NDArray[np.int64],
    highest: NDArray[np.int64],
) -> tuple[NDArray[np.float64], ...]:
    """Return some rows of W, K W, M^(−1/2) W_δ and M^(−1/2) δ, with the columns of isolines in each field's span."""
    width = highest - lowest + 1
    out = tuple(np.zeros((len(rows), columns)) for columns in np.array([4, 4, 3, 0]) * width.sum() + [0, 0, 0, 3])
    first = np.cumsum(width) - width - lowest
    _fill_rows(rows, L.indptr, L.indices, L.data, mass, rest, below, upper, weights, first, *out)
    return out


@compiled
def _fill_rows(rows, starts, neighbours, entries, mass, rest, below, upper, weights, first, W, KW, W_delta, deltas):
    """Add to the rows of W, K W, M^(−1/2) W_δ and M^(−1/2) δ."""
    count = len(weights)
    h = np.ones(4)
    for r in range(len(rows)):
        v = rows[r]
        per_area, delta = 1 / np.sqrt(mass[v]), deltas[r]
        for entry in range(starts[v], starts[v + 1]):
            u, factor = neighbours[entry], entries[entry] * per_area
            for c in range(3):
                h[c] = factor * rest[u, c]
                delta[c] += h[c]
            h[3] = factor
            for i in range(count):
                here = 4 * (first[i] + below[u, i])
                b = weights[i] * upper[u, i]
                a = weights[i] - b
                for c in range(4):
                    KW[r, here + c] += a * h[c]
                    KW[r, here + 4 + c] += b * h[c]
        h[0], h[1], h[2], h[3] = rest[v, 0], rest[v, 1], rest[v, 2], 1.0
        for i in range(count):
            here = first[i] + below[v, i]
            b = weights[i] * upper[v, i]
            a = weights[i] - b
            for c in range(4):
                W[r, 4 * here + c] = a * h[c]
                W[r, 4 * here + 4 + c] = b * h[c]
            for c in range(3):
                W_delta[r, 3 * here + c] = a * delta[c]
                W_delta[r, 3 * here + 3 + c] = b * delta[c]
