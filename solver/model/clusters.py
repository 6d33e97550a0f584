"""Rotation clusters: which vertices turn together, and how the surface says by how much.

An isoline of a field runs over several limbs, and a rotation for each isoline averages limbs that turn differently.
Clusters of vertices that lie between the same isolines of *every* field do not (Jacobson et al., *Fast Automatic
Skinning Transformations*, 2012): such vertices blend nearly the same transforms, so that one rotation serves them all.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.energy_matrices import Products
from solver.model.fields import blends

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

CLUSTERS = 80
"""Number of rotation clusters: twice as many bring a limb no nearer to where it should be."""

FEWEST_VERTICES = 4
"""Mean number of vertices of a cluster, below which there are fewer clusters."""

EDGES = 1.0
"""γ, in units of trace(A) / trace(−2 WᵀLW)."""

ROUNDS = 10
"""Updates of the means: what the next ones change has no effect on a deformation."""


def rotation_clusters(
    ladder: NDArray[np.float64], weights: NDArray[np.float64], mass: NDArray[np.float64]
) -> NDArray[np.int32]:
    """Divide vertices into clusters by k-means on their ladder coordinates, each times its field's weight.

    The start is the vertex farthest from the mean, and then always the vertex farthest from those chosen, so that a
    mesh always gets the same clusters. Means are weighted by area, so that clusters do not depend on how densely a
    region is triangulated.

    Parameters
    ----------
    ladder : (n, n_e) float64
    weights : (n_e,) float64
        Of the fields.
    mass : (n,) float64
        Area of each vertex.

    Returns
    -------
    (n,) int32
        From 0, without a gap; `CLUSTERS` of them unless the mesh is tiny.
    """
    points = np.ascontiguousarray((ladder * weights).T, dtype=np.float32)
    means = _far_apart(points, points @ mass / mass.sum(), max(1, min(CLUSTERS, len(ladder) // FEWEST_VERTICES)))
    for _ in range(ROUNDS):
        nearest = _nearest_mean(points, means)
        area = np.bincount(nearest, mass, len(means))
        sums = [np.bincount(nearest, mass * row, len(means)) for row in points]
        means = (np.stack(sums, axis=1)[area > 0] / area[area > 0, None]).astype(np.float32)
    return np.unique(_nearest_mean(points, means), return_inverse=True)[1].astype(np.int32)


@compiled
def _far_apart(points, start, count):
    """Choose up to count of (d, n) points: the farthest from a start, then always the farthest from those chosen."""
    means = np.zeros((count, len(points)), dtype=np.float32)
    square, nearest = np.full(points.shape[1], np.inf, dtype=np.float32), np.zeros(points.shape[1], dtype=np.int32)
    _take_over(points, start.astype(np.float32), 0, square, nearest)
    for c in range(count):
        farthest = square.argmax()
        if c > 0 and square[farthest] == 0:  # every point is where a chosen one is
            return means[:c]
        if c == 0:
            square[:] = np.inf
        means[c] = points[:, farthest]
        _take_over(points, means[c], c, square, nearest)
    return means


@compiled
def _nearest_mean(points, means):
    """Return the number of the mean that each of (d, n) points is nearest to; of several the first."""
    square, nearest = np.full(points.shape[1], np.inf, dtype=np.float32), np.zeros(points.shape[1], dtype=np.int32)
    for c in range(len(means)):
        _take_over(points, means[c], c, square, nearest)
    return nearest


@compiled
def _take_over(points, mean, cluster, square, nearest):
    """Give a cluster the points that are nearer to its mean than to the one they have."""
    d, block = len(points), 1024
    now = np.empty(block, dtype=np.float32)
    for start in range(0, len(square), block):
        stop = min(start + block, len(square))
        now[:] = 0
        for k in range(d):
            row, at = points[k, start:stop], mean[k]
            for v in range(stop - start):
                now[v] += (row[v] - at) * (row[v] - at)
        for v in range(stop - start):
            nearer = now[v] < square[start + v]
            square[start + v] = now[v] if nearer else square[start + v]
            nearest[start + v] = cluster if nearer else nearest[start + v]


def energy(products: Products, covariance: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Add the energy of bent and stretched edges to the paper's.

    E = ‖M^(−1/2) (L X − δ Rot)‖² + γ Σ_i Σ_j cot_ij ‖(x'_i − x'_j) − (x_i − x_j) Rot_i‖², where Rot_i is the rotation
    of the cluster of i. Turning the clusters and solving for the surface in turn can only lower E; rotations that are
    read off the surface by another measure need not settle at all. The paper's energy alone hardly feels a slow twist
    along a limb and takes hundreds of iterations to settle; the second term, that of *as rigid as possible* (Sorkine
    and Alexa, 2007), feels it. Ties between parts count in the first term alone.

    Parameters
    ----------
    products : Products
    covariance : (3r, 4m) float64
        From `covariance_map`.

    Returns
    -------
    A : (4m, 4m) float64
    B : (4m, 3r) float64
        E = Rᵀ A R − 2 Rᵀ B Rot + a constant; Bᵀ R stacks the matrices whose polar decompositions are the rotations.
    """
    stretch = 2 * products.dirichlet  # each edge is counted from both its ends
    gamma = EDGES * np.trace(products.A) / np.trace(stretch)
    return products.A + gamma * stretch, products.B_clusters + gamma * covariance.T


def covariance_map(
    L: "csr_matrix",
    rest: NDArray[np.float64],
    ladder: NDArray[np.float64],
    weights: NDArray[np.float64],
    isolines: int,
    cluster: NDArray[np.int32],
) -> NDArray[np.float64]:
    """Build C: S = C R stacks, for each cluster, Σ cot_ij (x_i − x_j)ᵀ (x'_i − x'_j) over the edges of its vertices i.

    Parameters
    ----------
    L : (n, n) sparse float64
        Its entries beside the diagonal are the cotangent weights.
    rest : (n, 3) float64
        x.
    ladder : (n, n_e) float64
    weights : (n_e,) float64
        Of the fields.
    isolines : int
        n_iso; there are m = n_e · n_iso in all.
    cluster : (n,) int32

    Returns
    -------
    (3r, 4m) float64
    """
    below, upper = blends(ladder, isolines)
    order = np.argsort(cluster, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(cluster)))
    C = np.zeros((3 * (len(starts) - 1), 4 * len(weights) * isolines))
    _add_covariances(order, starts, L.indptr, L.indices, L.data, rest, below, upper, weights, isolines, C)
    return C


@compiled
def _add_covariances(order, starts, first, neighbours, cot, rest, below, upper, weights, isolines, C):
    """Collect the edge vectors that each vertex counts with in a cluster, and then multiply by its row of W once."""
    share, h = np.zeros((len(rest), 3)), np.ones(4)
    for c in range(len(starts) - 1):
        members = order[starts[c] : starts[c + 1]]
        rows = C[3 * c : 3 * c + 3]
        for v in members:
            for entry in range(first[v], first[v + 1]):
                u = neighbours[entry]
                for x in range(3):
                    edge = cot[entry] * (rest[v, x] - rest[u, x])
                    share[v, x] += edge
                    share[u, x] -= edge
        for v in members:
            for entry in range(first[v], first[v + 1]):
                u = neighbours[entry]
                h[:3] = rest[u]
                for i in range(len(weights)):
                    column = 4 * (i * isolines + below[u, i])
                    b = weights[i] * upper[u, i]
                    a = weights[i] - b
                    for x in range(3):
                        for k in range(4):
                            rows[x, column + k] += a * share[u, x] * h[k]
                            rows[x, column + 4 + k] += b * share[u, x] * h[k]
                share[u] = 0  # counted, if it comes again
