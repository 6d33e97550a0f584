"""Where the separate parts of a character touch, and whether they stay together.

Eyes, clothes and armour are parts of their own in most files. What ties them is found here: a *contact* is a vertex
and the nearest surface point of another part.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import igl
import numpy as np
import scipy
from numpy.typing import NDArray

from solver.surface.mesh import SolverMesh
from solver.surface.surface_tree import SurfaceTree

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

TOUCHING = 0.005
"""Points of two parts no farther apart than this, as a fraction of the diagonal, touch: on a person of 1.8 m it is
about 1 cm, more than there is between clothes and skin, less than between two legs."""

FACING = -0.5
"""Cosine of two normals below which surfaces face each other."""

WIDE = 2.0
"""What floats free is tied wherever it is no farther than this many times its least distance: held at a single point it
could turn about it."""

GAP = 1e-4
"""Height over the other surface, as a fraction of the diagonal, from which there is a gap between two parts."""

DETOUR = 0.2
"""Surfaces that face each other across a gap are parts of two limbs where the way from one to the other over the rest
of the character is longer than this, as a fraction of the diagonal."""

LANDMARKS = 12
"""Vertices, spread far apart, by whose distances a detour is judged."""


@dataclass(frozen=True)
class Contacts:
    """Vertices and the surface points of other parts that they are tied to.

    Attributes
    ----------
    vertices : (k,) int64
    corners : (k, 3) int64
        The vertices of the triangle that holds the surface point.
    blend : (k, 3) float64
        Its barycentric coordinates.
    gap : (k,) float64
        0 where the two parts touch; elsewhere the distance that they keep; in the mesh's units.
    """

    vertices: NDArray[np.int64]
    corners: NDArray[np.int64]
    blend: NDArray[np.float64]
    gap: NDArray[np.float64]

    @cached_property
    def links(self) -> NDArray[np.int64]:
        """(k, 2) vertex pairs: each contact's vertex and the corner nearest to its surface point."""
        nearest = self.corners[np.arange(len(self.corners)), self.blend.argmax(axis=1)]
        return np.column_stack([self.vertices, nearest])

    def difference(self, count: int) -> "csr_matrix":
        """Return the (k, count) matrix that takes functions on the vertices to their jump over each contact."""
        k = len(self.vertices)
        rows = np.repeat(np.arange(k), 4)
        columns = np.column_stack([self.vertices, self.corners]).ravel()
        values = np.column_stack([np.ones(k), -self.blend]).ravel()
        return scipy.sparse.csr_matrix(scipy.sparse.coo_matrix((values, (rows, columns)), shape=(k, count)))


class PartSeparation:
    """Measures how far the parts of a character drift apart where they touch at rest, no farther than `TOUCHING`.

    What floats free or is stuck deep into another part is tied over a distance, which changes as the surface bends
    without anything coming apart that was together: it is not measured.

    Parameters
    ----------
    mesh : SolverMesh
    """

    worst: float
    """Largest distance over all frames between points that touch at rest, as a fraction of the diagonal; 0 where none
    do."""

    def __init__(self, mesh: SolverMesh) -> None:
        self.worst = 0.0
        ties = contacts(mesh)
        self._jump = only(ties, ties.gap == 0).difference(len(mesh.vertices))
        self._diagonal = mesh.diagonal

    def add(self, positions: NDArray[np.floating]) -> None:
        """Measure some frames: (n, 3, F) solver vertices, in the units of the mesh."""
        if self._jump.shape[0]:
            jump = (self._jump @ positions.reshape(len(positions), -1)).reshape(-1, *positions.shape[1:])
            apart = np.sqrt(np.einsum("kxf,kxf->kf", jump, jump).max(initial=0))
            self.worst = max(self.worst, float(apart) / self._diagonal)


def contacts(mesh: SolverMesh) -> Contacts:
    """Find what ties the parts of a character to each other, so that all of it hangs together; once for a mesh.

    1. A vertex is in contact with the nearest surface of another part where that is within `TOUCHING`, or where one of
       the vertex's edges goes through it; not where the two surfaces face each other across a gap, as those of a hand
       beside a hip do.
    2. What is still separate is joined where it comes nearest to the rest, again and again until all is one (Borůvka's
       algorithm).
    3. Surfaces that face each other across a gap are tied as well, where they are close along the surface too. Where it
       is a long way from one to the other they belong to two limbs, which will part.

    Returns
    -------
    Contacts
        Empty for a mesh of one part.
    """
    if mesh not in _found:
        _found[mesh] = _contacts(mesh)
    return _found[mesh]


_found: WeakKeyDictionary[SolverMesh, Contacts] = WeakKeyDictionary()


def _contacts(mesh: SolverMesh) -> Contacts:
    part = mesh.components
    if part.max() == 0:
        nothing = np.zeros((0, 3))
        return Contacts(np.zeros(0, dtype=np.int64), nothing.astype(np.int64), nothing, np.zeros(0))
    tree = SurfaceTree(mesh.vertices[mesh.faces])
    touching = TOUCHING * mesh.diagonal
    near = _nearest(mesh, tree, part, np.maximum(touching, _longest_edges(mesh)))
    height, cosine = _relief(mesh, near)
    through = _goes_through(mesh, near, height)
    close = near.distance <= touching
    facing = close & ~through & _by_majority(mesh, near, close, (height > GAP * mesh.diagonal) & (cosine < FACING))
    found = [near.contacts(mesh, (close & ~facing) | through)]
    while (group := _groups(mesh, found)).max() > 0:
        found.append(_join(mesh, tree, group))
    for some in found:
        facing[some.vertices] = False
    if facing.any():
        across = near.contacts(mesh, facing)
        found.append(only(across, _detour(mesh, found, across) <= DETOUR * mesh.diagonal))
    return _all(found)


@dataclass(frozen=True)
class _Near:
    """The nearest surface point of another part, or group of parts, for each of n vertices.

    Attributes
    ----------
    face : (n,) int64
        −1 where there is none within reach; the others then mean nothing, and the distance is infinite.
    blend : (n, 3) float64
    distance : (n,) float64
    """

    face: NDArray[np.int64]
    blend: NDArray[np.float64]
    distance: NDArray[np.float64]

    def contacts(self, mesh: SolverMesh, chosen: NDArray[np.bool_]) -> Contacts:
        """Tie the vertices that are chosen; only what is farther than `TOUCHING` keeps a distance."""
        distance = self.distance[chosen]
        gap = np.where(distance > TOUCHING * mesh.diagonal, distance, 0.0)
        return Contacts(np.flatnonzero(chosen), mesh.faces[self.face[chosen]], self.blend[chosen], gap)


def _nearest(
    mesh: SolverMesh, tree: SurfaceTree, label: NDArray[np.int32], within: NDArray[np.float64] | float
) -> _Near:
    return _Near(*tree.nearest(mesh.vertices, label, label[mesh.faces[:, 0]], np.broadcast_to(within, len(label))))


def _longest_edges(mesh: SolverMesh) -> NDArray[np.float64]:
    """Return the length of the longest edge at each vertex (n,)."""
    longest = np.zeros(len(mesh.vertices))
    lengths = np.linalg.norm(mesh.vertices[mesh.edges[:, 0]] - mesh.vertices[mesh.edges[:, 1]], axis=1)
    for end in mesh.edges.T:
        np.maximum.at(longest, end, lengths)
    return longest


def _relief(mesh: SolverMesh, near: _Near) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each vertex's height over the nearest surface, negative inside, and the cosine between the two normals.

    The surface's normal is that of its vertices, blended, so that it is one for both sides of an edge.
    """
    normals = igl.per_vertex_normals(mesh.vertices, mesh.faces)
    corners = mesh.faces[near.face]
    there = np.einsum("nc,ncx->nx", near.blend, normals[corners])
    there /= np.maximum(np.linalg.norm(there, axis=1, keepdims=True), 1e-12)
    away = mesh.vertices - np.einsum("nc,ncx->nx", near.blend, mesh.vertices[corners])
    return np.einsum("nx,nx->n", away, there), np.einsum("nx,nx->n", normals, there)


def _by_majority(mesh: SolverMesh, near: _Near, close: NDArray[np.bool_], said: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Let neighbours that are close to the same part agree on what most of them say: corners and rims err."""
    part = mesh.components[mesh.faces[near.face, 0]]
    a, b = mesh.edges[close[mesh.edges].all(axis=1) & (part[mesh.edges[:, 0]] == part[mesh.edges[:, 1]])].T
    n = len(mesh.vertices)
    patch = scipy.sparse.csgraph.connected_components(
        scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False
    )[1]
    return (np.bincount(patch, said) > 0.5 * np.bincount(patch))[patch]


def _goes_through(mesh: SolverMesh, near: _Near, height: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Say which vertices are the nearer ends of edges that go through the surface of another part.

    One end is outside, the other inside, and together they are no farther from the surface than the edge is long.
    """
    a, b = mesh.edges.T
    part = mesh.components[mesh.faces[near.face, 0]]
    length = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
    known = (near.face[a] >= 0) & (near.face[b] >= 0) & (part[a] == part[b])
    crossing = known & (height[a] * height[b] < 0) & (near.distance[a] + near.distance[b] <= length)
    through = np.zeros(len(mesh.vertices), dtype=bool)
    through[np.where(near.distance[a] <= near.distance[b], a, b)[crossing]] = True
    return through


def only(some: Contacts, chosen: NDArray[np.bool_]) -> Contacts:
    """Return the chosen (k,) contacts."""
    return Contacts(some.vertices[chosen], some.corners[chosen], some.blend[chosen], some.gap[chosen])


def _all(found: list[Contacts]) -> Contacts:
    return Contacts(
        np.concatenate([some.vertices for some in found]),
        np.concatenate([some.corners for some in found]),
        np.concatenate([some.blend for some in found]),
        np.concatenate([some.gap for some in found]),
    )


def _groups(mesh: SolverMesh, found: list[Contacts]) -> NDArray[np.int32]:
    """Return the (n,) number of the group of tied parts that each vertex belongs to."""
    part = mesh.components
    a, b = part[np.concatenate([some.links for some in found])].T
    count = int(part.max()) + 1
    return scipy.sparse.csgraph.connected_components(
        scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count)), directed=False
    )[1][part]


def _join(mesh: SolverMesh, tree: SurfaceTree, group: NDArray[np.int32]) -> Contacts:
    """Tie every group of parts to the one that it is nearest to."""
    near = _nearest(mesh, tree, group, np.inf)
    count = int(group.max()) + 1
    target = group[mesh.faces[near.face, 0]]
    pair = np.minimum(group, target).astype(np.int64) * count + np.maximum(group, target)
    pairs, of_vertex = np.unique(pair, return_inverse=True)
    gap = np.full(len(pairs), np.inf)
    np.minimum.at(gap, of_vertex, near.distance)
    least = np.full(count, np.inf)
    for one in np.divmod(pairs, count):
        np.minimum.at(least, one, gap)
    chosen = np.logical_or(*(gap == least[one] for one in np.divmod(pairs, count)))
    reach = WIDE * gap + TOUCHING * mesh.diagonal
    return near.contacts(mesh, chosen[of_vertex] & (near.distance <= reach[of_vertex]))


def _detour(mesh: SolverMesh, found: list[Contacts], across: Contacts) -> NDArray[np.float64]:
    """Return how long the way over the character from one side of each contact to the other is at least.

    Two points are no nearer to each other than their distances to any third one differ; landmarks at the ends of the
    limbs make that a good estimate at the cost of a few searches.
    """
    edges = np.concatenate([mesh.edges, *(some.links for some in found)])
    n = len(mesh.vertices)
    a, b = edges.T
    lengths = np.maximum(np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1), 1e-12 * mesh.diagonal)
    graph = scipy.sparse.csr_matrix(scipy.sparse.coo_matrix((lengths, (a, b)), shape=(n, n)))
    longest, nearest = np.zeros(len(across.vertices)), np.full(n, np.inf)
    landmark = int(across.vertices[0])
    for _ in range(LANDMARKS):
        distance = np.asarray(scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=np.array([landmark])))[0]
        nearest = np.minimum(nearest, distance)
        landmark = int(nearest.argmax())
        one, other = across.links.T
        longest = np.maximum(longest, np.abs(distance[one] - distance[other]))
    return longest
