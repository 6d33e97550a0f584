"""Bodies in a mesh: what is a figure, and what it stands on or stands beside.

Recognition is by what things are. What a figure stands on is flat, wider than the feet, and under everything else. What
stands beside a figure, without touching it and without a twin on its other side, is another figure if it is as tall, or
an object. What touches a figure, or floats within it, belongs to it.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.anatomy import orientation
from solver.anatomy.axes import unit_vector
from solver.anatomy.orientation import FILE_UPS, sample
from solver.surface.mesh import SolverMesh
from solver.surface.near_points import connected_components

STILL = 0
"""Number of what is not a body: bases, floors and objects."""

SINK_SHARE = 0.02
"""Maximum depth by which feet sink into what they stand on, as a share of the figure's height."""

LEVEL_SHARE = 0.005
"""Maximum difference between the tops of parts of one base, as a share of the figure's height."""

FOOT_SHARE = 0.05
"""Height over a base, as a share of the figure's height, below which a figure's surface counts as its feet."""

MAX_BASE_HEIGHT = 0.5
"""Maximum height of a base, as a share of the figure's height."""

MIN_TOP_SHARE = 0.5
"""Minimum area of the flat top of a base, as a share of its outline."""

MIN_BASE_RATIO = 1.3
"""Minimum area of the outline of a base, as a ratio to that of the feet on it."""

FLAT_COSINE = 0.95
"""Minimum cosine between up and the normal of a flat top, on either side."""

MAX_OVERHANG = 0.1
"""Maximum share of the feet that is beside what they stand on."""

MIN_FIGURE_HEIGHT = 0.4
"""Minimum height of another figure, as a share of the height of the tallest."""

MIN_FIGURE_AREA = 0.02
"""Minimum surface of another figure, as a share of the largest surface."""

MIN_GAP = 0.02
"""Size of the cells in which parts are seen from above, as a share of the height. What stands beside a figure has an
empty cell between."""

SAMPLES_PER_CELL, MAX_SAMPLES = 4, 100_000
"""Mean number of surface points per cell, and maximum number of all."""

TWIN_DIFFERENCE = 0.02
"""Maximum difference between the areas of twins, as a share of the area."""

MIN_HEIGHT = 1e-6
"""Minimum height of what may stand, as a share of its extent."""


def find_bodies(mesh: SolverMesh, together: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
    """Return the number of the body of each vertex: from 1 in the order of the mesh, or `STILL`.

    Parameters
    ----------
    mesh : SolverMesh
    together : (n,) int64, optional
        Vertices with the same number belong to the same body, as those that a skeleton moves; −1 for others.
    """
    part = _joined(mesh, together)
    for axis in FILE_UPS if part.max() > 0 else ():
        up = unit_vector(axis)
        base = _base(mesh, part, up)
        standing = mesh.vertices[~base]
        if np.ptp(standing @ up) <= MIN_HEIGHT * np.ptp(standing, axis=0).max():
            continue
        floors = [float((mesh.vertices @ up).min())] + ([float((mesh.vertices[base] @ up).max())] if base.any() else [])
        bodies = np.full(len(part), STILL)
        bodies[~base] = _beside(mesh.only(~base), part[~base], up, floors)
        if (bodies != 1).any() and orientation.propose(mesh.only(bodies == 1)).up == axis:
            return bodies
    return np.ones(len(part), dtype=np.int64)


def _joined(mesh: SolverMesh, together: NDArray[np.int64] | None) -> NDArray[np.int64]:
    """Return the number (n,) of the part of each vertex; what belongs together is one part."""
    part = mesh.components.astype(np.int64)
    if together is None:
        return part
    tied = np.flatnonzero(together >= 0)
    firsts = tied[np.unique(together[tied], return_index=True)[1]]
    of_label = dict(zip(together[firsts].tolist(), part[firsts].tolist(), strict=True))
    others = np.array([of_label[label] for label in together[tied].tolist()], dtype=np.int64)
    return connected_components(mesh.parts, part[tied], others)[part].astype(np.int64)


def _base(mesh: SolverMesh, part: NDArray[np.int64], up: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which vertices (n,) are of a floor or a pedestal, and of what is below it."""
    height = mesh.vertices @ up
    count = int(part.max()) + 1
    bottoms, tops = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(bottoms, part, height)
    np.maximum.at(tops, part, height)
    faces, areas = _flat_faces(mesh, up)
    of_face = part[faces[:, 0]]
    in_part = np.bincount(of_face, areas, count)
    for top in _levels(tops):
        size = float(tops.max() - top)
        level = np.abs(tops - top) <= LEVEL_SHARE * size  # the tiles of a floor
        if not in_part[level].any():
            continue
        outline = _Outline(mesh.vertices[level[part]], up)
        is_top = level[of_face]
        is_top[is_top] = (height[faces[is_top]] > top - SINK_SHARE * size).all(axis=1)
        if areas[is_top].sum() < MIN_TOP_SHARE * outline.area:
            continue
        near = np.zeros(count, dtype=bool)
        near[part[outline.inside(mesh.vertices)]] = True
        base = near & (tops <= top + LEVEL_SHARE * size)
        above = near & ~base & (bottoms > top - SINK_SHARE * size)
        feet = mesh.vertices[above[part] & (height < top + FOOT_SHARE * size)]
        is_below = (base | above | ~near).all() and top - bottoms[base].min() < MAX_BASE_HEIGHT * size
        if is_below and len(feet) and _carries(mesh.vertices[faces[is_top]], outline, feet, up):
            return (base | (tops < bottoms[base].min() + SINK_SHARE * size))[part]
    return np.zeros(len(part), dtype=bool)


def _levels(tops: NDArray[np.float64]) -> Iterator[float]:
    """Yield the heights of the tops below the highest, downwards, one of those that are nearly the same."""
    highest = level = float(tops.max())
    for top in np.unique(tops)[-2::-1].tolist():
        if level - top > LEVEL_SHARE * (highest - level):
            level = top
            yield level


def _carries(
    surface: NDArray[np.float64], outline: "_Outline", feet: NDArray[np.float64], up: NDArray[np.float64]
) -> bool:
    """Return whether a surface (t, 3, 3) reaches around feet (k, 3), and between them, where shoes have none."""
    if outline.inside(feet).mean() < 1 - MAX_OVERHANG or outline.area < MIN_BASE_RATIO * _Outline(feet, up).area:
        return False
    middle = (feet.min(axis=0) + feet.max(axis=0)) / 2
    a, b, c = surface.transpose(1, 0, 2)
    sides = np.array([np.cross(q - p, middle - p) @ up for p, q in ((a, b), (b, c), (c, a))])
    return bool(((sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)).any())


def _flat_faces(mesh: SolverMesh, up: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the faces (t, 3) that are level, on either side, and their areas (t,), seen along an axis."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    along = np.abs(normals @ up)
    flat = along > FLAT_COSINE * np.linalg.norm(normals, axis=1)
    return mesh.faces[flat], along[flat] / 2


class _Outline:
    """The convex outline of points (k, 3), seen along an axis."""

    def __init__(self, points: NDArray[np.float64], up: NDArray[np.float64]) -> None:
        self._up, seen = up, _seen_along(up, points)
        size = max(float(np.ptp(points, axis=0).max()), 1e-12)
        corners = size * 1e-3 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])  # a line has an outline, too
        hull = scipy.spatial.ConvexHull((seen[_extreme(seen)][:, None] + corners).reshape(-1, 2))
        self.area = float(hull.volume)
        self._sides = hull.equations

    def inside(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (k, 3) are inside."""
        return np.asarray((_seen_along(self._up, points) @ self._sides[:, :2].T + self._sides[:, 2] <= 0).all(axis=1))


def _seen_along(axis: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the two coordinates (k, 2) of points (k, 3) across an axis."""
    return np.delete(points, int(np.abs(axis).argmax()), axis=1)


def _extreme(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the points that are farthest in one of 64 directions."""
    angles = np.arange(64) * np.pi / 32
    return np.unique((points @ np.array([np.cos(angles), np.sin(angles)])).argmax(axis=0))


def _beside(
    mesh: SolverMesh, part: NDArray[np.int64], up: NDArray[np.float64], floors: Sequence[float]
) -> NDArray[np.int64]:
    """Return the number (n,) of the body of each vertex of what stands on floors of some heights."""
    points, cluster = _clusters(mesh, part, up)
    of_vertex, count = cluster[: len(part)], int(cluster.max()) + 1
    area = np.bincount(of_vertex, mesh.vertex_areas, count)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, cluster, points @ up)
    np.maximum.at(high, cluster, points @ up)
    height, figure = high - low, int(area.argmax())
    stands = (np.abs(low[:, None] - floors) < FOOT_SHARE * height[:, None]).any(axis=1)
    if count == 1 or not stands[figure]:
        return np.ones(len(part), dtype=np.int64)  # its feet are parts of their own
    sums = np.stack([np.bincount(cluster, axis, count) for axis in _seen_along(up, points).T], axis=1)
    centers = sums / np.bincount(cluster)[:, None]
    apart = stands & ~_have_twins(area, centers - centers[figure])
    apart[figure] = True
    bodies = apart & (height > MIN_FIGURE_HEIGHT * height[figure]) & (area > MIN_FIGURE_AREA * area[figure])
    number = np.where(bodies, np.cumsum(bodies), STILL)
    of_body, loose = bodies[cluster], ~apart[cluster]
    tree = scipy.spatial.cKDTree(points[of_body])
    distance, near = (np.asarray(each) for each in tree.query(points[loose]))
    order = distance.argsort()[::-1]  # the nearest point of a cluster is the last one, which counts
    number[cluster[loose][order]] = number[cluster[of_body][near[order]]]
    return np.asarray(number[of_vertex])


def _clusters(
    mesh: SolverMesh, part: NDArray[np.int64], up: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (k, 3) of a mesh, first its vertices, and the cluster (k,) of each, in the order of the mesh.

    Parts of which one is above the other, or nearly, are one cluster.
    """
    cell = MIN_GAP * float(np.ptp(mesh.vertices @ up))
    area = float(mesh.vertex_areas.sum())
    spread, face = sample(mesh, min(int(SAMPLES_PER_CELL * area / cell**2), MAX_SAMPLES))
    points, of_point = np.concatenate([mesh.vertices, spread]), np.concatenate([part, part[mesh.faces[face, 0]]])
    grid = np.floor(_seen_along(up, points) / cell).astype(np.int64)
    grid -= grid.min(axis=0)
    shape = tuple(grid.max(axis=0) + 1)
    cells, inside = np.unique(np.ravel_multi_index(tuple(grid.T), shape), return_inverse=True)
    places = np.stack(np.unravel_index(cells, shape), axis=1)
    one, other = scipy.spatial.cKDTree(places).query_pairs(1.0, p=np.inf, output_type="ndarray").T
    count = int(part.max()) + 1
    a, b = np.concatenate([of_point, count + one]), np.concatenate([count + inside, count + other])
    label = connected_components(count + len(cells), a, b)[of_point]
    _, first, place = np.unique(label, return_index=True, return_inverse=True)
    return points, first.argsort().argsort()[place]


def _have_twins(area: NDArray[np.number], way: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which clusters (c,) have one of the same area on the other side of a figure, as legs have.

    Parameters
    ----------
    area : (c,) float
    way : (c, 2) float64
        From the middle of the figure to the middle of each, seen from above.
    """
    return np.array(
        [
            ((np.abs(area - own) < TWIN_DIFFERENCE * own) & (way @ to < 0)).any()
            for own, to in zip(area, way, strict=True)
        ]
    )
