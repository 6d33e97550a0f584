"""Bones, and which part of the surface each one holds.

A vertex belongs to the bone that it is nearest to *along the surface*: a skirt beside a hand is near to the hand in
space only. Distances begin where rays that leave a bone at right angles meet the surface.
"""

import heapq
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

ACROSS = 10.0
"""What a contact across a gap adds to a distance, in diagonals: such parts belong to a bone only where nothing else
reaches them."""

RINGS = 9
"""Number of places along a bone from which rays leave, evenly spaced."""

RAYS = 24
"""Number of rays that leave each of them, evenly spaced round the bone."""

WIDE = 1.5
"""Length of a ray, in median lengths of its bone's rays, over which it goes into another limb, or out of a hem: what
it is longer counts as distance."""

MIDDLE = 0.2, 0.8
"""Part of a bone's length around which the surface is held; towards its joints the surface is left to bend."""

MOST = 2 / 3
"""Share of a part's area from which all of it belongs to the limb that has so much of it."""

NEARLY_ALL = 0.95
"""Share of a vertex from which a bone holds it: the skin around it bends."""

ENOUGH = 4
"""Fewest vertices that determine a bone's motion."""

NEAR = 2.0
"""Greatest distance of held surface from where the rays of its bone meet the surface, in median lengths of its rays.
This does not bound the end of a limb, whose fingers and hair are part of it."""


@dataclass(frozen=True, eq=False)
class Bones:
    """Segments inside a character that move rigidly, at rest.

    Attributes
    ----------
    heads, tails : (b, 3) float64
        Mesh file's coordinates.
    parents : (b,) int64
        The bone that each hangs on, −1 for none; parents come before their children.
    limbs : (b,) int64
        Number of the limb that each is part of, from 0; −1 for the trunk, on which limbs hang. A limb's bones follow
        each other from root to tip.
    """

    heads: NDArray[np.float64]
    tails: NDArray[np.float64]
    parents: NDArray[np.int64]
    limbs: NDArray[np.int64]

    def __len__(self) -> int:
        """Return the number of bones."""
        return len(self.heads)

    @property
    def lengths(self) -> NDArray[np.float64]:
        """(b,) float64, mesh units."""
        return np.linalg.norm(self.tails - self.heads, axis=1)

    @property
    def terminal(self) -> NDArray[np.bool_]:
        """(b,) bool: no other bone hangs on it."""
        return ~np.isin(np.arange(len(self)), self.parents)

    @property
    def roots(self) -> NDArray[np.bool_]:
        """(b,) bool: others hang on its parent as well, or it does not begin where its parent ends."""
        beside = np.linalg.norm(self.heads - self.tails[self.parents], axis=1) > 1e-6 * self.lengths
        branches = np.bincount(self.parents[self.parents >= 0], minlength=len(self))[self.parents] > 1
        return (self.parents < 0) | beside | branches


NO_BONES = Bones(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


@dataclass(frozen=True, eq=False)
class BoneRegions:
    """Which part of the surface belongs to each bone.

    Attributes
    ----------
    owner : (n,) int64
        The bone of each vertex; −1 for vertices beyond the root of every limb.
    held : (n,) bool
        Vertices that move as their bone does.
    """

    owner: NDArray[np.int64]
    held: NDArray[np.bool_]

    def of(self, bone: int) -> NDArray[np.int64]:
        """Return the vertices that a bone holds."""
        return np.flatnonzero(self.held & (self.owner == bone))


def bone_regions(mesh: SolverMesh, bones: Bones) -> BoneRegions:
    """Find the part of the surface that belongs to each bone.

    1. Rays leave every bone at right angles; where they meet the surface, the distance to the bone is 0.
    2. Every vertex belongs to the bone that it is nearest to along edges and contacts between parts. The first bone of
       a limb has nothing that lies behind its head. A part that belongs to one limb for the most part does so wholly.
    3. A bone holds those of its vertices that are around its `MIDDLE` and `NEAR`; the last bone of a limb holds all of
       them that lie beyond its head.

    Parameters
    ----------
    mesh : SolverMesh
    bones : Bones
        Longer than 0.
    """
    if not len(bones):
        n = len(mesh.vertices)
        return BoneRegions(np.full(n, -1), np.zeros(n, dtype=bool))
    lengths = bones.lengths
    axes = (bones.tails - bones.heads) / lengths[:, None]
    along = (mesh.vertices @ axes.T - np.einsum("bx,bx->b", bones.heads, axes)) / lengths
    start, radius = _where_rays_meet(mesh, bones, axes, along)
    graph = _both_ways(mesh)
    before_its_head = (along < 0) & bones.roots
    owner, distance = _nearest(graph.indptr, graph.indices.astype(np.int64), graph.data, start, before_its_head)
    limb = _limb_of_parts(mesh, bones, owner)[mesh.components, None]
    if np.any(limb >= 0):
        forbidden = np.where(limb >= 0, bones.limbs != limb, before_its_head)
        owner, distance = _nearest(graph.indptr, graph.indices.astype(np.int64), graph.data, start, forbidden)
    known = owner >= 0
    place = along[np.arange(len(owner)), owner]
    low, high = MIDDLE
    middle = (place >= low) & (place <= high) & (distance <= NEAR * radius[owner])
    # a bone without a limb before it has a neck or the like at its head, which bends
    first = np.where(bones.roots, low, 0.0)[owner]
    held = known & np.where(bones.terminal[owner], place >= first, middle)
    coarse = np.bincount(owner[held], minlength=len(bones)) == 0  # few vertices, all of them at joints
    held |= known & coarse[owner]
    return BoneRegions(owner, held)


def regions_of_shares(shares: NDArray[np.float64]) -> BoneRegions:
    """Find the part of the surface that belongs to each bone from the weights of a skin.

    A vertex belongs to the bone that has most of it, and is held where that is nearly all. A bone that has nearly all
    of hardly any vertex holds those that belong to it.

    Parameters
    ----------
    shares : (n, b) float64
        Of each bone in each vertex; rows sum to 1, or to 0 for vertices that follow no bone.
    """
    most = shares.max(axis=1, initial=0.0)
    owner = np.where(most > 0, shares.argmax(axis=1), -1)
    held = most >= NEARLY_ALL
    few = np.bincount(owner[held], minlength=shares.shape[1]) < ENOUGH
    return BoneRegions(owner, held | ((owner >= 0) & few[owner]))


def _limb_of_parts(mesh: SolverMesh, bones: Bones, owner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of the limb to which most of each part belongs, (parts,) int64; −1 for a part without one.

    A sleeve, an arm or a weapon that is a part of its own may reach behind the root of its limb, and beside another.
    """
    parts, limbs = mesh.parts, int(bones.limbs.max(initial=-1)) + 1
    if parts == 1 or not limbs:
        return np.full(parts, -1)
    limb = np.where(owner >= 0, bones.limbs[owner], -1)
    area = np.zeros((parts, limbs))
    np.add.at(area, (mesh.components[limb >= 0], limb[limb >= 0]), mesh.vertex_areas[limb >= 0])
    whole = np.bincount(mesh.components, mesh.vertex_areas, parts)
    return np.where(area.max(axis=1) > MOST * whole, area.argmax(axis=1), -1)


def _both_ways(mesh: SolverMesh) -> "csr_matrix":
    """Return the (n, n) lengths of edges and contacts between parts.

    A contact across a gap may tie a hand to the hip beside it: it is longer than any way over the surface.
    """
    ties = contacts(mesh)
    a, b = np.concatenate([mesh.edges, ties.links]).T
    lengths = np.maximum(np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1), 1e-12 * mesh.diagonal)
    lengths[len(mesh.edges) :] += np.where(ties.gap > 0, ACROSS * mesh.diagonal, 0.0)
    n = len(mesh.vertices)
    once = scipy.sparse.coo_matrix((lengths, (a, b)), shape=(n, n)).tocsr()
    return scipy.sparse.csr_matrix(once.maximum(once.T))


def _where_rays_meet(
    mesh: SolverMesh, bones: Bones, axes: NDArray[np.float64], along: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cast rays at right angles to each bone.

    Returns
    -------
    start : (n, b) float64
        Distance to each bone that a vertex begins with; infinite where no ray meets one of its triangles.
    radius : (b,) float64
        Median length of each bone's rays.
    """
    start, radius = np.full(along.shape, np.inf), np.zeros(len(bones))
    places = (np.arange(RINGS) + 0.5) / RINGS
    for b, axis in enumerate(axes):
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side /= np.linalg.norm(side)
        plane = np.stack([side, np.cross(axis, side)], axis=1)
        flat = (mesh.vertices - bones.heads[b]) @ plane
        length, face, point = _cast(mesh.faces, np.ascontiguousarray(along[:, b]), flat, places)
        world = bones.heads[b] + point @ np.column_stack([axis * bones.lengths[b], plane]).T
        met = _leaves(mesh, face, world - bones.heads[b] - point[:, :1] * (axis * bones.lengths[b]))
        if not met.any():  # outside the mesh: what is nearest
            away = np.linalg.norm(mesh.vertices - (bones.heads[b] + bones.tails[b]) / 2, axis=1)
            start[away.argmin(), b], radius[b] = 0.0, away.min()
            continue
        radius[b] = np.median(length[met])
        excess = np.maximum(0.0, length[met] - WIDE * radius[b])
        corners = mesh.faces[face[met]]
        away = np.linalg.norm(mesh.vertices[corners] - world[met, None], axis=2) + excess[:, None]
        np.minimum.at(start[:, b], corners, away)
    return start, radius


def _leaves(mesh: SolverMesh, face: NDArray[np.int64], ray: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Say which rays leave the limb where they meet a face; one that enters there has left through a hole or a hem."""
    a, b, c = mesh.vertices[mesh.faces[face]].transpose(1, 0, 2)
    outward = np.einsum("kx,kx->k", np.cross(b - a, c - a), ray) > 0
    met = face >= 0
    return met & outward if (met & outward).any() else met


@compiled
def _cast(faces, along, flat, places):
    """Cut triangles at some places along a bone, and keep for each direction round it the nearest cut.

    Parameters
    ----------
    faces : (t, 3) int64
    along : (n,) float64
        Where each vertex is along the bone.
    flat : (n, 2) float64
        Where it is in the plane across.
    places : (RINGS,) float64
        Ascending.

    Returns
    -------
    length : (RINGS · RAYS,) float64
    face : (RINGS · RAYS,) int64
        The triangle that each ray meets first; −1 for none.
    point : (RINGS · RAYS, 3) float64
        Place along the bone, and in the plane across.
    """
    count = len(places) * RAYS
    length, face, point = np.full(count, np.inf), np.full(count, -1), np.zeros((count, 3))
    step, cut = 2 * np.pi / RAYS, np.empty((3, 2))
    for f in range(len(faces)):
        low = min(along[faces[f, 0]], along[faces[f, 1]], along[faces[f, 2]])
        high = max(along[faces[f, 0]], along[faces[f, 1]], along[faces[f, 2]])
        for ring in range(len(places)):
            place = places[ring]
            if not low < place <= high:
                continue
            cuts = 0
            for side in range(3):
                a, b = faces[f, side], faces[f, (side + 1) % 3]
                if (along[a] < place) != (along[b] < place):
                    share = (place - along[a]) / (along[b] - along[a])
                    for x in range(2):
                        cut[cuts, x] = (1 - share) * flat[a, x] + share * flat[b, x]
                    cuts += 1
            px, py, qx, qy = cut[0, 0], cut[0, 1], cut[1, 0], cut[1, 1]
            turned = np.arctan2(px * qy - py * qx, px * qx + py * qy)
            begin = np.arctan2(py, px)
            if turned < 0:
                begin, turned = begin + turned, -turned
            ray = int(np.ceil(begin / step))
            while ray * step <= begin + turned:
                x, y = np.cos(ray * step), np.sin(ray * step)
                across = x * (qy - py) - y * (qx - px)
                away = (px * (qy - py) - py * (qx - px)) / across if across != 0 else np.inf
                number = ring * RAYS + ray % RAYS
                if 0 <= away < length[number]:
                    length[number], face[number] = away, f
                    point[number, 0], point[number, 1], point[number, 2] = place, away * x, away * y
                ray += 1
    return length, face, point


@compiled
def _nearest(starts, neighbours, lengths, start, forbidden):
    """Return the bone that each vertex is nearest to along a graph, and how far away: Dijkstra's algorithm.

    Parameters
    ----------
    starts : (n + 1,) int
    neighbours, lengths : (2e,)
        Adjacency in compressed rows.
    start : (n, b) float64
        Distance to each bone to begin with; infinite for none.
    forbidden : (n, b) bool
        Bones that a vertex does not belong to.
    """
    n, count = start.shape
    owner, distance = np.full(n, -1), np.full(n, np.inf)
    heap = [(0.0, 0, 0)]
    heap.clear()
    for v in range(n):
        for b in range(count):
            if start[v, b] < np.inf and not forbidden[v, b]:
                heapq.heappush(heap, (start[v, b], v, b))
    while len(heap) > 0:
        away, v, b = heapq.heappop(heap)
        if owner[v] >= 0:
            continue
        owner[v], distance[v] = b, away
        for entry in range(starts[v], starts[v + 1]):
            u = neighbours[entry]
            if owner[u] < 0 and not forbidden[u, b]:
                further = away + lengths[entry]
                if further < distance[u]:
                    distance[u] = further  # of the nearest so far; ties keep the first
                    heapq.heappush(heap, (further, u, b))
    return owner, distance
