"""The ends of a character's limbs, found along the surface and not in space."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from solver.fields import bridge
from solver.kernels import prominences
from solver.mesh import SolverMesh

SOURCES = 24
"""Surface points, spread far apart, whose mean distance says how outlying a vertex is."""

LEAST_PROMINENCE = 0.1
"""A limb rises at least this far over where it branches off, as a share of the range of mean distances."""


def extremities(mesh: SolverMesh, most: int = 8) -> NDArray[np.int64]:
    """Find limb ends: prominent maxima of the mean distance to all of the surface.

    The mean geodesic distance is least in the trunk and rises along every limb. Small bumps, and the fingers of one
    hand, are maxima too but hardly rise over their surroundings, and are left out.

    Parameters
    ----------
    mesh : SolverMesh
    most : int
        No more tips than this.

    Returns
    -------
    (k,) int64
        Vertex indices, the most outlying first.
    """
    edges = np.concatenate([mesh.edges, bridge(mesh)])
    outlying = _mean_distance(mesh, edges)
    order = np.argsort(-outlying, kind="stable")
    a, b = edges.T
    n = len(mesh.vertices)
    links = csr_matrix(coo_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(n, n)))
    prominence = prominences(outlying, order, links.indptr, links.indices)
    tips = order[prominence[order] >= LEAST_PROMINENCE * np.ptp(outlying)]
    return tips[:most]


def _mean_distance(mesh: SolverMesh, edges: NDArray[np.int64]) -> NDArray[np.float64]:
    """Average each vertex's distance along edges to points that are spread as far apart as possible."""
    n = len(mesh.vertices)
    a, b = edges.T
    lengths = np.maximum(np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1), 1e-12 * mesh.diagonal)
    graph = csr_matrix(coo_matrix((lengths, (a, b)), shape=(n, n)))
    total = np.zeros(n)
    nearest = np.full(n, np.inf)
    source = int(np.argmax(np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0), axis=1)))
    for _ in range(SOURCES):
        distance = np.asarray(dijkstra(graph, directed=False, indices=np.array([source])))[0]
        total += distance
        nearest = np.minimum(nearest, distance)
        source = int(np.argmax(nearest))
    return total / SOURCES
