"""The ends of a character's limbs, found by distances along the surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from puppetline.compiled import compiled
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh

SOURCE_COUNT = 24
"""Number of surface points, far apart, to which the mean distance of each vertex is measured."""

MIN_PROMINENCE = 0.04
"""Minimum rise of a limb's mean distance above that where it branches off, as a share of the range of mean
distances."""

MIN_SEPARATION = 0.3
"""Minimum distance of two ends along the surface, as a share of the same range; fingers are closer and count once."""

MAX_END_COUNT = 24
"""Maximum number of ends."""


@dataclass(frozen=True)
class Extremities:
    """Ends of limbs, the most prominent first.

    Attributes
    ----------
    vertices : (k,) int64
    prominence : (k,) float64
        Rise of the mean distance from where the limb branches off to its end, as a share of the range, 0 to 1.
    """

    vertices: NDArray[np.int64]
    prominence: NDArray[np.float64]


def surface_graph(mesh: SolverMesh) -> csr_matrix:
    """Return the (n, n) lengths of a character's edges, and of the ties between its parts, each once."""
    n = len(mesh.vertices)
    a, b = np.concatenate([mesh.edges, contacts(mesh).links]).T
    lengths = np.maximum(np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1), 1e-12 * mesh.diagonal)
    return csr_matrix(coo_matrix((lengths, (a, b)), shape=(n, n)))


def distances(graph: csr_matrix, source: int, limit: float = np.inf) -> NDArray[np.float64]:
    """Return the distance (n,) of each vertex to a source along a `surface_graph`; infinite beyond a limit."""
    return np.asarray(dijkstra(graph, directed=False, indices=np.array([source]), limit=limit))[0]


def extremities(mesh: SolverMesh, graph: csr_matrix) -> Extremities:
    """Find limb ends: prominent maxima of the mean distance to the whole surface.

    The mean geodesic distance is lowest in the trunk and rises along every limb. Small bumps are maxima too, but they
    hardly rise above their surroundings and are skipped. Of the fingers of one hand, the most prominent is kept.

    Parameters
    ----------
    mesh : SolverMesh
    graph : (n, n) sparse
        Its `surface_graph`.
    """
    outlying = _mean_distance(mesh, graph)
    order = np.argsort(-outlying, kind="stable")
    links = csr_matrix(graph + graph.T)
    prominence = _prominences(outlying, order, links.indptr, links.indices)
    span = float(np.ptp(outlying))
    maxima = order[prominence[order] >= MIN_PROMINENCE * span]
    kept: list[int] = []
    covered = np.zeros(len(outlying), dtype=bool)
    for vertex in maxima[np.argsort(-prominence[maxima], kind="stable")]:
        if not covered[vertex] and len(kept) < MAX_END_COUNT:
            kept.append(int(vertex))
            covered |= np.isfinite(distances(graph, int(vertex), MIN_SEPARATION * span))
    vertices = np.array(kept, dtype=np.int64)
    return Extremities(vertices, prominence[vertices] / span)


def _mean_distance(mesh: SolverMesh, graph: csr_matrix) -> NDArray[np.float64]:
    """Average each vertex's distance to points that are spread as far apart as possible."""
    total = np.zeros(len(mesh.vertices))
    nearest = np.full(len(mesh.vertices), np.inf)
    source = int(np.argmax(np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0), axis=1)))
    for _ in range(SOURCE_COUNT):
        distance = distances(graph, source)
        total += distance
        nearest = np.minimum(nearest, distance)
        source = int(np.argmax(nearest))
    return total / SOURCE_COUNT


@compiled
def _prominences(values, order, starts, neighbours):
    """Return how far each local maximum of a function on a graph rises above the pass to a higher one.

    Vertices are added in descending order. Where two regions meet, the lower maximum gets its prominence.

    Parameters
    ----------
    values : (n,) float64
    order : (n,) int64
        Vertices by descending value.
    starts : (n + 1,) int
    neighbours : (2e,) int
        Adjacency in compressed rows.

    Returns
    -------
    (n,) float64
        0 for vertices that are not maxima; the range of the values for the highest one.
    """
    n = len(values)
    basin = np.full(n, -1)
    result = np.zeros(n)
    for v in order:
        best = -1
        for j in range(starts[v], starts[v + 1]):
            root = neighbours[j]
            if basin[root] < 0:
                continue
            while basin[root] != root:
                basin[root] = basin[basin[root]]
                root = basin[root]
            if best < 0:
                best = root
            elif root != best:
                low, high = (root, best) if values[root] < values[best] else (best, root)
                result[low] = values[low] - values[v]
                basin[low] = high
                best = high
        basin[v] = v if best < 0 else best
    summit = order[0]
    result[summit] = values[summit] - values[order[n - 1]]
    return result
