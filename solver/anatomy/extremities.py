"""The ends of a character's limbs, found along the surface and not in space."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from puppetline.compiled import compiled
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh

SOURCES = 24
"""Surface points, spread far apart, whose mean distance says how outlying a vertex is."""

LEAST_PROMINENCE = 0.04
"""A limb rises at least this far over where it branches off, as a share of the range of mean distances."""

APART = 0.3
"""Two ends are at least this far apart along the surface, as a share of the same range: fingers are one hand."""

MOST = 24
"""No more ends than this."""


@dataclass(frozen=True)
class Extremities:
    """Ends of limbs, the most prominent first.

    Attributes
    ----------
    vertices : (k,) int64
    prominence : (k,) float64
        How far each rises over where its limb branches off, from 0 to 1: the share of the range of mean distances.
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
    """Return each vertex's distance (n,) to one of them along the edges of a `surface_graph`; infinite over a limit."""
    return np.asarray(dijkstra(graph, directed=False, indices=np.array([source]), limit=limit))[0]


def extremities(mesh: SolverMesh, graph: csr_matrix) -> Extremities:
    """Find limb ends: prominent maxima of the mean distance to all of the surface.

    The mean geodesic distance is least in the trunk and rises along every limb. Small bumps are maxima too but hardly
    rise over their surroundings, and are left out; of the fingers of one hand the most prominent is kept.

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
    maxima = order[prominence[order] >= LEAST_PROMINENCE * span]
    kept: list[int] = []
    covered = np.zeros(len(outlying), dtype=bool)
    for vertex in maxima[np.argsort(-prominence[maxima], kind="stable")]:
        if not covered[vertex] and len(kept) < MOST:
            kept.append(int(vertex))
            covered |= np.isfinite(distances(graph, int(vertex), APART * span))
    vertices = np.array(kept, dtype=np.int64)
    return Extremities(vertices, prominence[vertices] / span)


def _mean_distance(mesh: SolverMesh, graph: csr_matrix) -> NDArray[np.float64]:
    """Average each vertex's distance to points that are spread as far apart as possible."""
    total = np.zeros(len(mesh.vertices))
    nearest = np.full(len(mesh.vertices), np.inf)
    source = int(np.argmax(np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0), axis=1)))
    for _ in range(SOURCES):
        distance = distances(graph, source)
        total += distance
        nearest = np.minimum(nearest, distance)
        source = int(np.argmax(nearest))
    return total / SOURCES


@compiled
def _prominences(values, order, starts, neighbours):
    """Return how far each local maximum of a function on a graph rises over the pass to a higher one.

    Vertices are flooded from the top; where two basins meet, the lower summit's prominence is known.

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
        0 for what is no maximum; the highest summit's is the range of the values.
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
