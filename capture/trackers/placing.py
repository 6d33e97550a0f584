"""Positions of the joints of a body from their pixels and a posture, with depth or without.

A tracker finds the pixels of joints and estimates the posture: positions relative to the hips, in metres of its own.
The distance at which the posture looks like the image is a linear least squares problem. Each joint is then on the ray
through its pixel, which trackers find most precisely, at the posture's depth relative to the hips. Bones get their mean
length so far, because a tracker's bone lengths vary by a fifth from image to image.

The scale of the tracker's metres follows from depth, if the sensor measures it, otherwise from the performer's height.
A joint with measured depth is placed there (`capture.trackers.joint_depth`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from capture.body import ANKLE_HEIGHT_METRES, HEAD_TOP_METRES, height
from capture.skeleton import INFERRED, JOINTS, OPPOSITE
from capture.trackers.joint_depth import PARENT_INDICES, measure_depths
from capture.trackers.picture import Lens
from puppetline.compiled import compiled

Floats = NDArray[np.float64]

MIN_DISTANCE_METRES = 0.2
"""Smallest distance of the hips, in metres; nearer bodies do not fit into the image."""

_PASS_COUNT = 3  # alternations between rays and bone lengths; more of them change little
_MEAN_COUNT = 150.0  # images in a mean, about 5 s
_SMOOTHING_SECONDS = 0.1  # time constant of the estimated distance


class BodyPlacer:
    """Places one body in one image after another.

    Parameters
    ----------
    height : float
        The performer's height, in metres; it determines the scale until depth is known.
    """

    def __init__(self, height: float) -> None:
        self._height = height
        self._lengths = _Mean(len(JOINTS))
        self._scale = _Mean(1)  # metres per metre of the tracker, measured by depth
        self._distance = self._time = math.nan  # the tracker's metres, seconds

    def place(
        self,
        time: float,
        lens: Lens,
        pixels: Floats,
        posture: Floats,
        confidence: NDArray[np.float32],
        depth: NDArray[np.float32] | None,
    ) -> tuple[Floats, NDArray[np.float32]] | None:
        """Return positions and confidence of the joints.

        Parameters
        ----------
        time : float
            Time of the image, in seconds.
        lens : Lens
        pixels : (20, 2) float64
        posture : (20, 3) float64
            The tracker's estimate, in its metres, along the axes of sensor coordinates, relative to any origin.
        confidence : (20,) float32
            From 0 (lost) to 1 (tracked).
        depth : (height, width) float32 array or None
            Metres, registered to the image; 0 for unknown.

        Returns
        -------
        (positions, confidence) or None
            (20, 3) float64 metres in sensor coordinates, and (20,) float32. With a depth image, joints without depth
            are inferred at most. None if no body can look like the image.
        """
        rays = lens.unproject(pixels, np.ones(len(pixels)))
        distance = distance_of(posture, rays, confidence)
        if not MIN_DISTANCE_METRES < distance < math.inf or (distance + posture[:, 2]).min() <= 0:
            return None
        depths = posture[:, 2] + distance
        if not self._lengths.known:  # the first lengths are those of the tracker
            self._mean_lengths(posture, np.zeros(len(JOINTS), np.float32))
        known = np.zeros(len(JOINTS), bool)
        measured = None
        if depth is not None:
            measured = measure_depths(depth, lens.focal, pixels, rays, depths, self._lengths.value, confidence)
        if measured is not None:
            metres, known, scale = measured
            self._scale.add(np.array([scale]), np.ones(1))
            depths = metres / self._scale.value
            confidence = np.where(known, confidence, np.minimum(confidence, np.float32(INFERRED)))
        lengths = self._mean_lengths(rays * depths[:, None], confidence)
        if measured is None:
            depths += self._smoothed(time, distance) - distance
        placed = _fit_bones(rays, depths, lengths, known)
        return placed * (self._scale.value[0] if self._scale.known else self._by_height(placed)), confidence

    def _smoothed(self, time: float, distance: float) -> float:
        """Return the estimated distance with exponential smoothing; its noise is the largest of all estimates."""
        if math.isnan(self._distance):
            self._distance = distance
        else:
            self._distance += (distance - self._distance) * (
                1 - math.exp(min(self._time - time, 0.0) / _SMOOTHING_SECONDS)
            )
        self._time = time
        return self._distance

    def _mean_lengths(self, joints: Floats, confidence: NDArray[np.float32]) -> Floats:
        """Return the mean length of each joint's bone, equal on both sides; visible joints have the most weight."""
        lengths, weights = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
        lengths[1:] = np.linalg.norm(joints[1:] - joints[PARENT_INDICES[1:]], axis=1)
        weights[1:] = np.minimum(confidence[1:], confidence[PARENT_INDICES[1:]]) + 1e-3
        both = weights + weights[OPPOSITE]
        self._lengths.add((weights * lengths + (weights * lengths)[OPPOSITE]) / np.maximum(both, 1e-9), both / 2)
        return self._lengths.value

    def _by_height(self, placed: Floats) -> float:
        feet_and_crown = ANKLE_HEIGHT_METRES + HEAD_TOP_METRES
        return (self._height - feet_and_crown) / (height(placed) - feet_and_crown)


def distance_of(posture: Floats, rays: Floats, weights: NDArray[np.floating]) -> float:
    """Return the distance of a posture's origin at which the posture looks most like the image.

    With a translation t, joint p is on the ray r = (rₓ, r_y, 1) if p + t = (p_z + t_z) r. This is linear in t. The
    result is t_z of the weighted least squares solution, from which tₓ and t_y are eliminated.

    Parameters
    ----------
    posture : (n, 3) float64
        Metres.
    rays : (n, 3) float64
        Directions through the joints' pixels, with z = 1.
    weights : (n,)
        Weights of the joints, 0 or more.

    Returns
    -------
    float
        Metres; 0 or less, infinite or NaN if the posture cannot look like the image.
    """
    weights = weights[:, None] + 1e-6
    slopes = rays[:, :2]
    offsets = slopes * posture[:, 2:] - posture[:, :2]
    slopes, offsets = (values - (weights * values).sum(axis=0) / weights.sum() for values in (slopes, offsets))
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(-(weights * slopes * offsets).sum() / (weights * slopes**2).sum())


@compiled
def _fit_bones(rays, depths, lengths, known):
    """Give bones their lengths, with joints near their rays; joints of known depth stay."""
    placed = rays * depths.reshape(-1, 1)
    for _ in range(_PASS_COUNT):
        on_rays = rays * placed[:, 2:]
        placed = on_rays.copy()
        for joint in range(1, len(rays)):
            if not known[joint]:
                parent = PARENT_INDICES[joint]
                bone = on_rays[joint] - on_rays[parent]
                placed[joint] = placed[parent] + bone * (lengths[joint] / max(np.sqrt((bone**2).sum()), 1e-6))
    return placed


def warm_up() -> None:
    """Place an invented body, so that Numba compiles everything before the first performer, which takes seconds."""
    lens = Lens(64, 48, 60.0)
    posture = np.random.default_rng(0).normal(0, 0.3, (len(JOINTS), 3))
    joints = posture + np.array([0.0, 0.0, 3.0])
    confidence, depth = np.ones(len(JOINTS), np.float32), np.full((lens.height, lens.width), 3.0, np.float32)
    BodyPlacer(1.7).place(0.0, lens, lens.project(joints), posture, confidence, depth)


class _Mean:
    """A weighted mean of (count,) values, in which older values slowly lose weight."""

    def __init__(self, count: int) -> None:
        self.value = np.zeros(count)
        self._weight = np.zeros(count)

    @property
    def known(self) -> bool:
        """Whether values were added."""
        return bool(self._weight.any())

    def add(self, values: Floats, weights: Floats) -> None:
        """Add values with their weights, 0 or more."""
        self._weight = np.minimum(self._weight + weights, _MEAN_COUNT)
        self.value += (values - self.value) * weights / np.maximum(self._weight, 1e-9)
