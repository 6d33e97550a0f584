"""Where the joints of a body are whose picture is known, with depth or without.

A tracker says at which pixels joints are, and roughly how the body stands: its posture, in metres of its own about the
hips. The distance at which that posture looks like the picture is a linear least squares problem. From then on a joint
is on the ray through its pixel, which is what a tracker is best at, as far behind or before the hips as the posture
says. Bones keep their mean length, as what a tracker makes of it varies by a fifth from picture to picture.

The tracker's metres become those of the room by what is known of the performer: depth where a sensor gives it,
otherwise the height. A joint whose depth is known is put there (`capture.trackers.lifting`).
"""

import math

import numpy as np
from numpy.typing import NDArray

from capture.body import ANKLE_HEIGHT_METRES, HEAD_TOP_METRES, height
from capture.skeleton import INFERRED, JOINTS, OPPOSITE
from capture.trackers.lifting import NEIGHBORS, lift
from capture.trackers.picture import Lens
from puppetline.compiled import compiled

Floats = NDArray[np.float64]

NEAREST = 0.2
"""Metres; nobody whose hips are nearer can be seen whole enough."""

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
        depths = posture[:, 2] + distance
        if not self._lengths.known:  # until pictures tell, bones are as long as the tracker guesses
            self._typical_lengths(posture, np.zeros(len(JOINTS), np.float32))
        known = np.zeros(len(JOINTS), bool)
        lifted = (
            None if depth is None else lift(depth, lens.focal, pixels, rays, depths, self._lengths.value, confidence)
        )
        if lifted is not None:
            metres, known, scale = lifted
            self._scale.add(np.array([scale]), np.ones(1))
            depths = metres / self._scale.value
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
        lengths[1:] = np.linalg.norm(joints[1:] - joints[NEIGHBORS[1:]], axis=1)
        weights[1:] = np.minimum(confidence[1:], confidence[NEIGHBORS[1:]]) + 1e-3
        both = weights + weights[OPPOSITE]
        self._lengths.add((weights * lengths + (weights * lengths)[OPPOSITE]) / np.maximum(both, 1e-9), both / 2)
        return self._lengths.value

    def _by_height(self, placed: Floats) -> float:
        feet_and_crown = ANKLE_HEIGHT_METRES + HEAD_TOP_METRES
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


@compiled
def _settle(rays, depths, lengths, known):
    """Give bones their lengths, near the rays that their joints are seen along; known joints stay."""
    placed = rays * depths.reshape(-1, 1)
    for _ in range(_PASSES):
        seen = rays * placed[:, 2:]
        placed = seen.copy()
        for joint in range(1, len(rays)):
            if not known[joint]:
                near = NEIGHBORS[joint]
                bone = seen[joint] - seen[near]
                placed[joint] = placed[near] + bone * (lengths[joint] / max(np.sqrt((bone**2).sum()), 1e-6))
    return placed


def rehearse() -> None:
    """Place a made-up body, so that nothing is compiled when somebody comes: that takes seconds."""
    lens = Lens(64, 48, 60.0)
    posture = np.random.default_rng(0).normal(0, 0.3, (len(JOINTS), 3))
    joints = posture + np.array([0.0, 0.0, 3.0])
    sure, depth = np.ones(len(JOINTS), np.float32), np.full((lens.height, lens.width), 3000, np.uint16)
    Placing(1.7).place(0.0, lens, lens.project(joints), posture, sure, depth)


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
