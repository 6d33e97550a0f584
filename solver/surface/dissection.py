"""Nested dissection: an elimination order of a surface's vertices that keeps the factor of its matrix sparse.

A. George, *Nested Dissection of a Regular Finite Element Mesh* (1973): a plane cuts the surface in two, the few
vertices along the cut are eliminated last, and both halves are cut in the same way. For a finely subdivided character
of a million vertices, a minimum-degree order takes minutes and several times the memory.
"""

import numpy as np

from puppetline.compiled import compiled

MAX_LEAF_VERTICES = 16
"""Largest number of vertices in a region that is not cut further."""

GOOD_SEPARATOR_RATIO = 2.0
"""Number of vertices along a cut, divided by the square root of the region's, up to which no other axis is tried."""

MIN_SIDE_SHARE = 0.2
"""Smallest share of a region's vertices on either side of a cut."""

LOW, HIGH, SEPARATOR = 0, 1, 2
"""Sides of a cut: below it, above it, and along it."""


@compiled
def nested_dissection(starts, neighbours, places):
    """Order vertices by nested dissection.

    Parameters
    ----------
    starts : (n + 1,) int
    neighbours : (e,) int
        Compressed rows of a symmetric matrix.
    places : (n, 3) float64
        Positions of the vertices. They affect the quality of the order, not its validity.

    Returns
    -------
    (n,) int64
        The vertices in elimination order.
    """
    n = len(starts) - 1
    order, region = np.arange(n), np.zeros(n, dtype=np.int64)
    side, best = np.empty(n, dtype=np.int8), np.empty(n, dtype=np.int8)
    waiting, regions = [(0, 0, n)], 1
    while waiting:
        name, first, last = waiting.pop()
        members = order[first:last].copy()
        if len(members) <= MAX_LEAF_VERTICES:
            continue
        _cut(starts, neighbours, places, members, region, name, side, best)
        begin = first
        for part in (LOW, HIGH, SEPARATOR):
            end = begin
            for v in members:
                if best[v] == part:
                    order[end] = v
                    region[v] = regions
                    end += 1
            if part != SEPARATOR:
                waiting.append((regions, begin, end))
            regions += 1
            begin = end
    return order


@compiled
def _cut(starts, neighbours, places, members, region, name, side, best):
    """Cut a region across the axis with the smallest separator, or by index if no axis separates it."""
    fewest = len(members)
    for axis in _longest_first(places, members):
        middle = places[members, axis].mean()
        for v in members:
            side[v] = HIGH if places[v, axis] > middle else LOW
        between, smaller = _separate(starts, neighbours, members, region, name, side)
        if between < fewest and smaller >= MIN_SIDE_SHARE * (len(members) - between):
            fewest = between
            best[members] = side[members]
        if fewest <= GOOD_SEPARATOR_RATIO * np.sqrt(len(members)):
            return
    if fewest == len(members):
        best[members] = LOW
        best[members[len(members) // 2 :]] = HIGH
        _separate(starts, neighbours, members, region, name, best)


@compiled
def _longest_first(places, members):
    """Return the three axes, that of a region's largest extent first."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for v in members:
        for axis in range(3):
            low[axis] = min(low[axis], places[v, axis])
            high[axis] = max(high[axis], places[v, axis])
    return np.argsort(low - high)


@compiled
def _separate(starts, neighbours, members, region, name, side):
    """Move the vertices of one side that touch the other side to the separator, from the side with fewer of them.

    Returns the sizes of the separator and of the smaller side that is left.
    """
    counts, touching = np.zeros(2, dtype=np.int64), np.zeros(2, dtype=np.int64)
    for v in members:
        counts[side[v]] += 1
        touching[side[v]] += _touches(starts, neighbours, v, region, name, side, 1 - side[v])
    fewer = LOW if touching[LOW] <= touching[HIGH] else HIGH
    for v in members:
        if side[v] == fewer and _touches(starts, neighbours, v, region, name, side, 1 - fewer):
            side[v] = SEPARATOR
    counts[fewer] -= touching[fewer]
    return touching[fewer], counts.min()


@compiled
def _touches(starts, neighbours, v, region, name, side, other):
    for entry in range(starts[v], starts[v + 1]):
        u = neighbours[entry]
        if region[u] == name and side[u] == other:
            return True
    return False
