"""Contacts between the separate parts of a character, and how far these parts drift apart.

In most files, eyes, clothes and armour are separate parts. A *contact* ties a vertex to the nearest surface point of
another part.
"""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import igl
import numpy as np
import scipy
from numpy.typing import NDArray

from solver.surface.mesh import SolverMesh
from solver.surface.near_points import connected_components
from solver.surface.surface_tree import SurfaceTree

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

TOUCH_DIAGONALS = 0.005
"""Largest distance between two parts that touch, as a fraction of the diagonal: about 1 cm on a person of 1.8 m. The
distance between clothes and skin is smaller, the distance between two legs is larger."""

MAX_FACING_COSINE = -0.5
"""Cosine of the angle between two normals below which their surfaces face each other."""

MAX_JOIN_DISTANCE_RATIO = 2.0
"""A part that touches nothing is tied wherever it is no farther than this many times its smallest distance. Held at a
single point, it could turn about that point."""

MIN_GAP_DIAGONALS = 1e-4
"""Smallest height over another surface, as a fraction of the diagonal, that counts as a gap between two parts."""

MAX_DETOUR_DIAGONALS = 0.2
"""Longest way over the rest of the character, as a fraction of the diagonal, between surfaces that are tied across a
gap. If the way is longer, the surfaces belong to two limbs."""

LANDMARK_COUNT = 12
"""Number of vertices, spread far apart, from whose distances a detour is estimated."""


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
        """(k, 2) int64: each contact's vertex, and the corner nearest to its surface point."""
        nearest = self.corners[np.arange(len(self.corners)), self.blend.argmax(axis=1)]
        return np.column_stack([self.vertices, nearest])

    def only(self, chosen: NDArray[np.bool_]) -> "Contacts":
        """Return the chosen (k,) contacts."""
        return Contacts(self.vertices[chosen], self.corners[chosen], self.blend[chosen], self.gap[chosen])

    def difference(self, count: int) -> "csr_matrix":
        """Return the (k, count) matrix that maps functions on the vertices to their jump over each contact."""
        k = len(self.vertices)
        rows = np.repeat(np.arange(k), 4)
        columns = np.column_stack([self.vertices, self.corners]).ravel()
        values = np.column_stack([np.ones(k), -self.blend]).ravel()
        return scipy.sparse.csr_matrix(scipy.sparse.coo_matrix((values, (rows, columns)), shape=(k, count)))


class PartSeparation:
    """Measures how far the parts of a character drift apart where they touch at rest (`TOUCH_DIAGONALS`).

    A part that floats free, or is deep inside another part, is tied over a distance. This distance changes when the
    surface bends although nothing has come apart, so it is not measured.

    Parameters
    ----------
    mesh : SolverMesh
    """

    largest: float
    """Largest distance over all frames between points that touch at rest, as a fraction of the diagonal; 0 if there are
    no such points."""

    def __init__(self, mesh: SolverMesh) -> None:
        self.largest = 0.0
        ties = contacts(mesh)
        self._jump = ties.only(ties.gap == 0).difference(len(mesh.vertices))
        self._diagonal = mesh.diagonal

    def add(self, positions: NDArray[np.floating]) -> None:
        """Measure some frames: (n, 3, F) solver vertices, in the units of the mesh."""
        if self._jump.shape[0]:
            jump = (self._jump @ positions.reshape(len(positions), -1)).reshape(-1, *positions.shape[1:])
            apart = np.sqrt(np.einsum("kxf,kxf->kf", jump, jump).max(initial=0))
            self.largest = max(self.largest, float(apart) / self._diagonal)


def contacts(mesh: SolverMesh) -> Contacts:
    """Find contacts that tie all parts of a character together; computed once per mesh.

    1. A vertex is in contact with the nearest surface of another part if that is within `TOUCH_DIAGONALS`, or if one of
       the vertex's edges crosses it. Surfaces that face each other across a gap, such as a hand beside a hip, are not
       in contact.
    2. Groups of parts that are still separate are joined where they are nearest to each other, until all parts are
       connected (Borůvka's algorithm).
    3. Surfaces that face each other across a gap are tied as well if they are also close along the surface. If the way
       from one to the other is long, they belong to two limbs, which will move apart.

    Returns
    -------
    Contacts
        Empty for a mesh of one part.
    """
    if mesh not in _contacts_of_mesh:
        _contacts_of_mesh[mesh] = _find_contacts(mesh)
    return _contacts_of_mesh[mesh]


_contacts_of_mesh: WeakKeyDictionary[SolverMesh, Contacts] = WeakKeyDictionary()


def _find_contacts(mesh: SolverMesh) -> Contacts:
    part = mesh.components
    if part.max() == 0:
        nothing = np.zeros((0, 3))
        return Contacts(np.zeros(0, dtype=np.int64), nothing.astype(np.int64), nothing, np.zeros(0))
    tree = SurfaceTree(mesh.vertices[mesh.faces])
    touching = TOUCH_DIAGONALS * mesh.diagonal
    near = _nearest(mesh, tree, part, np.maximum(touching, _longest_edges(mesh)))
    height, cosine = _relief(mesh, near)
    through = _goes_through(mesh, near, height)
    close = near.distance <= touching
    facing = (
        close
        & ~through
        & _by_majority(mesh, near, close, (height > MIN_GAP_DIAGONALS * mesh.diagonal) & (cosine < MAX_FACING_COSINE))
    )
    found = [near.contacts(mesh, (close & ~facing) | through)]
    while (group := _groups(mesh, found)).max() > 0:
        found.append(_join(mesh, tree, group))
    for some in found:
        facing[some.vertices] = False
    if facing.any():
        across = near.contacts(mesh, facing)
        found.append(across.only(_detour(mesh, found, across) <= MAX_DETOUR_DIAGONALS * mesh.diagonal))
    return Contacts(*(np.concatenate([getattr(some, field.name) for some in found]) for field in fields(Contacts)))


@dataclass(frozen=True)
class _Near:
    """The nearest surface point of another part, or group of parts, for each of n vertices.

    Attributes
    ----------
    face : (n,) int64
        −1 if there is none within reach; the blend is then undefined and the distance infinite.
    blend : (n, 3) float64
    distance : (n,) float64
    """

    face: NDArray[np.int64]
    blend: NDArray[np.float64]
    distance: NDArray[np.float64]

    def contacts(self, mesh: SolverMesh, chosen: NDArray[np.bool_]) -> Contacts:
        """Tie the chosen vertices; only those farther away than `TOUCH_DIAGONALS` keep their distance."""
        distance = self.distance[chosen]
        gap = np.where(distance > TOUCH_DIAGONALS * mesh.diagonal, distance, 0.0)
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

    The surface's normal is blended from those of its vertices, so that it does not jump at edges.
    """
    normals = igl.per_vertex_normals(mesh.vertices, mesh.faces)
    corners = mesh.faces[near.face]
    there = np.einsum("nc,ncx->nx", near.blend, normals[corners])
    there /= np.maximum(np.linalg.norm(there, axis=1, keepdims=True), 1e-12)
    away = mesh.vertices - np.einsum("nc,ncx->nx", near.blend, mesh.vertices[corners])
    return np.einsum("nx,nx->n", away, there), np.einsum("nx,nx->n", normals, there)


def _by_majority(
    mesh: SolverMesh, near: _Near, close: NDArray[np.bool_], votes: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Give connected vertices that are close to the same part the vote of most of them: corners and rims are wrong."""
    part = mesh.components[mesh.faces[near.face, 0]]
    a, b = mesh.edges[close[mesh.edges].all(axis=1) & (part[mesh.edges[:, 0]] == part[mesh.edges[:, 1]])].T
    region = connected_components(len(mesh.vertices), a, b)
    return (np.bincount(region, votes) > 0.5 * np.bincount(region))[region]


def _goes_through(mesh: SolverMesh, near: _Near, height: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which vertices are the nearer ends of edges that cross the surface of another part.

    One end is outside, the other inside, and the sum of their distances to the surface is at most the edge's length.
    """
    a, b = mesh.edges.T
    part = mesh.components[mesh.faces[near.face, 0]]
    length = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
    known = (near.face[a] >= 0) & (near.face[b] >= 0) & (part[a] == part[b])
    crossing = known & (height[a] * height[b] < 0) & (near.distance[a] + near.distance[b] <= length)
    through = np.zeros(len(mesh.vertices), dtype=bool)
    through[np.where(near.distance[a] <= near.distance[b], a, b)[crossing]] = True
    return through


def _groups(mesh: SolverMesh, found: list[Contacts]) -> NDArray[np.int32]:
    """Return the (n,) number of the group of tied parts that each vertex belongs to."""
    a, b = mesh.components[np.concatenate([some.links for some in found])].T
    return connected_components(mesh.parts, a, b)[mesh.components]


def _join(mesh: SolverMesh, tree: SurfaceTree, group: NDArray[np.int32]) -> Contacts:
    """Tie every group of parts to the group nearest to it."""
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
    reach = MAX_JOIN_DISTANCE_RATIO * gap + TOUCH_DIAGONALS * mesh.diagonal
    return near.contacts(mesh, chosen[of_vertex] & (near.distance <= reach[of_vertex]))


def _detour(mesh: SolverMesh, found: list[Contacts], across: Contacts) -> NDArray[np.float64]:
    """Return a lower bound of the way over the character from one side of each contact to the other.

    The distance between two points is at least the difference of their distances to any third point. With landmarks at
    the ends of the limbs, this is a good estimate at the cost of a few searches.
    """
    n = len(mesh.vertices)
    a, b = np.concatenate([mesh.edges, *(some.links for some in found)]).T
    lengths = np.maximum(np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1), 1e-12 * mesh.diagonal)
    graph = scipy.sparse.csr_matrix(scipy.sparse.coo_matrix((lengths, (a, b)), shape=(n, n)))
    longest, nearest = np.zeros(len(across.vertices)), np.full(n, np.inf)
    landmark = int(across.vertices[0])
    for _ in range(LANDMARK_COUNT):
        distance = np.asarray(scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=np.array([landmark])))[0]
        nearest = np.minimum(nearest, distance)
        landmark = int(nearest.argmax())
        one, other = across.links.T
        longest = np.maximum(longest, np.abs(distance[one] - distance[other]))
    return longest
