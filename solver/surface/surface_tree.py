"""Nearest surface points with a different label than the query point, and segments that cross the surface.

libigl finds nearest points on a whole mesh; a search for each of thousands of parts would take minutes. Here one tree
holds all triangles, and a search skips branches whose triangles all have the label of the query point.
"""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled

MIXED_LABELS = -1
"""Label of a branch whose triangles have several labels."""

MORTON_BITS = 20
"""Bits per coordinate in the Morton code by which triangles are sorted."""


class SurfaceTree:
    """A binary tree of bounding boxes over triangles, laid out as a heap: node k has the children 2k and 2k + 1.

    Triangles are sorted along a space-filling curve, so that neighbours in the tree are neighbours in space.

    Parameters
    ----------
    triangles : (t, 3, 3) float64
        Corner positions; at least one triangle.
    """

    def __init__(self, triangles: NDArray[np.float64]) -> None:
        self._order = np.argsort(_morton(triangles.mean(axis=1)), kind="stable")
        self._triangles = np.ascontiguousarray(triangles[self._order])
        self._leaves = 1 << max(0, int(np.ceil(np.log2(len(triangles)))))
        self._low = np.full((2 * self._leaves, 3), np.inf)
        self._high = np.full((2 * self._leaves, 3), -np.inf)
        there = slice(self._leaves, self._leaves + len(triangles))
        self._low[there], self._high[there] = self._triangles.min(axis=1), self._triangles.max(axis=1)
        for level in self._levels():
            children = slice(2 * level.start, 2 * level.stop)
            self._low[level] = self._low[children].reshape(-1, 2, 3).min(axis=1)
            self._high[level] = self._high[children].reshape(-1, 2, 3).max(axis=1)

    def _levels(self) -> list[slice]:
        """Return the nodes of each level above the leaves, the lowest first."""
        depth = self._leaves.bit_length() - 1
        return [slice(1 << level, 2 << level) for level in reversed(range(depth))]

    def nearest(
        self,
        points: NDArray[np.float64],
        of_point: NDArray[np.integer],
        of_triangle: NDArray[np.integer],
        within: NDArray[np.float64],
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Find the nearest surface point with another label for each point.

        Parameters
        ----------
        points : (n, 3) float64
        of_point : (n,) int
            Labels, from 0.
        of_triangle : (t,) int
        within : (n,) float64
            Search radius of each point.

        Returns
        -------
        triangle : (n,) int64
            −1 if there is none within the radius.
        blend : (n, 3) float64
            Barycentric coordinates of the surface point.
        distance : (n,) float64
            Infinite if there is none.
        """
        label = np.full(2 * self._leaves, MIXED_LABELS)
        # unused leaves take the last triangle's label, so that they do not mix the labels above them
        label[self._leaves :] = of_triangle[self._order[-1]]
        label[self._leaves : self._leaves + len(self._order)] = of_triangle[self._order]
        for level in self._levels():
            left, right = label[2 * level.start : 2 * level.stop].reshape(-1, 2).T
            label[level] = np.where(left == right, left, MIXED_LABELS)
        points, of_point = np.ascontiguousarray(points, dtype=np.float64), np.asarray(of_point, dtype=np.int64)
        slot, blend, square = _search(
            points, of_point, self._triangles, self._low, self._high, label, np.square(within)
        )
        return np.where(slot < 0, -1, self._order[slot]), blend, np.sqrt(square)

    def crossed(
        self, starts: NDArray[np.float64], ends: NDArray[np.float64], away: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return which segments (n,) cross the surface farther than a distance (n,) from their start."""
        found = np.zeros(len(starts), dtype=np.bool_)
        first = np.minimum(1.0, away / np.maximum(np.linalg.norm(ends - starts, axis=1), np.finfo(float).tiny))
        _cross(starts, ends - starts, first, self._triangles, self._low, self._high, found)
        return found


def _morton(points: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Return each point's Morton code: the interleaved bits of its three coordinates."""
    low = points.min(axis=0)
    extent = max(float((points - low).max()), np.finfo(float).tiny)
    cells = ((points - low) / extent * (2**MORTON_BITS - 1)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            code |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return code


@compiled
def _search(points, of_point, triangles, low, high, label, within):
    """Return each point's leaf or −1, the barycentric coordinates there, and the squared distance."""
    n, leaves = len(points), len(label) // 2
    found, blends, squares = np.full(n, -1), np.zeros((n, 3)), np.full(n, np.inf)
    stack, distances = np.empty(128, dtype=np.int64), np.empty(128)
    blend = np.empty(3)
    for i in range(n):
        p, best = points[i], within[i]
        top = 1
        stack[0], distances[0] = 1, 0.0
        while top:
            top -= 1
            node = stack[top]
            if distances[top] >= best or label[node] == of_point[i]:
                continue
            if node >= leaves:
                t = triangles[node - leaves]
                square = closest(p, t[0], t[1], t[2], blend)
                if square < best:
                    best, found[i], squares[i] = square, node - leaves, square
                    blends[i, 0], blends[i, 1], blends[i, 2] = blend[0], blend[1], blend[2]
                continue
            left = _box_distance(p, low[2 * node], high[2 * node])
            right = _box_distance(p, low[2 * node + 1], high[2 * node + 1])
            nearer = 2 * node if left <= right else 2 * node + 1
            stack[top], distances[top] = 4 * node + 1 - nearer, max(left, right)
            stack[top + 1], distances[top + 1] = nearer, min(left, right)
            top += 2
    return found, blends, squares


@compiled(inner=True)
def _box_distance(p, low, high):
    """Return the squared distance of a point to a box."""
    square = 0.0
    for c in range(3):
        away = max(low[c] - p[c], p[c] - high[c], 0.0)
        square += away * away
    return square


@compiled
def _cross(starts, ways, first, triangles, low, high, found):
    """Write whether each segment meets a triangle between a share of its length and its end."""
    leaves = len(low) // 2
    stack = np.empty(128, dtype=np.int64)
    for i in range(len(starts)):
        top = 1
        stack[0] = 1
        while top and not found[i]:
            top -= 1
            node = stack[top]
            if not _passes(starts[i], ways[i], first[i], low[node], high[node]):
                continue
            if node >= leaves:
                found[i] = _meets(starts[i], ways[i], first[i], triangles[node - leaves])
            else:
                stack[top], stack[top + 1] = 2 * node, 2 * node + 1
                top += 2


@compiled(inner=True)
def _passes(start, way, first, low, high):
    """Return whether a segment passes through a box between a share of its length and its end."""
    last = 1.0
    for c in range(3):
        if low[c] > high[c]:  # a box that pads the tree
            return False
        if way[c] == 0:
            if start[c] < low[c] or start[c] > high[c]:
                return False
            continue
        one, other = (low[c] - start[c]) / way[c], (high[c] - start[c]) / way[c]
        first, last = max(first, min(one, other)), min(last, max(one, other))
    return first <= last


@compiled(inner=True)
def _meets(start, way, first, triangle):
    """Return whether a segment meets a triangle between a share of its length and its end (Möller, Trumbore 1997)."""
    corner = triangle[0]
    one, other, offset = _between(corner, triangle[1]), _between(corner, triangle[2]), _between(corner, start)
    across = _product(way, other)
    size = _dot(one, across)
    if size == 0:
        return False
    beside = _product(offset, one)
    u, v, place = _dot(offset, across) / size, _dot(way, beside) / size, _dot(other, beside) / size
    return u >= 0 and v >= 0 and u + v <= 1 and first < place < 1


@compiled(inner=True)
def _between(start, end):
    return (end[0] - start[0], end[1] - start[1], end[2] - start[2])


@compiled(inner=True)
def _product(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled(inner=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def closest(p, a, b, c, blend):
    """Write the barycentric coordinates of the triangle's point nearest to p, and return its squared distance.

    Ericson, *Real-Time Collision Detection* (2005), section 5.1.5: the signs of a few products tell whether that point
    is a corner, on an edge, or inside.
    """
    d1, d2, d3, d4, d5, d6 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for x in range(3):
        ab, ac = b[x] - a[x], c[x] - a[x]
        d1 += ab * (p[x] - a[x])
        d2 += ac * (p[x] - a[x])
        d3 += ab * (p[x] - b[x])
        d4 += ac * (p[x] - b[x])
        d5 += ab * (p[x] - c[x])
        d6 += ac * (p[x] - c[x])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v, w = 0.0, 0.0
    if d1 <= 0 and d2 <= 0:
        pass
    elif d3 >= 0 and d4 <= d3:
        v = 1.0
    elif d6 >= 0 and d5 <= d6:
        w = 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        v = d1 / (d1 - d3)
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        w = d2 / (d2 - d6)
    elif va <= 0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    blend[0], blend[1], blend[2] = 1 - v - w, v, w
    square = 0.0
    for x in range(3):
        away = p[x] - a[x] - v * (b[x] - a[x]) - w * (c[x] - a[x])
        square += away * away
    return square
