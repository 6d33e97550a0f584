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

MAX_WAITING = 256
"""Number of regions for which there is room while they wait to be cut; the regions of a billion vertices need 100."""

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
    waiting, count, regions = np.empty((MAX_WAITING, 3), dtype=np.int64), 1, 1
    waiting[0, 0], waiting[0, 1], waiting[0, 2] = 0, 0, n
    while count:
        count -= 1
        name, first, last = waiting[count, 0], waiting[count, 1], waiting[count, 2]
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
                waiting[count, 0], waiting[count, 1], waiting[count, 2] = regions, begin, end
                count += 1
            regions += 1
            begin = end
    return order


@compiled(inner=True)
def _cut(starts, neighbours, places, members, region, name, side, best):
    """Cut a region across the axis with the smallest separator, or by index if no axis separates it."""
    fewest = len(members)
    for axis in _longest_first(places, members):
        middle = 0.0
        for v in members:
            middle += places[v, axis]
        middle /= len(members)
        for v in members:
            side[v] = HIGH if places[v, axis] > middle else LOW
        between, smaller = _separate(starts, neighbours, members, region, name, side)
        if between < fewest and smaller >= MIN_SIDE_SHARE * (len(members) - between):
            fewest = between
            for v in members:
                best[v] = side[v]
        if fewest <= GOOD_SEPARATOR_RATIO * np.sqrt(len(members)):
            return
    if fewest == len(members):
        for k in range(len(members)):
            best[members[k]] = HIGH if k >= len(members) // 2 else LOW
        _separate(starts, neighbours, members, region, name, best)


@compiled(inner=True)
def _longest_first(places, members):
    """Return the three axes, that of a region's largest extent first."""
    x, y, z = _extent(places, members, 0), _extent(places, members, 1), _extent(places, members, 2)
    if x >= y and x >= z:
        return (0, 1, 2) if y >= z else (0, 2, 1)
    if y >= z:
        return (1, 0, 2) if x >= z else (1, 2, 0)
    return (2, 0, 1) if x >= y else (2, 1, 0)


@compiled(inner=True)
def _extent(places, members, axis):
    low, high = np.inf, -np.inf
    for v in members:
        low, high = min(low, places[v, axis]), max(high, places[v, axis])
    return high - low


@compiled(inner=True)
def _separate(starts, neighbours, members, region, name, side):
    """Move the vertices of one side that touch the other side to the separator, from the side with fewer of them.

    Returns the sizes of the separator and of the smaller side that is left.
    """
    high = touching_low = touching_high = 0
    for v in members:
        if side[v] == HIGH:
            high += 1
            touching_high += _touches(starts, neighbours, v, region, name, side, LOW)
        else:
            touching_low += _touches(starts, neighbours, v, region, name, side, HIGH)
    fewer, touching = (LOW, touching_low) if touching_low <= touching_high else (HIGH, touching_high)
    for v in members:
        if side[v] == fewer and _touches(starts, neighbours, v, region, name, side, 1 - fewer):
            side[v] = SEPARATOR
    low = len(members) - high
    return touching, min(low - touching, high) if fewer == LOW else min(low, high - touching)


@compiled(inner=True)
def _touches(starts, neighbours, v, region, name, side, other):
    for entry in range(starts[v], starts[v + 1]):
        u = neighbours[entry]
        if region[u] == name and side[u] == other:
            return True
    return False
