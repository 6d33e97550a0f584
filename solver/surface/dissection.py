"""An order in which to eliminate the vertices of a surface, so that few entries are added to its factor.

A. George, *Nested Dissection of a Regular Finite Element Mesh* (1973): a plane parts the surface, the few vertices
along it come last, and both halves are parted likewise. On a million vertices of a finely subdivided character, minimum
degree takes minutes and several times the memory.
"""

import numpy as np

from puppetline.compiled import compiled

LEAF = 16
"""Vertices that are not parted any more."""

FEW = 2.0
"""Vertices along a cut, over the root of those that it parts, with which no other axis is tried."""

LEAST_SHARE = 0.2
"""Of a region's vertices, on the smaller side of a cut."""

LOW, HIGH, BETWEEN = 0, 1, 2
"""Where a vertex is when a region is cut."""


@compiled
def nested_dissection(starts, neighbours, places):
    """Order vertices by nested dissection.

    Parameters
    ----------
    starts : (n + 1,) int
    neighbours : (e,) int
        Compressed rows of a symmetric matrix.
    places : (n, 3) float64
        Where the vertices are. They only guide: any are right.

    Returns
    -------
    (n,) int64
        The vertices, in the order in which to eliminate them.
    """
    n = len(starts) - 1
    order, region = np.arange(n), np.zeros(n, dtype=np.int64)
    side, best = np.empty(n, dtype=np.int8), np.empty(n, dtype=np.int8)
    waiting, regions = [(0, 0, n)], 1
    while waiting:
        name, first, last = waiting.pop()
        members = order[first:last].copy()
        if len(members) <= LEAF:
            continue
        _cut(starts, neighbours, places, members, region, name, side, best)
        begin = first
        for part in (LOW, HIGH, BETWEEN):
            end = begin
            for v in members:
                if best[v] == part:
                    order[end] = v
                    region[v] = regions
                    end += 1
            if part != BETWEEN:
                waiting.append((regions, begin, end))
            regions += 1
            begin = end
    return order


@compiled
def _cut(starts, neighbours, places, members, region, name, side, best):
    """Cut a region across the axis that leaves the fewest vertices between, or anyhow if none does."""
    fewest = len(members)
    for axis in _longest_first(places, members):
        middle = places[members, axis].mean()
        for v in members:
            side[v] = HIGH if places[v, axis] > middle else LOW
        between, smaller = _separate(starts, neighbours, members, region, name, side)
        if between < fewest and smaller >= LEAST_SHARE * (len(members) - between):
            fewest = between
            best[members] = side[members]
        if fewest <= FEW * np.sqrt(len(members)):
            return
    if fewest == len(members):
        best[members] = LOW
        best[members[len(members) // 2 :]] = HIGH
        _separate(starts, neighbours, members, region, name, best)


@compiled
def _longest_first(places, members):
    """Return the three axes, first that along which a region reaches farthest."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for v in members:
        for axis in range(3):
            low[axis] = min(low[axis], places[v, axis])
            high[axis] = max(high[axis], places[v, axis])
    return np.argsort(low - high)


@compiled
def _separate(starts, neighbours, members, region, name, side):
    """Take out between two sides those vertices of one that touch the other: of the side that has fewer of them.

    Returns how many these are, and how many are on the smaller of the sides that are left.
    """
    counts, touching = np.zeros(2, dtype=np.int64), np.zeros(2, dtype=np.int64)
    for v in members:
        counts[side[v]] += 1
        touching[side[v]] += _touches(starts, neighbours, v, region, name, side, 1 - side[v])
    fewer = LOW if touching[LOW] <= touching[HIGH] else HIGH
    for v in members:
        if side[v] == fewer and _touches(starts, neighbours, v, region, name, side, 1 - fewer):
            side[v] = BETWEEN
    counts[fewer] -= touching[fewer]
    return touching[fewer], counts.min()


@compiled
def _touches(starts, neighbours, v, region, name, side, other):
    for entry in range(starts[v], starts[v + 1]):
        u = neighbours[entry]
        if region[u] == name and side[u] == other:
            return True
    return False
