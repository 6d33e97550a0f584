"""Bodies that grow along limbs: unions of ellipsoids, divided into cells; for `benchmarks.made_bodies`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from solver.anatomy.part_network import PARTS

CELLS_PER_AXIS = 88
"""Number of cells along the longest axis."""

MIN_THICKNESS = 0.9
"""Minimum radius of an ellipsoid, in cells."""

Points = NDArray[np.float64]
SIDES = (1.0, -1.0)


@dataclass
class Body:
    """A body that is being made; its coordinates are left, up and front, and it is about 1 high or long.

    Attributes
    ----------
    rng : numpy.random.Generator
    limbs : list of (int, array)
        Number of the part in `PARTS`, and four joints from root to tip.
    grown : list of (int, array, array, array)
        Ellipsoids: limb, centre, axes as rows, radii.
    """

    rng: np.random.Generator
    limbs: list[tuple[int, Points]] = field(default_factory=list)
    grown: list[tuple[int, Points, Points, Points]] = field(default_factory=list)

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def happens(self, chance: float) -> bool:
        return bool(self.rng.random() < chance)

    def limb(self, part: str, joints: ArrayLike, radii: Sequence[float], flat: float = 1.0) -> int:
        """Add a limb with radii at equal distances; a flat one is thin along up. Return its number."""
        points, number = np.asarray(joints, float), len(self.limbs)
        self.limbs.append((PARTS.index(part), points))
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        count = int(np.clip(1.5 * along[-1] / (min(radii) + 0.02), 14, 60))
        for share in np.linspace(0, 1, count):
            center = np.array([np.interp(share * along[-1], along, axis) for axis in points.T])
            radius = float(np.interp(share, np.linspace(0, 1, len(radii)), radii))
            row = min(int(share * len(lengths)), len(lengths) - 1)
            self.blob(number, center, radius * np.array([flat, 1.0, 1.0]), _axes(points[row + 1] - points[row]))
        return number

    def blob(self, limb: int, center: ArrayLike, radii: ArrayLike, axes: Points | None = None) -> None:
        """Add an ellipsoid to a limb."""
        axes = np.eye(3) if axes is None else axes
        self.grown.append((limb, np.asarray(center, float), axes, np.broadcast_to(np.asarray(radii, float), 3)))

    def widen(self, limb: int, factors: ArrayLike) -> None:
        """Stretch what has grown on a limb."""
        self.grown = [(own, *where, radii * factors if own == limb else radii) for own, *where, radii in self.grown]


def _axes(way: Points) -> Points:
    """Return axes as rows: up without its share along a way, to the side, along the way."""
    along = way / np.linalg.norm(way)
    up = np.array([0.0, 1.0, 0.1])
    across = up - along * (up @ along)
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(along, across), along])


def chain(root: ArrayLike, ways: Sequence[ArrayLike], lengths: Sequence[float]) -> Points:
    """Return the joints of a limb whose bones point along ways."""
    points = [np.asarray(root, float)]
    for way, length in zip(ways, lengths, strict=True):
        vector = np.asarray(way, float)
        points.append(points[-1] + vector / np.linalg.norm(vector) * length)
    return np.array(points)


def straight(start: ArrayLike, end: ArrayLike) -> Points:
    return np.linspace(np.asarray(start, float), np.asarray(end, float), 4)


def trunk(body: Body, low: ArrayLike, high: ArrayLike, radius: float) -> int:
    factors = [(0.7, 1.1), (0.8, 1.15), (0.8, 1.15), (0.6, 1.05)]
    return body.limb("trunk", straight(low, high), [radius * body.between(*each) for each in factors])


def head(body: Body, root: ArrayLike, way: ArrayLike, length: float, radius: float) -> tuple[int, Points]:
    joints = chain(root, [way] * 3, [length / 3] * 3)
    return body.limb("head", joints, [0.6 * radius, radius, radius, 0.6 * radius]), joints


def neck(body: Body, root: Points, way: Points, length: float, radii: Sequence[float]) -> Points:
    """Add a neck, and return its end."""
    joints = chain(root, [way] * 3, [length / 3] * 3)
    body.limb("head", joints, radii)
    return np.asarray(joints[-1])


def leg(body: Body, root: ArrayLike, foot: ArrayLike, knee: ArrayLike, radius: float, toes: ArrayLike) -> int:
    hip, ankle = np.asarray(root, float), np.asarray(foot, float)
    joints = [hip, (hip + ankle) / 2 + knee, ankle, ankle + toes]
    factors = [body.between(1, 1.5), 1.0, body.between(0.6, 0.9), body.between(0.6, 1.1)]
    return body.limb("leg", joints, [radius * each for each in factors])


def tail(body: Body, root: ArrayLike, way: ArrayLike, length: float, radii: tuple[float, float], curl: float) -> Points:
    """Add a tail, and return its end."""
    ways, bend = [np.asarray(way, float)], curl * body.rng.normal(0, 1, 3) * [0.3, 1.0, 0.0]
    for _ in range(2):
        ways.append(ways[-1] / np.linalg.norm(ways[-1]) + 0.4 * bend)
    joints = chain(root, ways, [length / 3] * 3)
    body.limb("tail", joints, np.linspace(*radii, 4).tolist())
    return np.asarray(joints[-1])


def wing(body: Body, root: ArrayLike, span: float, chord: float, ways: Sequence[ArrayLike], flat: float) -> None:
    radii = [0.5 * chord, chord, 0.9 * chord, 0.35 * chord]
    body.limb("wing", chain(root, ways, [0.3 * span, 0.35 * span, 0.35 * span]), radii, flat)


def ears(body: Body, limb: int, top: Points, radius: float, length: float) -> None:
    for side in SIDES:
        root = top + np.array([side * radius * body.between(0.5, 0.9), 0, 0])
        for share in np.linspace(0, 1, 6):
            body.blob(limb, root + length * share * np.array([0.3 * side, 1, 0]), 0.3 * radius * (1.1 - share))


def horns(body: Body, limb: int, top: Points, radius: float) -> None:
    """Add horns or antlers to a head."""
    length, way = radius * body.between(0.8, 3), np.array([body.between(0.3, 1.5), 1, body.between(-0.8, 0.4)])
    branched, thick = body.happens(0.5), radius * body.between(0.08, 0.25)
    for side in SIDES:
        image = np.array([side, 1, 1])
        for share in np.linspace(0, 1, 12):
            place = top + length * share * way / np.linalg.norm(way) * image
            body.blob(limb, place, thick * (1.1 - 0.7 * share))
            if branched and share > 0.3:
                body.blob(limb, place + length * np.array([0, 0.15, 0.15]), thick * np.array([0.5, 1.2, 1.2]))


def cells(body: Body) -> tuple[Points, Points, NDArray[np.int64]]:
    """Return the cells inside a body, their depths, and the limb of each; the surface is a little rough.

    Returns
    -------
    cells : (n, 3) float64
    depths : (n,) float64
    limbs : (n,) int64
    """
    reach = np.array([radii.max() for *_, radii in body.grown])[:, None]
    centers = np.array([center for _, center, _, _ in body.grown])
    low, high = (centers - reach).min(axis=0), (centers + reach).max(axis=0)
    size = float((high - low).max()) / CELLS_PER_AXIS
    low -= 2 * size
    shape = np.ceil((high - low) / size).astype(int) + 3
    away, limbs = np.full(shape, np.inf), np.zeros(shape, dtype=np.int64)
    for limb, box, distance in _distances(body, low, size, shape):
        nearer = distance < away[box]
        away[box][nearer], limbs[box][nearer] = distance[nearer], limb
    rough = ndimage.gaussian_filter(body.rng.normal(size=shape), 5)
    inside = ndimage.binary_fill_holes(away + rough / rough.std() * size * body.rng.uniform(0, 1.2) < 0)
    depths = (ndimage.distance_transform_edt(inside) - 0.5) * size
    return np.argwhere(inside) * size + low, depths[inside], limbs[inside]


def _distances(
    body: Body, low: Points, size: float, shape: NDArray[np.int64]
) -> Iterator[tuple[int, tuple[slice, ...], Points]]:
    """Yield each ellipsoid's limb, the cells around it, and their approximate distances from its surface."""
    for limb, center, axes, radii in body.grown:
        reach = radii.max() + 2 * size
        first = np.maximum(((center - reach - low) / size).astype(int), 0)
        last = np.minimum(((center + reach - low) / size).astype(int) + 2, shape)
        box = tuple(slice(*each) for each in zip(first, last, strict=True))
        cells = np.stack(np.mgrid[box], axis=-1) * size + low - center
        thick = np.maximum(radii, MIN_THICKNESS * size)
        yield limb, box, (np.linalg.norm(cells @ axes.T / thick, axis=-1) - 1) * thick.min()
