"""Triangulates polygons by fans, and by ear clipping for concave polygons."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solver.surface.winding import distinct_rows

MAX_CONCAVE_CORNERS = 500
"""Maximum number of corners of a polygon that is cut by ear clipping, which takes quadratic time."""

ATTEMPTS_PER_CORNER = 4
"""Maximum number of failed attempts to cut an ear, per corner of a polygon."""


def triangulate(points: NDArray[np.float64], sizes: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Split polygons into triangles without new vertices.

    A polygon of n corners becomes n − 2 triangles, or none if n is less than 3. A convex polygon becomes a fan around
    its first corner, and so does one of more than `MAX_CONCAVE_CORNERS`. Other concave polygons are cut by ear clipping
    (Meisters 1975) in a projection along the axis that is nearest to their mean normal.

    Parameters
    ----------
    points : (c, 3) float64
        Corners of all polygons, one polygon after another.
    sizes : (p,) int64
        Number of corners of each polygon.

    Returns
    -------
    triangles : (t, 3) int64
        Indices into `points`.
    polygon : (t,) int64
        Polygon of each triangle.
    """
    starts = np.cumsum(sizes) - sizes
    parts = np.maximum(sizes - 2, 0)
    firsts = np.cumsum(parts) - parts
    polygon = np.repeat(np.arange(len(sizes)), parts)
    step = np.arange(len(polygon)) - firsts[polygon]
    triangles = starts[polygon][:, None] + np.column_stack([np.zeros_like(step), step + 1, step + 2])
    if (sizes > 3).any():
        concave, normals = _concave(points, sizes)
        for p in np.nonzero(concave & (sizes <= MAX_CONCAVE_CORNERS))[0]:
            corners = points[starts[p] : starts[p] + sizes[p]]
            triangles[firsts[p] : firsts[p] + parts[p]] = starts[p] + _ears(_flattened(corners, normals[p]))
    return triangles, polygon


def _concave(points: NDArray[np.float64], sizes: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return which polygons (p,) are concave, and their normals (p, 3) of any length."""
    owner = np.repeat(np.arange(len(sizes)), sizes)
    ends = np.cumsum(sizes)[sizes > 0] - 1
    after = np.arange(1, len(points) + 1)
    after[ends] = (np.cumsum(sizes) - sizes)[sizes > 0]
    before = np.empty_like(after)
    before[after] = np.arange(len(points))
    incoming, outgoing = points - points[before], points[after] - points
    turn = np.cross(incoming, outgoing)
    relative = points - points[(np.cumsum(sizes) - sizes)[owner]]
    area = np.cross(relative, relative[after])
    normals: NDArray[np.float64] = np.column_stack([np.bincount(owner, axis, len(sizes)) for axis in area.T])
    size = np.linalg.norm(incoming, axis=1) * np.linalg.norm(outgoing, axis=1) * np.linalg.norm(normals, axis=1)[owner]
    reflex = np.einsum("ij,ij->i", turn, normals[owner]) < -1e-9 * size
    return (np.bincount(owner, reflex, len(sizes)) > 0) & (sizes > 3), normals


def _flattened(points: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points projected along a normal's largest coordinate (n, 2), with the same winding."""
    axis = int(np.argmax(np.abs(normal)))
    kept = points[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return kept if normal[axis] > 0 else kept * [-1.0, 1.0]


def _ears(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Cut a counter-clockwise polygon (n, 2) into n − 2 triangles; if no ears are left, the rest becomes a fan."""
    ring = list(range(len(points)))
    triangles = []
    place, attempts = 0, ATTEMPTS_PER_CORNER * len(points)
    while len(ring) > 3 and attempts:
        place %= len(ring)
        ear = ring[place - 1], ring[place], ring[(place + 1) % len(ring)]
        if _is_ear(points, ear, ring):
            triangles.append(ear)
            del ring[place]
            place -= 1  # its neighbours may be ears now; in a spiral, no other corners are
        else:
            place += 1
            attempts -= 1
    return np.array(triangles + [(ring[0], b, c) for b, c in pairwise(ring[1:])])


def _is_ear(points: NDArray[np.float64], ear: tuple[int, int, int], ring: list[int]) -> bool:
    """Return whether a corner is convex and no other corner lies in its triangle or on its sides."""
    corners = points[list(ear)]
    (ax, ay), (bx, by), (cx, cy) = corners.tolist()
    if (bx - ax) * (cy - by) - (by - ay) * (cx - bx) <= 0:
        return False
    sides = np.roll(corners, -1, axis=0) - corners
    away = points[ring][:, None] - corners
    within = np.all(sides[:, 0] * away[:, :, 1] - sides[:, 1] * away[:, :, 0] >= 0, axis=1)
    elsewhere = np.all(away.any(axis=2), axis=1)
    return not np.any(within & elsewhere)


def distinct_corners(corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find the distinct corners, which become a mesh's vertices.

    Parameters
    ----------
    corners : (c, k) int64
        Indices, −1 for none.

    Returns
    -------
    first : (n,) int64
        Index of the first corner of each kind, ascending.
    vertex_of : (c,) int64
        Vertex of each corner, as an index into `first`.
    """
    first, kind = distinct_rows(corners)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[kind]
