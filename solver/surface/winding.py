"""Edges of triangle meshes, and consistent winding of their manifold patches.

A *patch* is a set of triangles connected at edges of exactly two triangles.
"""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.surface.disjoint_sets import join, number_sets

MIN_VOLUME_RATIO = 1e-6
"""Smallest volume, divided by the area to the power of 3/2, of a patch that has an inside."""

MAX_INSERTION_LENGTH = 32
"""Largest number of items that are sorted by insertion."""

MIN_AGREEING_AREA_SHARE = 0.75
"""Smallest share of an open patch's area with the same winding for which the file's winding is kept."""


def lexicographic_order(rows: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Sort rows of indices lexicographically, in linear time.

    Parameters
    ----------
    rows : (r, k) int64
        From 0 to `count` − 1.

    Returns
    -------
    (r,) int64
        Equal rows keep their order.
    """
    order = np.arange(len(rows))
    for column in reversed(range(rows.shape[1])):
        order = _by_key(np.ascontiguousarray(rows[:, column]), order, count)
    return order


@compiled
def _by_key(keys, items, count):
    """Sort items by their keys: a counting sort."""
    place = np.zeros(count + 1, dtype=np.int64)
    for item in items:
        place[keys[item] + 1] += 1
    for key in range(count):
        place[key + 1] += place[key]
    result = np.empty_like(items)
    for item in items:
        result[place[keys[item]]] = item
        place[keys[item]] += 1
    return result


def edges_of(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Find the edges of faces.

    Parameters
    ----------
    faces : (t, 3) int64

    Returns
    -------
    edges : (e, 2) int64
        The smaller index first, in ascending order.
    of_side : (3t,) int64
        The edge of each side of each face; a face's first side is between its first and second corner.
    faces_of_edge : (e,) int64
        Number of faces at each edge.
    """
    return _edges(np.ascontiguousarray(faces), int(faces.max(initial=-1)) + 1)


@compiled
def _edges(faces, count):
    """Sort the sides of faces by their smaller ends, and those of each smaller end by the larger ones."""
    starts = np.zeros(count + 1, dtype=np.int64)
    for side in range(3 * len(faces)):
        start, end = faces[side // 3, side % 3], faces[side // 3, (side + 1) % 3]
        starts[min(start, end) + 1] += 1
    for v in range(count):
        starts[v + 1] += starts[v]
    place, larger, side_at = starts[:-1].copy(), np.empty(starts[-1], np.int64), np.empty(starts[-1], np.int64)
    for side in range(3 * len(faces)):
        start, end = faces[side // 3, side % 3], faces[side // 3, (side + 1) % 3]
        v = min(start, end)
        larger[place[v]], side_at[place[v]] = max(start, end), side
        place[v] += 1
    distinct, number, times = np.empty((starts[-1], 2), np.int64), np.empty_like(larger), np.zeros_like(larger)
    last = -1
    for v in range(count):
        first, stop = starts[v], starts[v + 1]
        _sort_pairs(larger[first:stop], side_at[first:stop])
        for here in range(first, stop):
            if here == first or larger[here] != larger[here - 1]:
                last += 1
                distinct[last, 0], distinct[last, 1] = v, larger[here]
            number[side_at[here]] = last
            times[last] += 1
    return distinct[: last + 1].copy(), number, times[: last + 1].copy()


@compiled
def _sort_pairs(keys, values):
    """Sort keys, in place, and their values with them; equal keys keep their order."""
    if len(keys) > MAX_INSERTION_LENGTH:
        order = np.argsort(keys, kind="mergesort")
        keys[:], values[:] = keys[order], values[order]
        return
    for i in range(1, len(keys)):
        key, value, j = keys[i], values[i], i
        while j > 0 and keys[j - 1] > key:
            keys[j], values[j] = keys[j - 1], values[j - 1]
            j -= 1
        keys[j], values[j] = key, value


@compiled
def pieces(of_side, edges):
    """Find the pieces of a surface that are connected at edges.

    Parameters
    ----------
    of_side : (3t,) int64
        From `edges_of`.
    edges : int
        Number of edges.

    Returns
    -------
    (t,) int64
        Piece of each face, numbered from 0 in the order of their first faces.
    """
    t = len(of_side) // 3
    piece, first = np.arange(t), np.full(edges, -1)
    for side in range(3 * t):
        edge = of_side[side]
        if first[edge] < 0:
            first[edge] = side // 3
        join(piece, side // 3, first[edge])
    number_sets(piece)
    return piece


def wound_consistently(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Wind the triangles of each patch like its first one.

    Time and memory are linear in the number of triangles, however many of them share an edge; those of
    `igl.bfs_orient` are quadratic.

    Parameters
    ----------
    faces : (t, 3) int64
        With three different corners each.

    Returns
    -------
    wound : (t, 3) int64
        Triangles of a patch with one side only, such as a Möbius strip, are not changed.
    patch : (t,) int64
        Patch of each triangle, numbered from 0 in the order of their first triangles.
    """
    _, of_side, faces_of_edge = edges_of(faces)
    against, patch = _against(np.ascontiguousarray(faces), of_side, faces_of_edge)
    return flipped_faces(faces, against), patch


def flipped_faces(faces: NDArray[np.int64], chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return (t, 3) faces with the winding of the chosen ones reversed."""
    turned = faces.copy()
    turned[chosen] = faces[chosen, ::-1]
    return turned


@compiled
def _against(faces, of_side, faces_of_edge):
    """Return which faces are wound against the first one of their patch, and each face's patch."""
    t = len(faces)
    across = _across(of_side, faces_of_edge)
    against, patch = np.zeros(t, dtype=np.bool_), np.full(t, -1)
    has_one_side = np.zeros(t, dtype=np.bool_)
    stack, found = np.empty(t, dtype=np.int64), 0
    for seed in range(t):
        if patch[seed] >= 0:
            continue
        patch[seed], stack[0], top = found, seed, 1
        while top:
            top -= 1
            face = stack[top]
            for side in range(3 * face, 3 * face + 3):
                other = across[side]
                if other < 0:
                    continue
                crossed = faces[face, side % 3] == faces[other // 3, other % 3]  # both pass the edge in one direction
                turned = against[face] != crossed
                if patch[other // 3] < 0:
                    patch[other // 3], against[other // 3] = found, turned
                    stack[top] = other // 3
                    top += 1
                elif against[other // 3] != turned:
                    has_one_side[found] = True
        found += 1
    for face in range(t):
        against[face] &= not has_one_side[patch[face]]
    return against, patch


@compiled
def _across(of_side, faces_of_edge):
    """Return the opposite side of each side at an edge of two faces, −1 elsewhere."""
    across, first = np.full(len(of_side), -1), np.full(len(faces_of_edge), -1)
    for side in range(len(of_side)):
        edge = of_side[side]
        if faces_of_edge[edge] == 2:
            if first[edge] < 0:
                first[edge] = side
            else:
                across[side], across[first[edge]] = first[edge], side
    return across


def wound_outwards(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    sides: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None,
) -> NDArray[np.int64]:
    """Flip faces so that neighbours agree on the outside, patch by patch.

    A closed patch faces outwards, by the sign of its enclosed volume. An open patch keeps the winding that most
    of its area has in the file. If the file's winding is mixed (`MIN_AGREEING_AREA_SHARE`), the convex side is the
    outside.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (t, 3) int64
        With three different corners each.
    sides : tuple, optional
        `of_side` and `faces_of_edge` from `edges_of`, if they are known.

    Returns
    -------
    (t, 3) int64
    """
    of_side, faces_of_edge = sides or edges_of(faces)[1:]
    against, patch = _against(np.ascontiguousarray(faces), of_side, faces_of_edge)
    count = int(patch.max(initial=-1)) + 1
    area, agreeing, volume = _measures(vertices, flipped_faces(faces, against), patch, count, ~against)
    borders = np.bincount(patch[np.flatnonzero(faces_of_edge[of_side] != 2) // 3], minlength=count)
    undecided = np.abs(agreeing / area - 0.5) < MIN_AGREEING_AREA_SHARE - 0.5
    by_volume = ((borders == 0) | undecided) & (np.abs(volume) > MIN_VOLUME_RATIO * area**1.5)
    inside_out = np.where(by_volume, volume < 0, agreeing < 0.5 * area)
    return flipped_faces(faces, against ^ inside_out[patch])


@compiled
def _measures(vertices, faces, patch, count, chosen):
    """Return the area of each patch, that of its chosen faces, and the volume between it and its centroid."""
    t = len(faces)
    middle, normal = np.empty((t, 3)), np.empty((t, 3))
    area, agreeing, volume, center = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros((count, 3))
    origin = vertices[faces[0, 0]].copy()
    for f in range(t):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        size = 0.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            middle[f, x] = ((a[x] - origin[x]) + (b[x] - origin[x]) + (c[x] - origin[x])) / 3
            normal[f, x] = ((b[y] - a[y]) * (c[z] - a[z]) - (b[z] - a[z]) * (c[y] - a[y])) / 2
            size += normal[f, x] ** 2
        size = np.sqrt(size)
        area[patch[f]] += size
        agreeing[patch[f]] += size * chosen[f]
        for x in range(3):
            center[patch[f], x] += size * middle[f, x]
    for f in range(t):
        for x in range(3):
            volume[patch[f]] += (middle[f, x] - center[patch[f], x] / area[patch[f]]) * normal[f, x] / 3
    return area, agreeing, volume
