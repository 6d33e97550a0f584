"""The tufted Laplacian, for surfaces with slivers, borders and edges of many faces.

N. Sharp and K. Crane, *A Laplacian for Nonmanifold Triangle Meshes*, SGP 2020. Every triangle is doubled, one for each
side, and at each edge a side is joined to that of the next triangle round the edge. This *tufted cover* has no border
and two faces at each edge. Its edges are flipped intrinsically, by their lengths, until it is Delaunay.

A *halfedge* 3 f + s is side s of face f of the cover, from its corner s to the next one.
"""

from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.surface.winding import edges_of, lexicographic_order

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MOLLIFICATION_EDGE_LENGTHS = 1e-5
"""Smallest amount by which two sides of a triangle exceed the third, as a share of the mean edge length."""

MIN_DELAUNAY_WEIGHT = -1e-6
"""Cotangent weight below which an edge is flipped."""


def laplacian(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> "tuple[csr_matrix, NDArray[np.float64]]":
    """Build the cotangent Laplacian of the intrinsic Delaunay triangulation of the tufted cover.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (t, 3) int64
        With three different corners each.

    Returns
    -------
    L : (n, n) sparse float64
        Positive semidefinite, rows sum to zero: half the Laplacian of the cover, which has two sheets.
    mass : (n,) float64
        Area of each vertex: a third of the area of its triangles.
    """
    edges, of_side, faces_of_edge = edges_of(faces)
    lengths = _mollified(np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1), of_side)
    twin = _cover(faces, of_side, _round_edges(vertices, faces, edges, of_side, faces_of_edge))
    tail = np.concatenate([faces, faces[:, [0, 2, 1]]]).ravel()
    sides = of_side.reshape(-1, 3)
    length = lengths[np.concatenate([sides, sides[:, ::-1]]).ravel()]
    _flip_to_delaunay(twin, tail, length)
    rows, columns, weights, mass = _weights(twin, tail, length, len(vertices))
    half = scipy.sparse.csr_matrix(
        scipy.sparse.coo_matrix((weights, (rows, columns)), shape=(len(vertices), len(vertices)))
    )
    both = half + half.T
    degree = np.asarray(both.sum(axis=1)).ravel()
    identity = scipy.sparse.csr_matrix((degree, np.arange(len(degree)), np.arange(len(degree) + 1)), shape=both.shape)
    return scipy.sparse.csr_matrix(identity - both), mass


def _mollified(lengths: NDArray[np.float64], of_side: NDArray[np.int64]) -> NDArray[np.float64]:
    """Lengthen all (e,) edges by the same amount, so that no triangle is flat."""
    a, b, c = lengths[of_side.reshape(-1, 3)].T
    slack = np.minimum(np.minimum(a + b - c, b + c - a), c + a - b).min()
    return lengths + max(0.0, MOLLIFICATION_EDGE_LENGTHS * float(lengths.mean()) - float(slack))


def _round_edges(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    edges: NDArray[np.int64],
    of_side: NDArray[np.int64],
    faces_of_edge: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Put all sides (3t,) in the order of their edges, and those of an edge in their order round it."""
    crowded = np.flatnonzero(faces_of_edge[of_side] > 2)
    angle = np.zeros(len(of_side))
    if len(crowded):
        tail, tip = vertices[edges[of_side[crowded]]].swapaxes(0, 1)
        axis = (tip - tail) / np.linalg.norm(tip - tail, axis=1, keepdims=True)
        across = np.eye(3)[np.abs(axis).argmin(axis=1)]
        first = np.cross(across, axis)
        out = vertices[faces.ravel()[crowded // 3 * 3 + (crowded + 2) % 3]] - tail
        angle[crowded] = np.arctan2(
            np.einsum("sx,sx->s", np.cross(axis, first), out), np.einsum("sx,sx->s", first, out)
        )
    return np.lexsort((angle, of_side)) if len(crowded) else lexicographic_order(of_side[:, None], len(edges))


@compiled
def _cover(faces, of_side, order):
    """Return the halfedge of the cover that each one is joined to; face t + f is the back of face f.

    Going round an edge, a face's halfedge along the edge's direction is joined to the next one's against it.
    """
    sides = len(of_side)
    twin = np.empty(2 * sides, dtype=np.int64)
    start = 0
    while start < sides:
        stop = start + 1
        while stop < sides and of_side[order[stop]] == of_side[order[start]]:
            stop += 1
        for place in range(start, stop):
            here = order[place]
            there = order[place + 1 if place + 1 < stop else start]
            along = here if _is_along(faces, here) else _back(here, sides)
            against = _back(there, sides) if _is_along(faces, there) else there
            twin[along], twin[against] = against, along
        start = stop
    return twin


@compiled
def _is_along(faces, side):
    return faces[side // 3, side % 3] < faces[side // 3, (side + 1) % 3]


@compiled
def _back(side, sides):
    return sides + side // 3 * 3 + 2 - side % 3


@compiled
def _next(halfedge):
    return halfedge - 2 if halfedge % 3 == 2 else halfedge + 1


@compiled
def _quadrupled_area(a, b, c):
    """Heron's formula."""
    return np.sqrt(max(0.0, (a + b + c) * (b + c - a) * (a - b + c) * (a + b - c)))


@compiled(error_model="numpy")
def _cotangent(length, halfedge):
    """Return the cotangent of the angle opposite to a halfedge."""
    a, b, c = length[halfedge], length[_next(halfedge)], length[_next(_next(halfedge))]
    return (b * b + c * c - a * a) / _quadrupled_area(a, b, c)


@compiled(error_model="numpy")
def _flip_to_delaunay(twin, tail, length):
    """Flip edges, in place, until no cotangent weight is negative; a ring buffer queues the edges to check."""
    count = len(twin)
    ring = np.empty(count + 1, dtype=np.int64)
    waiting = np.zeros(count, dtype=np.bool_)
    head, end = 0, 0
    for h in range(count):
        if h < twin[h]:
            ring[end] = h
            waiting[h] = True
            end += 1
    while head != end:
        h = ring[head]
        head = head + 1 if head < count else 0
        waiting[h] = False
        if (_cotangent(length, h) + _cotangent(length, twin[h])) / 2 < MIN_DELAUNAY_WEIGHT and _flip(
            twin, tail, length, h
        ):
            g = twin[h]
            for side in (_next(h), _next(_next(h)), _next(g), _next(_next(g))):
                if not waiting[side]:
                    waiting[side] = True
                    ring[end] = side
                    end = end + 1 if end < count else 0


@compiled(error_model="numpy")
def _flip(twin, tail, length, h):
    """Replace the edge a-b of the faces a b c and b a d by c-d; return False if both are the same face."""
    h1, g = _next(h), twin[h]
    h2, g1 = _next(h1), _next(g)
    g2 = _next(g1)
    if h // 3 == g // 3:
        return False
    ab, bc, ca, ad, db = length[h], length[h1], length[h2], length[g1], length[g2]
    along_c, along_d = (ab * ab + ca * ca - bc * bc) / (2 * ab), (ab * ab + ad * ad - db * db) / (2 * ab)
    up, down = _quadrupled_area(ab, bc, ca) / (2 * ab), _quadrupled_area(ab, ad, db) / (2 * ab)
    cd = np.hypot(along_c - along_d, up + down)
    a, b, c, d = tail[h], tail[h1], tail[h2], tail[g2]
    places = (h1, h2, g1, g2)
    ends = (twin[h2], twin[g1], twin[g2], twin[h1])
    for i in range(4):
        other = _moved(ends[i], h1, h2, g1, g2)
        twin[places[i]], twin[other] = other, places[i]
    tail[h], tail[h1], tail[h2], tail[g], tail[g1], tail[g2] = d, c, a, c, d, b
    length[h], length[h1], length[h2], length[g], length[g1], length[g2] = cd, ca, ad, cd, db, bc
    return True


@compiled
def _moved(halfedge, h1, h2, g1, g2):
    """Return the number of a halfedge after the flip."""
    if halfedge == h2:
        return h1
    if halfedge == g1:
        return h2
    if halfedge == g2:
        return g1
    if halfedge == h1:
        return g2
    return halfedge


@compiled(error_model="numpy")
def _weights(twin, tail, length, n):
    """Return each edge's ends and its weight, halved, and the mass of each of n vertices, halved."""
    count = len(twin) // 2
    rows, columns, weights = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32), np.empty(count)
    there = 0
    for h in range(len(twin)):
        if h < twin[h]:
            rows[there], columns[there] = tail[h], tail[twin[h]]
            weights[there] = (_cotangent(length, h) + _cotangent(length, twin[h])) / 4
            if rows[there] == columns[there]:
                weights[there] = 0.0
            there += 1
    mass = np.zeros(n)
    for face in range(len(twin) // 3):
        area = _quadrupled_area(length[3 * face], length[3 * face + 1], length[3 * face + 2]) / 4
        for corner in range(3):
            mass[tail[3 * face + corner]] += area / 6
    return rows, columns, weights, mass
