"""Rotation clusters: sets of vertices that share a rotation, and the energy from which it is computed.

An isoline of a field crosses several limbs, and its rotation averages limbs that turn differently. A cluster contains
vertices that lie between the same isolines of *every* field (Jacobson et al., *Fast Automatic Skinning
Transformations*, 2012). They blend nearly the same transforms, so one rotation fits them all.
"""

from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.energy_matrices import Products
from solver.model.fields import blends

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

CLUSTER_COUNT = 80
"""Number of rotation clusters; twice as many do not improve the pose of a limb."""

MIN_VERTICES_PER_CLUSTER = 4
"""Smallest mean number of vertices per cluster; a smaller mesh has fewer clusters."""

EDGE_WEIGHT = 1.0
"""Weight γ of the edge term, in units of trace(A) / trace(−2 WᵀLW)."""

MEAN_UPDATES = 10
"""Number of k-means updates; more have no effect on a deformation."""


def rotation_clusters(
    isoline_coordinates: NDArray[np.float64],
    weights: NDArray[np.float64],
    mass: NDArray[np.float64],
    samples: NDArray[np.int64] | slice = slice(None),
) -> NDArray[np.int32]:
    """Cluster vertices by k-means on their isoline coordinates, each times its field's weight.

    The initial means are a farthest-point sample that starts at the vertex farthest from the mean, so that a mesh
    always has the same clusters. Means are weighted by area, so that clusters do not depend on the density of the mesh.

    Parameters
    ----------
    isoline_coordinates : (n, n_e) float64
    weights : (n_e,) float64
        Field weights.
    mass : (c,) float64
        Area of each sample.
    samples : (c,) int64, optional
        Vertices from which the means are computed; by default all of them.

    Returns
    -------
    (n,) int32
        Cluster of each vertex, numbered from 0; `CLUSTER_COUNT` clusters unless the mesh is tiny.
    """
    every = (isoline_coordinates * weights).astype(np.float32)
    points = every[samples]
    count = max(1, min(CLUSTER_COUNT, len(isoline_coordinates) // MIN_VERTICES_PER_CLUSTER))
    means = _farthest_points(points, mass @ points / mass.sum(), count)
    for _ in range(MEAN_UPDATES):
        nearest, _ = scipy.cluster.vq.vq(points, means)
        area = np.bincount(nearest, mass, len(means))
        sums = np.column_stack([np.bincount(nearest, mass * column, len(means)) for column in points.T])
        means = (sums[area > 0] / area[area > 0, None]).astype(np.float32)
    nearest, _ = scipy.cluster.vq.vq(every, means)
    used = np.bincount(nearest, minlength=len(means)) > 0
    return (np.cumsum(used) - 1)[nearest].astype(np.int32)


def _farthest_points(points: NDArray[np.float32], start: NDArray[np.float64], count: int) -> NDArray[np.float32]:
    """Choose up to count of (n, d) points: the farthest from a start, then the farthest from those already chosen."""
    square = np.square(points - start.astype(np.float32)).sum(axis=1)
    chosen: list[NDArray[np.float32]] = []
    while len(chosen) < count and (not chosen or square.max() > 0):  # else every point coincides with a chosen one
        chosen.append(points[square.argmax()])
        own = np.square(points - chosen[-1]).sum(axis=1)
        square = own if len(chosen) == 1 else np.minimum(square, own)
    return np.array(chosen)


def energy(products: Products, covariance: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Add an energy of edges to that of the paper.

    E = ‖M^(−1/2) (L X − δ Rot)‖² + γ Σ_i Σ_j cot_ij ‖(x'_i − x'_j) − (x_i − x_j) Rot_i‖², where Rot_i is the rotation
    of the cluster of i. Both steps, rotating the clusters and solving for the surface, lower E; with rotations from
    another measure the iteration need not converge. The paper's energy alone hardly resists a slow twist along a limb
    and needs hundreds of iterations. The second term, that of *as rigid as possible* (Sorkine and Alexa, 2007), resists
    it. Contacts between parts count in the first term only.

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
    gamma = EDGE_WEIGHT * np.trace(products.A) / np.trace(stretch)
    return products.A + gamma * stretch, products.B_clusters + gamma * covariance.T


def covariance_map(
    L: "csr_matrix",
    rest: NDArray[np.float64],
    isoline_coordinates: NDArray[np.float64],
    weights: NDArray[np.float64],
    isolines: int,
    cluster: NDArray[np.int32],
) -> NDArray[np.float64]:
    """Build C: S = C R stacks, for each cluster, Σ cot_ij (x_i − x_j)ᵀ (x'_i − x'_j) over the edges of its vertices i.

    Parameters
    ----------
    L : (n, n) sparse float64
        Its off-diagonal entries are the cotangent weights.
    rest, isoline_coordinates, weights, isolines, cluster
        As for `energy_matrices.products`.

    Returns
    -------
    (3r, 4m) float64
    """
    below, upper = blends(isoline_coordinates, isolines)
    order = np.argsort(cluster, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(cluster)))
    C = np.zeros((3 * (len(starts) - 1), 4 * len(weights) * isolines))
    _add_covariances(order, starts, L.indptr, L.indices, L.data, rest, below, upper, weights, isolines, C)
    return C


@compiled
def _add_covariances(order, starts, first, neighbours, cot, rest, below, upper, weights, isolines, C):
    """Add up the edge vectors of each vertex in a cluster, and then multiply by its row of W once."""
    share = np.zeros((len(rest), 3))
    for c in range(len(starts) - 1):
        members = order[starts[c] : starts[c + 1]]
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
                if share[u, 0] != 0 or share[u, 1] != 0 or share[u, 2] != 0:
                    _add_products(share[u], rest[u], below[u], upper[u], weights, isolines, C[3 * c : 3 * c + 3])
                    share[u, 0] = share[u, 1] = share[u, 2] = 0.0  # already counted if it occurs again


@compiled(inner=True)
def _add_products(share, rest, below, upper, weights, isolines, rows):
    """Add the products of a vector and a vertex's row of W."""
    for i in range(len(weights)):
        column = 4 * (i * isolines + below[i])
        b = weights[i] * upper[i]
        a = weights[i] - b
        for x in range(3):
            for k in range(4):
                h = rest[k] if k < 3 else 1.0
                rows[x, column + k] += a * share[x] * h
                rows[x, column + 4 + k] += b * share[x] * h
