"""Solid shapes as signed distances: negative inside, zero on the surface, positive outside.

A `Shape` is a function of points and a box that encloses its surface. Distances of the exact primitives are Euclidean;
those of `ellipsoid`, `stretch` and smooth combinations are close to Euclidean near the surface, which suffices for
meshing. Blends are the quadratic polynomial smooth minimum: the surfaces of two shapes blend where they are closer than
`blend`, and are exact elsewhere.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from puppetline.compiled import compiled

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shape:
    """A solid.

    Parameters
    ----------
    distance : callable
        Points (n, 3) to signed distances (n,).
    low, high : (3,) float64
        Corners of a box that encloses the solid.
    """

    distance: Callable[[Array], Array]
    low: Array
    high: Array

    def within(self, points: Array, reach: Array) -> NDArray[np.intp]:
        """Return the indices of points in the box or less than `reach` (n,) away; all others are farther away."""
        is_near = np.empty(len(points), np.bool_)
        _near(np.ascontiguousarray(points), self.low, self.high, reach, is_near)
        return np.flatnonzero(is_near)


@compiled
def _near(points: Array, low: Array, high: Array, reach: Array, result: NDArray[np.bool_]) -> None:
    """Tell of each point whether it is in a box or less than its reach away."""
    for i in range(len(points)):
        square = 0.0
        for k in range(3):
            beyond = max(low[k] - points[i, k], points[i, k] - high[k], 0.0)
            square += beyond * beyond
        result[i] = square == 0.0 or (reach[i] > 0.0 and square < reach[i] * reach[i])


def _round_cones(points: Array, a: Array, b: Array, radius_a: Array, radius_b: Array) -> Array:
    """Distance to the nearest of several round cones (see `round_cone`)."""
    axis = b - a
    length = np.sqrt((axis * axis).sum(axis=1))
    slope = (radius_a - radius_b) / length
    steepness = np.minimum(np.maximum(slope, -0.999), 0.999)
    shift = steepness / np.sqrt(1.0 - steepness * steepness)
    axis /= length.reshape(-1, 1)
    result = np.full(len(points), np.inf)
    _nearest_cone(points, a, axis, length, shift, slope, radius_a, result)
    return result


@compiled
def _nearest_cone(
    points: Array, a: Array, axis: Array, length: Array, shift: Array, slope: Array, radius_a: Array, result: Array
) -> None:
    """Lower each distance to that of the nearest cone."""
    for i in range(len(points)):
        for j in range(len(a)):
            x, y, z = points[i, 0] - a[j, 0], points[i, 1] - a[j, 1], points[i, 2] - a[j, 2]
            height = x * axis[j, 0] + y * axis[j, 1] + z * axis[j, 2]
            off = np.sqrt(max(x * x + y * y + z * z - height * height, 0.0))
            nearest = min(max(height - shift[j] * off, 0.0), length[j])
            distance = np.hypot(off, height - nearest) - radius_a[j] + slope[j] * nearest
            result[i] = min(result[i], distance)


def turn(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """Rotation matrix (3, 3) about x, then y, then z, by angles in degrees, for column vectors."""
    matrix = np.eye(3)
    for axis, angle in enumerate(np.radians([x, y, z])):
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        step = np.eye(3)
        step[[i, j], [i, j]] = np.cos(angle)
        step[i, j], step[j, i] = -np.sin(angle), np.sin(angle)
        matrix = step @ matrix
    return matrix


def smooth_minimum(a: Array, b: Array, blend: float) -> Array:
    """Minimum of two distances, lowered by at most blend / 4 where they differ by less than `blend`."""
    if blend == 0.0:
        return np.minimum(a, b)
    overlap = np.maximum(blend - np.abs(a - b), 0.0)
    return np.minimum(a, b) - overlap * overlap / (4.0 * blend)


def sphere(center: ArrayLike, radius: float) -> Shape:
    """Ball; exact."""
    c = np.asarray(center, float)
    return Shape(lambda p: np.linalg.norm(p - c, axis=1) - radius, c - radius, c + radius)


def ellipsoid(center: ArrayLike, radii: ArrayLike, rotation: Array | None = None) -> Shape:
    """Ellipsoid with semi-axes `radii` along the columns of `rotation`; distance to first order near the surface."""
    c, r = np.asarray(center, float), np.asarray(radii, float)
    axes = np.eye(3) if rotation is None else rotation

    def distance(p: Array) -> Array:
        unit = (p - c) @ axes / r
        k = np.linalg.norm(unit, axis=1)
        gradient = np.maximum(np.linalg.norm(unit / r, axis=1), 1e-12)
        return np.where(k > 1e-6, k * (k - 1.0) / gradient, -r.min())

    reach = np.sqrt(np.square(axes * r).sum(axis=1))
    return Shape(distance, c - reach, c + reach)


def round_cone(a: ArrayLike, b: ArrayLike, radius_a: float, radius_b: float) -> Shape:
    """Hull of two balls (a capsule where the radii agree); exact.

    Every point of the hull belongs to a ball whose centre lies on the axis; the nearest such ball is found in closed
    form, then clamped to the two ends.
    """
    return tube([(*np.asarray(a, float), radius_a), (*np.asarray(b, float), radius_b)], samples=1)


def torus(center: ArrayLike, axis: ArrayLike, ring: float, radius: float) -> Shape:
    """Ring of radius `ring` around `axis`, its tube of radius `radius`; exact."""
    c, n = np.asarray(center, float), np.asarray(axis, float)
    n = n / np.linalg.norm(n)

    def distance(p: Array) -> Array:
        local = p - c
        height = local @ n
        off = np.sqrt(np.maximum(np.einsum("ij,ij->i", local, local) - height * height, 0.0))
        return np.hypot(off - ring, height) - radius

    reach = ring * np.sqrt(1.0 - n * n) + radius
    return Shape(distance, c - reach, c + reach)


def rounded_box(center: ArrayLike, half: ArrayLike, radius: float, rotation: Array | None = None) -> Shape:
    """Box with semi-axes `half` along the columns of `rotation`, its edges rounded by `radius`; exact."""
    c, h = np.asarray(center, float), np.asarray(half, float)
    axes = np.eye(3) if rotation is None else rotation

    def distance(p: Array) -> Array:
        q = np.abs((p - c) @ axes) - (h - radius)
        return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - radius

    reach = np.abs(axes) @ h
    return Shape(distance, c - reach, c + reach)


def blade(
    a: ArrayLike, b: ArrayLike, width_a: float, width_b: float, normal: ArrayLike, thickness: float, radius: float
) -> Shape:
    """Flat tapered strip from a to b, like a feather or a plate: a round cone cut to `thickness` along `normal`."""
    start, end = np.asarray(a, float), np.asarray(b, float)
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    up = np.asarray(normal, float)
    up = up - (up @ along) * along
    up /= np.linalg.norm(up)
    across = np.cross(up, along)
    outline = round_cone([0, 0, 0], [length, 0, 0], width_a - radius, width_b - radius)

    def distance(p: Array) -> Array:
        local = p - start
        flat = np.stack([local @ along, local @ across, np.zeros(len(p))], axis=1)
        q = np.stack([outline.distance(flat), np.abs(local @ up) - (thickness / 2 - radius)], axis=1)
        return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - radius

    reach_a, reach_b = (
        width * np.sqrt(along**2 + across**2) + thickness / 2 * np.abs(up) for width in (width_a, width_b)
    )
    return Shape(distance, np.minimum(start - reach_a, end - reach_b), np.maximum(start + reach_a, end + reach_b))


def union(shapes: Sequence[Shape], blend: float = 0.0) -> Shape:
    """Return the union of shapes, blended in order."""

    def distance(p: Array) -> Array:
        total = shapes[0].distance(p)
        for shape in shapes[1:]:
            near = shape.within(p, total + blend)
            total[near] = smooth_minimum(total[near], shape.distance(p[near]), blend)
        return total

    low, high = np.min([s.low for s in shapes], axis=0), np.max([s.high for s in shapes], axis=0)
    return Shape(distance, low - blend / 4, high + blend / 4)


def subtract(shape: Shape, tool: Shape, blend: float = 0.0) -> Shape:
    """Return a shape without the tool."""
    return Shape(lambda p: -smooth_minimum(-shape.distance(p), tool.distance(p), blend), shape.low, shape.high)


def intersect(shape: Shape, other: Shape, blend: float = 0.0) -> Shape:
    """Return the intersection of two shapes."""

    def distance(p: Array) -> Array:
        return -smooth_minimum(-shape.distance(p), -other.distance(p), blend)

    return Shape(distance, np.maximum(shape.low, other.low), np.minimum(shape.high, other.high))


def curve(points: ArrayLike, samples: int) -> Array:
    """Catmull-Rom spline through points (m, k), `samples` steps from each to the next: ((m − 1) samples + 1, k)."""
    p = np.asarray(points, float)
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    t = (np.arange(samples) / samples)[:, None]
    pieces = [
        0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
        for a, b, c, d in zip(p[:-3], p[1:-2], p[2:-1], p[3:], strict=True)
    ]
    return np.concatenate([*pieces, p[-2:-1]])


def tube(points: ArrayLike, samples: int = 4) -> Shape:
    """Round limb along a spline through rows (x, y, z, radius)."""
    stations = curve(points, samples)
    ends, radii = np.ascontiguousarray(stations[:, :3]), np.ascontiguousarray(stations[:, 3])

    def distance(p: Array) -> Array:
        return _round_cones(p, ends[:-1], ends[1:], radii[:-1], radii[1:])

    return Shape(distance, (ends - radii[:, None]).min(axis=0), (ends + radii[:, None]).max(axis=0))


HALF_SPACE_METRES = 100.0
"""Distance from its point up to which a half-space reaches."""


def half_space(point: ArrayLike, normal: ArrayLike) -> Shape:
    """Half-space behind a plane, up to `HALF_SPACE_METRES` from its point."""
    c, n = np.asarray(point, float), np.asarray(normal, float)
    n = n / np.linalg.norm(n)
    return Shape(lambda p: (p - c) @ n, c - HALF_SPACE_METRES, c + HALF_SPACE_METRES)


def mirror(shape: Shape) -> Shape:
    """Return the shape on the character's left (x > 0) and its mirror image on the right."""

    def distance(p: Array) -> Array:
        return shape.distance(np.column_stack([np.abs(p[:, 0]), p[:, 1:]]))

    reach = max(shape.high[0], -shape.low[0])
    return Shape(distance, np.array([-reach, *shape.low[1:]]), np.array([reach, *shape.high[1:]]))


def stretch(shape: Shape, factors: ArrayLike, center: ArrayLike) -> Shape:
    """Return the shape scaled by one factor per axis about a centre; distances are scaled by the smallest factor."""
    f, c = np.asarray(factors, float), np.asarray(center, float)
    return Shape(lambda p: shape.distance((p - c) / f + c) * f.min(), (shape.low - c) * f + c, (shape.high - c) * f + c)


def move(
    shape: Shape, rotation: Array, center: ArrayLike = (0.0, 0.0, 0.0), offset: ArrayLike = (0.0, 0.0, 0.0)
) -> Shape:
    """Return the shape turned by `rotation` about a centre, then shifted by `offset`."""
    c, o = np.asarray(center, float), np.asarray(offset, float)
    middle, half = (shape.low + shape.high) / 2, (shape.high - shape.low) / 2
    at = rotation @ (middle - c) + c + o
    reach = np.abs(rotation) @ half
    return Shape(lambda p: shape.distance((p - c - o) @ rotation + c), at - reach, at + reach)


def displace(shape: Shape, height: Callable[[Array], Array], amplitude: float) -> Shape:
    """Return the shape with its surface raised by height(points), whose absolute value is at most `amplitude`."""
    return Shape(lambda p: shape.distance(p) - height(p), shape.low - amplitude, shape.high + amplitude)
