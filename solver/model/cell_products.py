"""Products of the tall matrices of a large mesh over *cells*: sets of vertices between the same isolines of all fields.

If a vertex and its neighbours are in one cell, its rows of W and K W are combinations of (1, t_1 … t_n) ⊗ (x, y, z, 1),
where t_i is the fraction between the two isolines of field i. With 8 fields these are 36 columns instead of 64 or more,
and the matrix that combines them is the same for all cells.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MAX_CHUNK_ROWS = 1024
"""Largest number of rows that are multiplied at once."""


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


@compiled
def inside_cells(starts, neighbours, below):
    """Return which vertices (n,) have all their neighbours between the same isolines (n, n_e) as themselves."""
    inside = np.ones(len(below), dtype=np.bool_)
    for v in range(len(below)):
        for entry in range(starts[v], starts[v + 1]):
            for i in range(below.shape[1]):
                inside[v] &= below[neighbours[entry], i] == below[v, i]
    return inside


def add_cells(
    sums: Products,
    order: NDArray[np.int64],
    L: "csr_matrix",
    surface: "csr_matrix",
    mass: NDArray[np.float64],
    rest: NDArray[np.float64],
    below: NDArray[np.int64],
    upper: NDArray[np.float64],
    weights: NDArray[np.float64],
    isolines: int,
    cluster: NDArray[np.int32],
) -> None:
    """Add the products of some vertices, all of them `inside_cells`, to sums of products.

    Parameters
    ----------
    sums : Products
        Added to.
    order : (k,) int64
        The vertices, in an order in which those of each cluster and cell are adjacent.
    L, surface, mass, rest, weights, isolines, cluster
        As for `energy_matrices.products`.
    below, upper : (n, n_e)
        From `fields.blends`.
    """
    count = len(weights)
    combine = np.zeros((2 * count, 1 + count))
    for i, weight in enumerate(weights):
        combine[2 * i, [0, 1 + i]] = weight, -weight
        combine[2 * i + 1, 1 + i] = weight
    by_four, by_three = np.kron(combine, np.eye(4)), np.kron(combine, np.eye(3))
    for members in _cells(order, below, cluster):
        gram, A, B, dirichlet, B_cluster = _sums_of_cell(members, L, surface, mass, rest, upper)
        v = members[0]
        low = np.arange(count) * isolines + below[v]
        columns = np.column_stack([low, low + 1]).ravel()
        four, three = ((each * columns[:, None] + np.arange(each)).ravel() for each in (4, 3))
        square = np.ix_(four, four)
        sums.gram[square] += by_four @ gram @ by_four.T
        sums.A[square] += by_four @ A @ by_four.T
        sums.dirichlet[square] += by_four @ dirichlet @ by_four.T
        sums.B[np.ix_(four, three)] += by_four @ B @ by_three.T
        sums.B_clusters[four, 3 * cluster[v] : 3 * cluster[v] + 3] += by_four @ B_cluster


def _cells(
    order: NDArray[np.int64], below: NDArray[np.int64], cluster: NDArray[np.int32]
) -> Iterator[NDArray[np.int64]]:
    """Split vertices in order into those of one cluster and cell."""
    another = np.diff(cluster[order]) != 0
    for column in below.T:
        another |= np.diff(column[order]) != 0
    return (members for members in np.split(order, np.flatnonzero(another) + 1) if len(members))


def _sums_of_cell(
    members: NDArray[np.int64],
    L: "csr_matrix",
    surface: "csr_matrix",
    mass: NDArray[np.float64],
    rest: NDArray[np.float64],
    upper: NDArray[np.float64],
) -> list[NDArray[np.float64]]:
    """Return PᵀP, QᵀQ, Qᵀ P_δ, −Pᵀ M^(1/2) Q of the surface, and Qᵀ δ; P, Q and P_δ combine to W, K W and W_δ."""
    sums: list[NDArray[np.float64]] = []
    for rows in np.array_split(members, -(-len(members) // MAX_CHUNK_ROWS)):
        P, Q, P_delta, delta = _rows(rows, L.indptr, L.indices, L.data, mass, rest, upper)
        untied = Q
        if surface is not L:
            untied = _rows(rows, surface.indptr, surface.indices, surface.data, mass, rest, upper)[1]
        part = [P.T @ P, Q.T @ Q, Q.T @ P_delta, -(P.T @ (np.sqrt(mass[rows])[:, None] * untied)), Q.T @ delta]
        sums = [a + b for a, b in zip(sums, part, strict=True)] if sums else part
    return sums


@compiled
def _rows(rows, starts, neighbours, entries, mass, rest, upper):
    """Return rows of (1, t) ⊗ (x, 1), of M^(−1/2) L times that, of (1, t) ⊗ M^(−1/2) δ, and of M^(−1/2) δ."""
    count = upper.shape[1]
    P, Q = np.empty((len(rows), 4 * (1 + count))), np.zeros((len(rows), 4 * (1 + count)))
    P_delta, deltas, h = np.empty((len(rows), 3 * (1 + count))), np.zeros((len(rows), 3)), np.ones(4)
    for r in range(len(rows)):
        v = rows[r]
        per_area, delta, q = 1 / np.sqrt(mass[v]), deltas[r], Q[r]
        for entry in range(starts[v], starts[v + 1]):
            u, factor = neighbours[entry], entries[entry] * per_area
            for c in range(3):
                h[c] = factor * rest[u, c]
                delta[c] += h[c]
            h[3] = factor
            for c in range(4):
                q[c] += h[c]
            for i in range(count):
                t, here = upper[u, i], 4 * (1 + i)
                for c in range(4):
                    q[here + c] += t * h[c]
        h[:3], h[3] = rest[v], 1
        for i in range(1 + count):
            t = upper[v, i - 1] if i > 0 else 1.0
            for c in range(4):
                P[r, 4 * i + c] = t * h[c]
            for c in range(3):
                P_delta[r, 3 * i + c] = t * delta[c]
    return P, Q, P_delta, deltas
