"""Edges of triangle meshes, and consistent winding of their manifold patches.

A *patch* is a set of triangles connected at edges of exactly two triangles.
"""

import numpy as np
from numpy.typing import NDArray

from solver.surface.near_points import connected_components

MIN_VOLUME_RATIO = 1e-6
"""Smallest volume of a patch with an inside, divided by the area to the power of 3/2. A two-sided leaf has none."""

MIN_AGREEING_AREA_SHARE = 0.75
"""Smallest share of an open patch's area with the same winding for which the file's winding is kept."""


def distinct_rows(rows: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find distinct rows.

    Parameters
    ----------
    rows : (r, k) int

    Returns
    -------
    first : (n,) int64
        Index of the first row of each kind; kinds are sorted lexicographically.
    kind : (r,) int64
        Kind of each row, as an index into `first`.
    """
    order = np.lexsort(rows.T[::-1])
    new = np.ones(len(rows), dtype=np.bool_)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    kind = np.empty(len(rows), dtype=np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


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
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    count = int(faces.max(initial=0)) + 1
    keys, of_side, faces_of_edge = np.unique(sides[:, 0] * count + sides[:, 1], return_inverse=True, return_counts=True)
    return np.column_stack(np.divmod(keys, count)), of_side, faces_of_edge


def pieces(of_side: NDArray[np.int64], edges: int) -> NDArray[np.int32]:
    """Find the pieces of a surface that are connected at edges.

    Parameters
    ----------
    of_side : (3t,) int64
        From `edges_of`.
    edges : int
        Number of edges.

    Returns
    -------
    (t,) int32
        Piece of each face, numbered from 0 in the order of their first faces.
    """
    t = len(of_side) // 3
    return connected_components(t + edges, np.repeat(np.arange(t), 3), t + of_side)[:t]


def flipped_faces(faces: NDArray[np.int64], chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return (t, 3) faces with the winding of the chosen ones reversed."""
    turned = faces.copy()
    turned[chosen] = faces[chosen, ::-1]
    return turned


def wound_against(
    faces: NDArray[np.int64], of_side: NDArray[np.int64], faces_of_edge: NDArray[np.int64]
) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
    """Return which faces (t,) are wound against the first one of their patch, and each face's patch (t,).

    Each face has two sheets, its front and its back. At an edge of two faces, the front of one continues in the front
    of the other if they pass the edge in opposite directions, and in its back otherwise. If a patch has one side only,
    the front of a face continues in its back.
    """
    t = len(faces)
    order = np.argsort(of_side, kind="stable")
    one, other = order[faces_of_edge[of_side[order]] == 2].reshape(-1, 2).T
    crossed = faces.ravel()[one] == faces.ravel()[other]  # both pass the edge in one direction
    one, other = one // 3, other // 3
    patch = connected_components(t, one, other)
    if not crossed.any():
        return np.zeros(t, dtype=np.bool_), patch
    continued = np.concatenate([np.where(crossed, other + t, other), np.where(crossed, other, other + t)])
    sheets = connected_components(2 * t, np.concatenate([one, one + t]), continued)
    front, back = sheets[:t], sheets[t:]
    first = np.unique(patch, return_index=True)[1]
    return (front != front[first[patch]]) & (front != back), patch


def wound_outwards(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Flip faces so that neighbours agree on the outside, patch by patch.

    A closed patch, whose faces pass each edge equally often in both directions, faces outwards, by the sign of its
    enclosed volume. An open patch keeps the winding that most
    of its area has in the file. If the file's winding is mixed (`MIN_AGREEING_AREA_SHARE`), the convex side is the
    outside.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (t, 3) int64
        With three different corners each.

    Returns
    -------
    (t, 3) int64
    """
    _, of_side, faces_of_edge = edges_of(faces)
    against, patch = wound_against(faces, of_side, faces_of_edge)
    wound = flipped_faces(faces, against)
    area, agreeing, volume = measures(vertices, wound, patch, ~against)
    undecided = np.abs(agreeing / area - 0.5) < MIN_AGREEING_AREA_SHARE - 0.5
    outer = np.flatnonzero(faces_of_edge[of_side] != 2)
    first, edge = distinct_rows(np.column_stack([patch[outer // 3], of_side[outer]]))
    passes = np.bincount(edge, np.sign(np.roll(wound, -1, axis=1) - wound).ravel()[outer])
    closed = np.ones(len(area), dtype=bool)
    closed[patch[outer[first[passes != 0]] // 3]] = False
    by_volume = (closed | undecided) & (np.abs(volume) > MIN_VOLUME_RATIO * area**1.5)
    inside_out = np.where(by_volume, volume < 0, agreeing < 0.5 * area)
    return flipped_faces(faces, against ^ inside_out[patch])


def measures(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], patch: NDArray[np.int32], chosen: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Measure each of p patches.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (t, 3) int64
        At least one.
    patch : (t,) int32
    chosen : (t,) bool

    Returns
    -------
    area, chosen_area : (p,) float64
        Area of all faces, and of the chosen ones.
    volume : (p,) float64
        Volume between the patch and its centroid, negative if the inside is outside.
    """
    a, b, c = (vertices[corner] - vertices[faces[0, 0]] for corner in faces.T)
    middle, normal = (a + b + c) / 3, np.cross(b - a, c - a) / 2
    size = np.linalg.norm(normal, axis=1)

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(patch, values).astype(np.float64)

    area = total(size)
    center = np.column_stack([total(size * axis) for axis in middle.T]) / np.maximum(area, 1e-300)[:, None]
    volume = np.einsum("tx,tx->t", middle - center[patch], normal) / 3
    return area, total(size * chosen), total(volume)
