"""Bones, and the part of the surface that each bone holds.

A vertex belongs to the bone that is nearest *along the surface*: a skirt beside a hand is near the hand in space only.
Distances are measured from where rays at right angles to a bone meet the surface.
"""

import heapq
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

GAP_PENALTY_DIAGONALS = 10.0
"""Distance added by a contact across a gap, in diagonals, so that other ways to a part are shorter."""

RINGS_PER_BONE = 9
"""Number of evenly spaced points along a bone at which rays start."""

RAYS_PER_RING = 24
"""Number of evenly spaced rays round the bone at each point."""

MAX_RAY_LENGTH_RATIO = 1.5
"""Largest length of a ray that meets its own limb, in median ray lengths of its bone. The excess of a longer ray, into
another limb or out of a hem, counts as distance."""

MIN_HELD_PLACE = 0.2
"""Place along the first bone of a limb, as a share of its length, below which the surface can bend, as at a neck."""

MIN_LIMB_AREA_SHARE = 2 / 3
"""Smallest share of a part's area in one limb with which the whole part belongs to that limb."""

MIN_BONE_AREA_SHARE = 3 / 4
"""Smallest share of a part's area on one bone with which the whole part belongs to that bone."""

MIN_HELD_WEIGHT = 0.95
"""Smallest skin weight with which a bone holds a vertex; elsewhere the skin bends."""

MIN_HELD_VERTICES = 4
"""Smallest number of vertices that determine a bone's motion."""


@dataclass(frozen=True, eq=False)
class Bones:
    """Segments inside a character that move rigidly, at rest.

    Attributes
    ----------
    heads, tails : (b, 3) float64
        Mesh file's coordinates.
    parents : (b,) int64
        Parent bone, −1 for none; parents come before their children.
    limbs : (b,) int64
        Number of the bone's limb, from 0; −1 for the trunk, the parent of limbs. The bones of a limb are in order from
        root to tip.
    feet : (f,) int64
        Bones of feet on which the character stands.
    up : (3,) float64
        Unit vector away from the ground.
    """

    heads: NDArray[np.float64]
    tails: NDArray[np.float64]
    parents: NDArray[np.int64]
    limbs: NDArray[np.int64]
    feet: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    up: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))

    def __len__(self) -> int:
        """Return the number of bones."""
        return len(self.heads)

    @property
    def lengths(self) -> NDArray[np.float64]:
        """(b,) float64, mesh units."""
        return np.linalg.norm(self.tails - self.heads, axis=1)

    @property
    def terminal(self) -> NDArray[np.bool_]:
        """(b,) bool: bones without children."""
        return ~np.isin(np.arange(len(self)), self.parents)

    @property
    def roots(self) -> NDArray[np.bool_]:
        """(b,) bool: bones without a parent, with siblings, or that do not begin where their parent ends."""
        beside = np.linalg.norm(self.heads - self.tails[self.parents], axis=1) > 1e-6 * self.lengths
        branches = np.bincount(self.parents[self.parents >= 0], minlength=len(self))[self.parents] > 1
        return (self.parents < 0) | beside | branches


NO_BONES = Bones(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


@dataclass(frozen=True, eq=False)
class BoneRegions:
    """The part of the surface that belongs to each bone.

    Attributes
    ----------
    owner : (n,) int64
        Bone of each vertex; −1 for vertices without one.
    held : (n,) bool
        Vertices that move rigidly with their bone.
    """

    owner: NDArray[np.int64]
    held: NDArray[np.bool_]

    def of(self, bone: int) -> NDArray[np.int64]:
        """Return the vertices that a bone holds."""
        return np.flatnonzero(self.held & (self.owner == bone))

    def whole_parts(self, mesh: SolverMesh) -> NDArray[np.int64]:
        """Return the bone that holds the whole part of each vertex, (n,) int64; −1 for none, as on a single part."""
        return _common_to_parts(mesh, np.where(self.held, self.owner, -1))

    def limb_parts(self, mesh: SolverMesh, bones: Bones) -> NDArray[np.int64]:
        """Return the limb that owns the whole part of each vertex, (n,) int64; −1 for none, as on a single part."""
        return _common_to_parts(mesh, np.where(self.owner < 0, -1, bones.limbs[self.owner]))


def plates_of(shares: NDArray[np.float64], mesh: SolverMesh) -> NDArray[np.bool_]:
    """Return the vertices of parts that one bone moves alone, by each bone's share in them (n, b)."""
    return _common_to_parts(mesh, np.where(shares.max(axis=1, initial=0) < 1, -1, shares.argmax(axis=1))) >= 0


def _common_to_parts(mesh: SolverMesh, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number that all vertices of each vertex's part have; −1 for none, as on a single part."""
    low, high = np.full(mesh.parts, np.iinfo(np.int64).max), np.full(mesh.parts, -1)
    np.minimum.at(low, mesh.components, numbers)
    np.maximum.at(high, mesh.components, numbers)
    return np.where(low == high, high, -1)[mesh.components] if mesh.parts > 1 else np.full(len(numbers), -1)


def bone_regions(mesh: SolverMesh, bones: Bones) -> BoneRegions:
    """Find the part of the surface that belongs to each bone.

    1. Rays are cast at right angles to every bone; where they meet the surface, the distance to the bone is 0.
    2. Every vertex belongs to the bone that is nearest along edges and contacts between parts. Vertices behind the head
       of a limb's first bone do not belong to it. A part that mostly belongs to one limb belongs to it entirely. A part
       that nearly belongs to one bone, such as a plate of armour, belongs to it entirely, and moves rigidly with it.
    3. The last bone of a limb holds its vertices beyond its head. If it is also the first bone, it holds those beyond
       `MIN_HELD_PLACE`, or all of a part of the limb.

    Parameters
    ----------
    mesh : SolverMesh
    bones : Bones
        Of non-zero length.
    """
    if not len(bones):
        n = len(mesh.vertices)
        return BoneRegions(np.full(n, -1), np.zeros(n, dtype=bool))
    lengths = bones.lengths
    axes = (bones.tails - bones.heads) / lengths[:, None]
    along = (mesh.vertices @ axes.T - np.einsum("bx,bx->b", bones.heads, axes)) / lengths
    start = _cast_rays(mesh, bones, axes, along)
    graph = _symmetric_lengths(mesh)
    before_its_head = (along < 0) & bones.roots
    owner = _nearest(graph.indptr, graph.indices.astype(np.int64), graph.data, start, before_its_head)
    limb = _majority(mesh, np.where(owner >= 0, bones.limbs[owner], -1), MIN_LIMB_AREA_SHARE)[:, None]
    if np.any(limb >= 0):
        forbidden = np.where(limb >= 0, bones.limbs != limb, before_its_head)
        owner = _nearest(graph.indptr, graph.indices.astype(np.int64), graph.data, start, forbidden)
    whole = _majority(mesh, owner, MIN_BONE_AREA_SHARE)
    owner = np.where(whole >= 0, whole, owner)
    place = along[np.arange(len(owner)), owner]
    first = np.where(bones.roots[owner] & (limb[:, 0] < 0), MIN_HELD_PLACE, 0.0)
    held = (whole >= 0) | ((owner >= 0) & bones.terminal[owner] & (place >= first))
    return BoneRegions(owner, held)


def regions_of_shares(shares: NDArray[np.float64]) -> BoneRegions:
    """Find the part of the surface that belongs to each bone from the weights of a skin.

    A vertex belongs to the bone with the largest weight, which holds it if that weight is at least `MIN_HELD_WEIGHT`. A
    bone with fewer than `MIN_HELD_VERTICES` such vertices holds all that belong to it.

    Parameters
    ----------
    shares : (n, b) float64
        Weight of each bone in each vertex; rows sum to 1, or to 0 for vertices without a bone.
    """
    most = shares.max(axis=1, initial=0.0)
    owner = np.where(most > 0, shares.argmax(axis=1), -1)
    held = most >= MIN_HELD_WEIGHT
    few = np.bincount(owner[held], minlength=shares.shape[1]) < MIN_HELD_VERTICES
    return BoneRegions(owner, held | ((owner >= 0) & few[owner]))


def _majority(mesh: SolverMesh, numbers: NDArray[np.int64], least: float) -> NDArray[np.int64]:
    """Return the number (n,) that more than a share of the area of each vertex's part has; −1 for none.

    A separate part, such as a sleeve or a weapon, may extend behind the root of its limb, or beside another limb. A
    character of one part has no majority.
    """
    known, parts = numbers >= 0, mesh.parts
    if parts == 1 or not known.any():
        return np.full(len(numbers), -1)
    area = np.zeros((parts, int(numbers.max()) + 1))
    np.add.at(area, (mesh.components[known], numbers[known]), mesh.vertex_areas[known])
    whole = np.bincount(mesh.components, mesh.vertex_areas, parts)
    return np.where(area.max(axis=1) > least * whole, area.argmax(axis=1), -1)[mesh.components]


def _symmetric_lengths(mesh: SolverMesh) -> "csr_matrix":
    """Return the symmetric (n, n) lengths of edges and contacts between parts.

    A contact across a gap may tie a hand to the hip beside it, so it is longer than any way over the surface.
    """
    ties = contacts(mesh)
    a, b = np.concatenate([mesh.edges, ties.links]).T
    lengths = np.maximum(np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1), 1e-12 * mesh.diagonal)
    lengths[len(mesh.edges) :] += np.where(ties.gap > 0, GAP_PENALTY_DIAGONALS * mesh.diagonal, 0.0)
    n = len(mesh.vertices)
    once = scipy.sparse.coo_matrix((lengths, (a, b)), shape=(n, n)).tocsr()
    return scipy.sparse.csr_matrix(once.maximum(once.T))


def _cast_rays(
    mesh: SolverMesh, bones: Bones, axes: NDArray[np.float64], along: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Cast rays at right angles to each bone.

    Returns
    -------
    (n, b) float64
        Initial distance of each vertex to each bone; infinite if no ray meets one of its triangles.
    """
    start = np.full(along.shape, np.inf)
    places = (np.arange(RINGS_PER_BONE) + 0.5) / RINGS_PER_BONE
    for b, axis in enumerate(axes):
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side /= np.linalg.norm(side)
        plane = np.stack([side, np.cross(axis, side)], axis=1)
        flat = (mesh.vertices - bones.heads[b]) @ plane
        length, face, point = _cast(mesh.faces, np.ascontiguousarray(along[:, b]), flat, places)
        world = bones.heads[b] + point @ np.column_stack([axis * bones.lengths[b], plane]).T
        met = _leaves(mesh, face, world - bones.heads[b] - point[:, :1] * (axis * bones.lengths[b]))
        if not met.any():  # a bone outside the mesh has its nearest vertex
            away = np.linalg.norm(mesh.vertices - (bones.heads[b] + bones.tails[b]) / 2, axis=1)
            start[away.argmin(), b] = 0.0
            continue
        excess = np.maximum(0.0, length[met] - MAX_RAY_LENGTH_RATIO * np.median(length[met]))
        corners = mesh.faces[face[met]]
        away = np.linalg.norm(mesh.vertices[corners] - world[met, None], axis=2) + excess[:, None]
        np.minimum.at(start[:, b], corners, away)
    return start


def _leaves(mesh: SolverMesh, face: NDArray[np.int64], ray: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which rays leave the limb where they meet a face; one that enters there has left through a hole or hem."""
    a, b, c = mesh.vertices[mesh.faces[face]].transpose(1, 0, 2)
    outward = np.einsum("kx,kx->k", np.cross(b - a, c - a), ray) > 0
    met = face >= 0
    return met & outward if (met & outward).any() else met


@compiled
def _cast(faces, along, flat, places):
    """Cut triangles with planes across a bone, and find the nearest cut in each direction.

    Parameters
    ----------
    faces : (t, 3) int64
    along : (n,) float64
        Coordinate of each vertex along the bone.
    flat : (n, 2) float64
        Its coordinates in the plane across the bone.
    places : (RINGS_PER_BONE,) float64
        Coordinates of the planes along the bone, ascending.

    Returns
    -------
    length : (RINGS_PER_BONE · RAYS_PER_RING,) float64
    face : (RINGS_PER_BONE · RAYS_PER_RING,) int64
        The triangle that each ray meets first; −1 for none.
    point : (RINGS_PER_BONE · RAYS_PER_RING, 3) float64
        Coordinate along the bone, and in the plane across.
    """
    count = len(places) * RAYS_PER_RING
    length, face, point = np.full(count, np.inf), np.full(count, -1), np.zeros((count, 3))
    step, cut = 2 * np.pi / RAYS_PER_RING, np.empty((3, 2))
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
                number = ring * RAYS_PER_RING + ray % RAYS_PER_RING
                if 0 <= away < length[number]:
                    length[number], face[number] = away, f
                    point[number, 0], point[number, 1], point[number, 2] = place, away * x, away * y
                ray += 1
    return length, face, point


@compiled
def _nearest(starts, neighbours, lengths, start, forbidden):
    """Return the nearest bone of each vertex along a graph (Dijkstra's algorithm).

    Parameters
    ----------
    starts : (n + 1,) int
    neighbours, lengths : (2e,)
        Adjacency in compressed rows.
    start : (n, b) float64
        Initial distance to each bone; infinite for none.
    forbidden : (n, b) bool
        Bones to which a vertex cannot belong.
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
                    distance[u] = further  # if equal, the first bone is kept
                    heapq.heappush(heap, (further, u, b))
    return owner
