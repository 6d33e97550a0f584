"""Tilt, roll and height of a depth sensor, from the floor that it sees.

The floor is the largest plane that is about level and has almost no points below it; the latter distinguishes it from a
table. Random sampling finds it (RANSAC, M. Fischler and R. Bolles 1981). A least squares fit to its points follows,
weighted by the precision of depth: the error of structured light grows with the square of the distance.
"""

import math
from collections import deque
from dataclasses import astuple

import numpy as np
from numpy.typing import NDArray

from capture.sensor_tilt import MIN_TILT_CHANGE, SensorTilt
from capture.trackers.picture import Lens, Picture

Floats = NDArray[np.float64]

MAX_TILT_DEGREES = 45.0
"""Largest tilt or roll, in degrees, at which a plane counts as a floor."""
MIN_HEIGHT_METRES = 0.35
"""Smallest height of a sensor, in metres. A nearer plane would join the sensor's table to the floor behind it."""

_POINT_COUNT = 1500  # evenly spread points of an image
_SAMPLE_COUNT = 200
_FIT_BANDS = 1.0, 0.6, 0.4, 0.4  # distances relative to the noise, fit by fit; they exclude the foot of a wall
_NOISE_METRES, _NOISE_PER_SQUARE_METRE = (
    0.015,
    0.001,
)  # noise of a point at 0 m, and its growth with the squared distance
_MIN_FLOOR_SHARE = 0.06  # share of the points that must be on the floor
_MAX_SHARE_BELOW = 0.02  # share of the points that may be below it, which are reflections
_AGREEING_COUNT = 5  # measurements that must agree
_SAME_DEGREES, _SAME_METRES = 1.0, 0.03  # differences that count as noise
_FIRST_SECONDS, _LATER_SECONDS = 0.2, 1.0  # time between measurements, before and after the first result
_MAX_SLOPE_DEGREES = 3.0  # of a floor, by a sensor's accelerometer; a steeper plane is something else
_MIN_EXTENT_METRES = 0.6  # of the floor, across and away, because a strip does not determine the tilt


def find_floor(depth: NDArray[np.float32], lens: Lens) -> SensorTilt | None:
    """Return tilt, roll and height of the sensor that took a depth image.

    Parameters
    ----------
    depth : (height, width) float32
        Metres; 0 for unknown.
    lens : Lens

    Returns
    -------
    SensorTilt or None
        None if the sensor sees too little of the floor.
    """
    points = _points(depth, lens)
    if len(points) < _POINT_COUNT * _MIN_FLOOR_SHARE:
        return None
    noise = _NOISE_METRES + _NOISE_PER_SQUARE_METRE * points[:, 2] ** 2
    plane = _largest_plane(points, noise)
    if plane is None:
        return None
    for band in _FIT_BANDS:
        on_it = np.abs(points @ plane[:3] + plane[3]) < band * noise
        if on_it.mean() < _MIN_FLOOR_SHARE:
            return None
        plane = _fit_plane(points[on_it], noise[on_it])
    if np.ptp(points[on_it][:, [0, 2]], axis=0).min() < _MIN_EXTENT_METRES:
        return None
    found = _tilt_of(plane[:3], float(plane[3]))
    steepest = max(abs(found.tilt), abs(found.roll))
    return found if found.height >= MIN_HEIGHT_METRES and steepest <= MAX_TILT_DEGREES else None


def _tilt_of(upward: Floats, height: float = 0.0) -> SensorTilt:
    """Return how a sensor stands, to which a direction (3,) is upwards."""
    right, up, away = upward
    return SensorTilt(math.degrees(math.asin(-away)), height, math.degrees(math.atan2(right, up)))


def _points(depth: NDArray[np.float32], lens: Lens) -> Floats:
    """Return evenly spread points (n, 3) with known depth, in metres."""
    step = max(1, round(math.sqrt(depth.size / _POINT_COUNT)))
    rows, columns = np.indices(depth.shape)[:, step // 2 :: step, step // 2 :: step]
    metres = depth[rows, columns].astype(np.float64)
    pixels = np.stack([columns, rows], axis=-1) + 0.5
    return lens.unproject(pixels, metres)[metres > 0]


def _largest_plane(points: Floats, noise: Floats) -> Floats | None:
    """Return the level plane with the most points as (4,): its upward normal and its distance; None without one."""
    corners = points[np.random.default_rng(0).integers(len(points), size=(_SAMPLE_COUNT, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0] * (np.sign(normals[lengths > 0, 1]) / lengths[lengths > 0])[:, None]
    heights = -np.einsum("tc,tc->t", normals, corners[lengths > 0, 0])
    level = (normals[:, 1] > math.cos(math.radians(MAX_TILT_DEGREES))) & (heights > 0)
    normals, heights = normals[level], heights[level]
    above = points @ normals.T + heights
    count = (np.abs(above) < noise[:, None]).sum(axis=0)
    count[(above < -3 * noise[:, None]).mean(axis=0) > _MAX_SHARE_BELOW] = 0
    if not count.any():
        return None
    best = count.argmax()
    return np.array([*normals[best], heights[best]])


def _fit_plane(points: Floats, noise: Floats) -> Floats:
    """Return the plane nearest to points as (4,); its normal is the direction of the smallest variance."""
    weights = noise**-2 / (noise**-2).sum()
    middle = weights @ points
    _, directions = np.linalg.eigh((points - middle).T * weights @ (points - middle))
    normal = directions[:, 0] * np.sign(directions[1, 0])
    return np.array([*normal, -normal @ middle])


class FloorTracker:
    """Reports tilt, roll and height of a sensor once measurements agree, and again after the sensor was moved.

    A sensor with an accelerometer needs no floor; without one in view, its height is unknown.
    """

    def __init__(self) -> None:
        self._recent: deque[SensorTilt] = deque(maxlen=_AGREEING_COUNT)
        self._reported: SensorTilt | None = None
        self._next = -math.inf

    def update(self, time: float, picture: Picture) -> SensorTilt | None:
        """Return tilt, roll and height if this image makes them certain and they were not reported before.

        Parameters
        ----------
        time : float
            Time of the image, in seconds; it increases from call to call.
        picture : Picture
        """
        if picture.depth is None or time < self._next:
            return None
        self._next = time + (_FIRST_SECONDS if self._reported is None else _LATER_SECONDS)
        found = find_floor(picture.depth, picture.lens)
        if picture.up is not None:
            stands = _tilt_of(picture.up)
            if found is None or not found.near(stands, _MAX_SLOPE_DEGREES, math.inf):
                found = stands
        if found is None:
            return None
        self._recent.append(found)
        middle = SensorTilt(*np.median([astuple(each) for each in self._recent], axis=0).tolist())
        agreed = len(self._recent) == _AGREEING_COUNT and all(
            each.near(middle, _SAME_DEGREES, _SAME_METRES) for each in self._recent
        )
        if not agreed or (self._reported is not None and self._reported.near(middle, *MIN_TILT_CHANGE)):
            return None
        self._reported = middle
        return middle
