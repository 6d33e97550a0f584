"""Where the joints of a body are whose picture is known, with depth or without.

A tracker says at which pixels joints are, and roughly how the body stands: its posture, in metres of its own about the
hips. The distance at which that posture looks like the picture is a linear least squares problem. From then on a joint
is on the ray through its pixel, which is what a tracker is best at, as far behind or before the hips as the posture
says. Bones keep their mean length, as what a tracker makes of it varies by a fifth from picture to picture.

The tracker's metres become those of the room by what is known of the performer: depth where a sensor gives it,
otherwise the height. A joint whose depth is known is put there.
"""

import math

import numpy as np
from numpy.typing import NDArray

from capture.body import ANKLE_HEIGHT, HEAD_TOP, height
from capture.sensors.picture import Lens
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, OPPOSITE, PARENTS

Floats = NDArray[np.float64]

NEAREST = 0.2
"""Metres; nobody whose hips are nearer can be seen whole enough."""

SEEN = 0.5
"""Confidence from which a joint is taken to be in sight: it is looked for in the depth picture."""

_BONES = [(JOINT_INDEX[joint], JOINT_INDEX[parent]) for joint, parent in PARENTS.items()]
_CHILDREN, _PARENTS = (list(ends) for ends in zip(*_BONES, strict=True))

_BENEATH = {
    "hip_center": 0.10,
    "spine": 0.11,
    "shoulder_center": 0.06,
    "head": 0.09,
    "shoulder": 0.05,
    "elbow": 0.04,
    "wrist": 0.025,
    "hand": 0.015,
    "hip": 0.09,
    "knee": 0.05,
    "ankle": 0.04,
    "foot": 0.03,
}
SKIN_TO_JOINT: Floats = np.array([_BENEATH[joint.removesuffix("_left").removesuffix("_right")] for joint in JOINTS])
"""(20,) metres from the skin that a sensor sees to the joint within: half of an adult's thickness there."""

_WINDOW = 0.02  # metres from a joint within which depth is looked at: less than half of a wrist
_BELONGS = 0.25  # metres from where a joint is expected beyond which depth is that of something else
_LEAST = 0.25  # of the window that must belong to the joint
_ENOUGH = 5  # joints with depth that tell how large a body is

_PASSES = 3  # between what the picture shows and the bones' lengths; more of them change little
_MEMORY = 150.0  # pictures that a mean is of in the end: 5 s of a usual camera
_EASE = 0.1  # seconds in which an estimated distance comes about


class Placing:
    """Places one body in one picture after the other.

    Parameters
    ----------
    height : float
        The performer's, metres: what counts as long as no depth is known.
    """

    def __init__(self, height: float) -> None:
        self._height = height
        self._lengths = _Mean(len(JOINTS))
        self._scale = _Mean(1)  # metres of the room for one of the tracker's, as depth tells
        self._distance = self._time = math.nan  # the tracker's metres, seconds

    def place(
        self,
        time: float,
        lens: Lens,
        pixels: Floats,
        posture: Floats,
        confidence: NDArray[np.float32],
        depth: NDArray[np.uint16] | None,
    ) -> tuple[Floats, NDArray[np.float32]] | None:
        """Return where the joints are, and how sure that is.

        Parameters
        ----------
        time : float
            Of the picture, seconds.
        lens : Lens
        pixels : (20, 2) float64
        posture : (20, 3) float64
            As the tracker guesses it: in its metres, in the directions of the sensor frame, about any origin.
        confidence : (20,) float32
            From 0, for a mere guess, to 1.
        depth : (height, width) uint16 array or None
            Millimetres, registered to the picture.

        Returns
        -------
        (positions, confidence) or None
            (20, 3) float64 metres, sensor frame, and (20,) float32. With a depth picture, joints that it misses are
            inferred at most. None if no body can look like that.
        """
        rays = lens.unproject(pixels, np.ones(len(pixels)))
        distance = distance_of(posture, rays, confidence)
        if not NEAREST < distance < math.inf or (distance + posture[:, 2]).min() <= 0:
            return None
        lifted = None if depth is None else _lift(depth, lens, pixels, posture[:, 2] + distance, confidence)
        known = np.zeros(len(JOINTS), bool)
        depths = posture[:, 2] + distance
        if lifted is not None:
            metres, scale = lifted
            self._scale.add(np.array([scale]), np.ones(1))
            known = np.isfinite(metres)
            depths = np.where(known, metres, depths * scale) / self._scale.value
            confidence = np.where(known, confidence, np.minimum(confidence, np.float32(INFERRED)))
        lengths = self._typical_lengths(rays * depths[:, None], confidence)
        if lifted is None:
            depths += self._eased(time, distance) - distance
        placed = _settle(rays, depths, lengths, known)
        return placed * (self._scale.value[0] if self._scale.known else self._by_height(placed)), confidence

    def _eased(self, time: float, distance: float) -> float:
        """Return the estimated distance without most of its noise, which is larger than that of all else."""
        if math.isnan(self._distance):
            self._distance = distance
        else:
            self._distance += (distance - self._distance) * (1 - math.exp(min(self._time - time, 0.0) / _EASE))
        self._time = time
        return self._distance

    def _typical_lengths(self, joints: Floats, confidence: NDArray[np.float32]) -> Floats:
        """Return the mean length of each joint's bone, both sides being alike; joints in sight count the most."""
        lengths, weights = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
        lengths[_CHILDREN] = np.linalg.norm(joints[_CHILDREN] - joints[_PARENTS], axis=1)
        weights[_CHILDREN] = np.minimum(confidence[_CHILDREN], confidence[_PARENTS]) + 1e-3
        both = weights + weights[OPPOSITE]
        self._lengths.add((weights * lengths + (weights * lengths)[OPPOSITE]) / np.maximum(both, 1e-9), both / 2)
        return self._lengths.value

    def _by_height(self, placed: Floats) -> float:
        feet_and_crown = ANKLE_HEIGHT + HEAD_TOP
        return (self._height - feet_and_crown) / (height(placed) - feet_and_crown)


def distance_of(posture: Floats, rays: Floats, weights: NDArray[np.floating]) -> float:
    """Return how far away a posture's origin is, so that it looks most like the picture.

    With a translation t, joint p is seen along the ray r = (rₓ, r_y, 1) where p + t = (p_z + t_z) r. That is linear in
    t; its weighted least squares solution for t_z stands here, the other two being eliminated.

    Parameters
    ----------
    posture : (n, 3) float64
        Metres.
    rays : (n, 3) float64
        Through the joints' pixels, z being 1.
    weights : (n,)
        Of the joints, 0 or more.

    Returns
    -------
    float
        Metres; not above 0, infinite or NaN where the posture cannot look like that.
    """
    weights = weights[:, None] + 1e-6
    slopes = rays[:, :2]
    offsets = slopes * posture[:, 2:] - posture[:, :2]
    slopes, offsets = (values - (weights * values).sum(axis=0) / weights.sum() for values in (slopes, offsets))
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(-(weights * slopes * offsets).sum() / (weights * slopes**2).sum())


def _lift(
    depth: NDArray[np.uint16], lens: Lens, pixels: Floats, guessed: Floats, confidence: NDArray[np.float32]
) -> tuple[Floats, float] | None:
    """Return the depths of joints in metres, NaN where unknown, and how many metres one of the tracker's is.

    Parameters
    ----------
    guessed : (20,) float64
        Depths in the tracker's metres.

    Returns
    -------
    (depths, scale) or None
        None where too few joints have any depth.
    """
    windows = [
        _window(depth, pixel, _WINDOW * lens.focal / z) if sure >= SEEN else np.empty(0)
        for pixel, z, sure in zip(pixels, guessed, confidence, strict=True)
    ]
    ratios = [
        (np.median(window) + skin) / z
        for window, skin, z in zip(windows, SKIN_TO_JOINT, guessed, strict=True)
        if len(window)
    ]
    if len(ratios) < _ENOUGH:
        return None
    scale = float(np.median(ratios))  # whatever hides a joint, or lies behind it, is in the minority
    depths = np.full(len(JOINTS), np.nan)
    for joint, (window, skin, z) in enumerate(zip(windows, SKIN_TO_JOINT, guessed, strict=True)):
        own = window[np.abs(window + skin - z * scale) < _BELONGS]
        if len(own) > _LEAST * len(window):
            depths[joint] = np.median(own) + skin
    return depths, scale


def _window(depth: NDArray[np.uint16], pixel: Floats, radius: float) -> Floats:
    """Return the known depths around a pixel, metres."""
    if not (0 <= pixel[0] < depth.shape[1] and 0 <= pixel[1] < depth.shape[0]):
        return np.empty(0)
    column, row = (int(value) for value in pixel)
    reach = max(2, round(radius))
    window = depth[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
    return window[window > 0] / 1000.0


def _settle(rays: Floats, depths: Floats, lengths: Floats, known: NDArray[np.bool_]) -> Floats:
    """Give bones their lengths, near the rays that their joints are seen along; known joints stay."""
    placed = rays * depths[:, None]
    for _ in range(_PASSES):
        seen = rays * placed[:, 2:]
        placed = seen.copy()
        for joint, parent in _BONES:  # parents come first
            if not known[joint]:
                bone = seen[joint] - seen[parent]
                placed[joint] = placed[parent] + bone * (lengths[joint] / max(float(np.linalg.norm(bone)), 1e-6))
    return placed


class _Mean:
    """The weighted mean of what was added, which slowly forgets."""

    def __init__(self, count: int) -> None:
        self.value = np.zeros(count)
        self._weight = np.zeros(count)

    @property
    def known(self) -> bool:
        """Whether anything was added."""
        return bool(self._weight.any())

    def add(self, values: Floats, weights: Floats) -> None:
        """Take in values; those of weight 0 say nothing."""
        self._weight = np.minimum(self._weight + weights, _MEMORY)
        self.value += (values - self.value) * weights / np.maximum(self._weight, 1e-9)
