"""Where the separate parts of a character touch, and whether they stay together.

Eyes, clothes and armour are parts of their own in most files. What ties them is found here: a *contact* is a vertex
and the nearest surface point of another part.
"""

from dataclasses import dataclass
from functools import cached_property

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from solver.mesh import SolverMesh
from solver.surface_tree import SurfaceTree

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
        0 where the two parts touch; where one floats free, the distance that it keeps; in the mesh's units.
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

    def difference(self, count: int) -> csr_matrix:
        """Return the (k, count) matrix that takes functions on the vertices to their jump over each contact."""
        k = len(self.vertices)
        rows = np.repeat(np.arange(k), 4)
        columns = np.column_stack([self.vertices, self.corners]).ravel()
        values = np.column_stack([np.ones(k), -self.blend]).ravel()
        return csr_matrix(coo_matrix((values, (rows, columns)), shape=(k, count)))


class PartSeparation:
    """Measures how far the parts of a character drift apart.

    Parameters
    ----------
    mesh : SolverMesh
    """

    worst: float
    """Largest distance between points in contact over all frames, less the gap of parts that float free, as a fraction
    of the diagonal; 0 without contacts."""

    def __init__(self, mesh: SolverMesh) -> None:
        self.worst = 0.0
        self._contacts = contacts(mesh)
        self._diagonal = mesh.diagonal

    def add(self, positions: NDArray[np.floating]) -> None:
        """Measure one frame of (n, 3) solver vertices, in the units of the mesh."""
        held = self._contacts
        if len(held.vertices):
            partner = np.einsum("kc,kcx->kx", held.blend, positions[held.corners])
            apart = np.linalg.norm(positions[held.vertices] - partner, axis=1) - held.gap
            self.worst = max(self.worst, float(apart.max()) / self._diagonal)


def contacts(mesh: SolverMesh) -> Contacts:
    """Find what ties the parts of a character to each other, so that all of it hangs together.

    1. A vertex is in contact with the nearest surface of another part within `TOUCHING`, unless the two surfaces face
       each other across a gap, as those of a hand beside a hip do.
    2. What is still separate is joined where it comes nearest to the rest, again and again until all is one (Borůvka's
       algorithm): at all of its vertices that are there no more than `TOUCHING` farther away than the nearest.
    3. Surfaces that face each other across a gap are tied as well, where they are close along the surface too. Where it
       is a long way from one to the other they belong to two limbs, which will part.

    Returns
    -------
    Contacts
        Empty for a mesh of one part.
    """
    part = mesh.components
    if part.max() == 0:
        nothing = np.zeros((0, 3))
        return Contacts(np.zeros(0, dtype=np.int64), nothing.astype(np.int64), nothing, np.zeros(0))
    tree, of_face = SurfaceTree(mesh.vertices[mesh.faces]), part[mesh.faces[:, 0]]
    face, blend, _ = tree.nearest(mesh.vertices, part, of_face, TOUCHING * mesh.diagonal)
    vertices = np.flatnonzero(face >= 0)
    touching = Contacts(vertices, mesh.faces[face[vertices]], blend[vertices], np.zeros(len(vertices)))
    facing = _facing(mesh, touching)
    found = [_only(touching, ~facing)]
    while (group := _groups(mesh, found)).max() > 0:
        found.append(_join(mesh, tree, group))
    if facing.any():
        across = _only(touching, facing)
        found.append(_only(across, _detour(mesh, found, across) <= DETOUR * mesh.diagonal))
    return _all(found)


def _only(some: Contacts, chosen: NDArray[np.bool_]) -> Contacts:
    return Contacts(some.vertices[chosen], some.corners[chosen], some.blend[chosen], some.gap[chosen])


def _all(found: list[Contacts]) -> Contacts:
    return Contacts(
        np.concatenate([some.vertices for some in found]),
        np.concatenate([some.corners for some in found]),
        np.concatenate([some.blend for some in found]),
        np.concatenate([some.gap for some in found]),
    )


def _facing(mesh: SolverMesh, touching: Contacts) -> NDArray[np.bool_]:
    """Say which contacts are across a gap between two surfaces that face each other."""
    corners = mesh.vertices[touching.corners]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    own = igl.per_vertex_normals(mesh.vertices, mesh.faces)[touching.vertices]
    away = mesh.vertices[touching.vertices] - np.einsum("kc,kcx->kx", touching.blend, corners)
    outside = np.einsum("kx,kx->k", away, normal) > GAP * mesh.diagonal
    return outside & (np.einsum("kx,kx->k", own, normal) < FACING)


def _groups(mesh: SolverMesh, found: list[Contacts]) -> NDArray[np.int32]:
    """Return the (n,) number of the group of tied parts that each vertex belongs to."""
    part = mesh.components
    a, b = part[np.concatenate([some.links for some in found])].T
    count = int(part.max()) + 1
    return connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count)), directed=False)[1][part]


def _join(mesh: SolverMesh, tree: SurfaceTree, group: NDArray[np.int32]) -> Contacts:
    """Tie every group but the largest to the group that it is nearest to."""
    vertices = np.flatnonzero(group != np.bincount(group).argmax())
    seeking = group[vertices]
    face, blend, distance = tree.nearest(mesh.vertices[vertices], seeking, group[mesh.faces[:, 0]])
    target = group[mesh.faces[face, 0]]
    by_distance = np.lexsort((distance, seeking))
    first = by_distance[np.unique(seeking[by_distance], return_index=True)[1]]
    nearest = np.zeros(group.max() + 1, dtype=np.int64)
    nearest[seeking[first]] = first
    of = nearest[seeking]
    touching = TOUCHING * mesh.diagonal
    tied = (target == target[of]) & (distance <= WIDE * distance[of] + touching)
    gap = np.where(distance[of] > touching, distance, 0.0)
    return Contacts(vertices[tied], mesh.faces[face[tied]], blend[tied], gap[tied])


def _detour(mesh: SolverMesh, found: list[Contacts], across: Contacts) -> NDArray[np.float64]:
    """Return how long the way over the character from one side of each contact to the other is at least.

    Two points are no nearer to each other than their distances to any third one differ; landmarks at the ends of the
    limbs make that a good estimate at the cost of a few searches.
    """
    edges = np.concatenate([mesh.edges, *(some.links for some in found)])
    n = len(mesh.vertices)
    a, b = edges.T
    lengths = np.maximum(np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1), 1e-12 * mesh.diagonal)
    graph = csr_matrix(coo_matrix((lengths, (a, b)), shape=(n, n)))
    longest, nearest = np.zeros(len(across.vertices)), np.full(n, np.inf)
    landmark = int(across.vertices[0])
    for _ in range(LANDMARKS):
        distance = np.asarray(dijkstra(graph, directed=False, indices=np.array([landmark])))[0]
        nearest = np.minimum(nearest, distance)
        landmark = int(nearest.argmax())
        one, other = across.links.T
        longest = np.maximum(longest, np.abs(distance[one] - distance[other]))
    return longest
