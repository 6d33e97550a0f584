"""How a depth sensor stands, by the floor that it sees: tilted, rolled, at some height.

The floor is the largest plane that is about level and has next to nothing beneath it, which tells it from a table. It
is looked for by random sampling (RANSAC, M. Fischler and R. Bolles 1981) and then fitted to its points, each weighted
by how exact depth is there: the error of structured light grows with the square of the distance.
"""

import math
from collections import deque
from dataclasses import astuple

import numpy as np
from numpy.typing import NDArray

from capture.sensor_tilt import MIN_TILT_CHANGE, SensorTilt
from capture.trackers.picture import Lens, Picture

Floats = NDArray[np.float64]

STEEPEST = 45.0
"""Degrees of tilt or roll beyond which a plane is none that people stand on."""
LOWEST = 0.35
"""Metres; no sensor stands lower. A plane that is nearer joins what the sensor stands on to the floor behind it."""

_POINTS = 1500  # of a picture that are looked at, evenly spread
_TRIES = 200
_BANDS = 1.0, 0.6, 0.4, 0.4  # of the noise, fit by fit: less and less of the wall's foot is on the floor
_NOISE, _NOISE_SQUARED = 0.015, 0.001  # metres from the plane that are noise, at 0 m and with each square metre
_LEAST = 0.06  # of the points that must be on the floor
_BENEATH = 0.02  # of the points that may be beneath it: reflections
_AGREEING = 5  # measurements that must be about the same
_SAME = 1.0, 0.03  # degrees and metres between them that are noise
_FIRST, _LATER = 0.2, 1.0  # seconds between measurements, until the first result and from then on
_EXTENT = 0.6  # metres that the floor must extend both across and away: a strip tells no tilt


def find_floor(depth: NDArray[np.uint16], lens: Lens) -> SensorTilt | None:
    """Find the floor in a depth picture.

    Parameters
    ----------
    depth : (height, width) uint16
        Millimetres, 0 where unknown.
    lens : Lens

    Returns
    -------
    SensorTilt or None
        None where too little of it is seen.
    """
    points = _points(depth, lens)
    if len(points) < _POINTS * _LEAST:
        return None
    noise = _NOISE + _NOISE_SQUARED * points[:, 2] ** 2
    plane = _largest(points, noise)
    if plane is None:
        return None
    for band in _BANDS:
        on_it = np.abs(points @ plane[:3] + plane[3]) < band * noise
        if on_it.mean() < _LEAST:
            return None
        plane = _fitted(points[on_it], noise[on_it])
    if np.ptp(points[on_it][:, [0, 2]], axis=0).min() < _EXTENT:
        return None
    right, up, away, height = plane
    level = SensorTilt(math.degrees(math.asin(-away)), float(height), math.degrees(math.atan2(right, up)))
    return level if level.height >= LOWEST and max(abs(level.tilt), abs(level.roll)) <= STEEPEST else None


def _points(depth: NDArray[np.uint16], lens: Lens) -> Floats:
    """Return known points (n, 3) of a picture, metres, evenly spread."""
    step = max(1, round(math.sqrt(depth.size / _POINTS)))
    rows, columns = np.indices(depth.shape)[:, step // 2 :: step, step // 2 :: step]
    metres = depth[rows, columns] / 1000.0
    pixels = np.stack([columns, rows], axis=-1) + 0.5
    return lens.unproject(pixels, metres)[metres > 0]


def _largest(points: Floats, noise: Floats) -> Floats | None:
    """Return the level plane that most points are on: its normal upwards, its distance; None if there is none."""
    corners = points[np.random.default_rng(0).integers(len(points), size=(_TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0] * (np.sign(normals[lengths > 0, 1]) / lengths[lengths > 0])[:, None]
    heights = -np.einsum("tc,tc->t", normals, corners[lengths > 0, 0])
    level = (normals[:, 1] > math.cos(math.radians(STEEPEST))) & (heights > 0)
    normals, heights = normals[level], heights[level]
    above = points @ normals.T + heights
    count = (np.abs(above) < noise[:, None]).sum(axis=0)
    count[(above < -3 * noise[:, None]).mean(axis=0) > _BENEATH] = 0
    if not count.any():
        return None
    best = count.argmax()
    return np.array([*normals[best], heights[best]])


def _fitted(points: Floats, noise: Floats) -> Floats:
    """Return the plane that is nearest to points: the direction in which they are spread the least."""
    weights = noise**-2 / (noise**-2).sum()
    middle = weights @ points
    _, directions = np.linalg.eigh((points - middle).T * weights @ (points - middle))
    normal = directions[:, 0] * np.sign(directions[1, 0])
    return np.array([*normal, -normal @ middle])


class FloorWatch:
    """Says how a sensor stands once it is sure, and again when it stands otherwise."""

    def __init__(self) -> None:
        self._found: deque[SensorTilt] = deque(maxlen=_AGREEING)
        self._said: SensorTilt | None = None
        self._next = -math.inf

    def see(self, time: float, picture: Picture) -> SensorTilt | None:
        """Return how the sensor stands, if this picture makes it certain and it was not said before.

        Parameters
        ----------
        time : float
            Of the picture, seconds, later than that of the one before.
        picture : Picture
        """
        if picture.depth is None or time < self._next:
            return None
        self._next = time + (_FIRST if self._said is None else _LATER)
        found = find_floor(picture.depth, picture.lens)
        if found is None:
            return None
        self._found.append(found)
        middle = SensorTilt(*np.median([astuple(each) for each in self._found], axis=0).tolist())
        agreed = len(self._found) == _AGREEING and all(each.near(middle, *_SAME) for each in self._found)
        if not agreed or (self._said is not None and self._said.near(middle, *MIN_TILT_CHANGE)):
            return None
        self._said = middle
        return middle
