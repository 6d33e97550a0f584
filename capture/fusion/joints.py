"""Fusion of several sensors' observations of one performer into one skeleton."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import INFERRED, LOST, OPPOSITE, SkeletonFrame

Array = NDArray[np.float64]

MAX_AGE_SECONDS = 0.15
"""Maximum age of an observation that counts."""
DECAY_SECONDS = 0.05
"""Time in which the weight of an observation falls to 1/e."""
MAX_SENSOR_DISTANCE_METRES = 0.15
"""Maximum distance between two sensors' positions of a joint; if it is larger, one of them is wrong."""
PREVIOUS_FRAME_WEIGHT = 0.75
"""Weight of the previous frame in the choice between sensors, relative to the most confident sensor. It decides between
two sensors, and three sensors outweigh it."""
MAX_METRES_PER_SECOND = 10.0
"""Maximum speed of a joint; if it is higher, one of two frames is wrong."""

_SIDE_ORDERS = np.stack([np.arange(len(OPPOSITE)), OPPOSITE])


@dataclass(frozen=True, slots=True)
class Observation:
    """One sensor's last observation of a performer, in common coordinates and on the common clock.

    Attributes
    ----------
    time : float
        Seconds.
    positions : (20, 3) float64
        Metres; NaN where lost.
    velocities : (20, 3) float64
        Metres per second since the frame before; 0 if unknown or above `MAX_METRES_PER_SECOND`.
    confidence : (20,) float32
    """

    time: float
    positions: Array
    velocities: Array
    confidence: NDArray[np.float32]

    @classmethod
    def after(cls, before: "Observation | None", frame: SkeletonFrame) -> Self:
        """Return the observation of a frame, with velocities since the observation before."""
        velocities = np.zeros_like(frame.positions)
        if before is not None and 0 < frame.time - before.time <= MAX_AGE_SECONDS:
            known = (frame.confidence > LOST) & (before.confidence > LOST)
            moved = np.where(known[:, None], frame.positions - before.positions, 0.0)
            velocities = moved / (frame.time - before.time)
            velocities[(velocities**2).sum(axis=1) > MAX_METRES_PER_SECOND**2] = 0.0
        return cls(frame.time, frame.positions, velocities, frame.confidence)

    def swapped(self) -> "Observation":
        """Return the observation with left and right swapped."""
        return Observation(self.time, self.positions[OPPOSITE], self.velocities[OPPOSITE], self.confidence[OPPOSITE])


def fuse(
    observations: Sequence[Observation], moment: float, before: Array | None = None
) -> tuple[Array, NDArray[np.float32]]:
    """Return the joints at a time: the mean of the extrapolated observations, weighted by confidence and age.

    The error of an inferred joint (confidence 0.5) is several times that of a tracked joint. Its weight, the confidence
    to the fourth power, is one sixteenth. Outliers do not count.

    Parameters
    ----------
    observations : sequence of Observation
        One observation per sensor. Observations older than `MAX_AGE_SECONDS` are skipped.
    moment : float
        Seconds.
    before : (20, 3) float64, optional
        Positions in the previous frame; NaN for lost joints.

    Returns
    -------
    positions : (20, 3) float64
        NaN for joints that all sensors have lost.
    confidence : (20,) float32
        The highest confidence of the observations that count.
    """
    ages = np.array([[moment - observation.time] for observation in observations])
    confidence = np.stack([observation.confidence for observation in observations])
    positions = np.stack([observation.positions for observation in observations])
    positions = positions + ages[..., None] * np.stack([observation.velocities for observation in observations])
    known = (confidence > LOST) & np.isfinite(positions).all(axis=2) & (np.abs(ages) <= MAX_AGE_SECONDS)
    positions = np.where(known[..., None], positions, 0.0)
    weights = np.where(known, confidence.astype(np.float64) ** 4 * np.exp(-np.maximum(ages, 0.0) / DECAY_SECONDS), 0.0)
    weights[_outliers(positions, np.where(confidence > INFERRED, weights, 0.0), before)] = 0.0
    total = weights.sum(axis=0)
    mean = (weights[..., None] * positions).sum(axis=0) / np.where(total > 0, total, np.nan)[:, None]
    return mean, np.where(weights > 0, confidence, np.float32(LOST)).max(axis=0)


def _outliers(positions: Array, weights: Array, before: Array | None) -> NDArray[np.bool_]:
    """Return which positions (sensors, 20, 3) of joints are far from the most likely one, as (sensors, 20) bool.

    The most likely position of a joint is nearest to all others and to the previous frame, `before`. Joints of weight
    0 are not tracked.
    """
    apart = np.linalg.norm(positions[:, None] - positions, axis=3)
    far = (apart > MAX_SENSOR_DISTANCE_METRES) & (weights[:, None] > 0) & (weights > 0)
    if not far.any():
        return np.zeros(weights.shape, dtype=np.bool_)
    doubt = np.where(weights > 0, (weights * apart).sum(axis=1), np.inf)
    if before is not None:
        moved = np.nan_to_num(np.linalg.norm(positions - before, axis=2))
        doubt += PREVIOUS_FRAME_WEIGHT * weights.max(axis=0) * moved
    return far[doubt.argmin(axis=0), :, np.arange(len(OPPOSITE))].T


def is_swapped(positions: Array, confidence: NDArray[np.float32], like: Array, trust: NDArray[np.float32]) -> bool:
    """Return whether a body (20, 3) is nearer to another one, `like`, with left and right swapped."""
    weights = confidence[_SIDE_ORDERS] * trust
    apart = np.nan_to_num(np.linalg.norm(positions[_SIDE_ORDERS] - like, axis=2))
    total = weights.sum(axis=1)
    unchanged, swapped = np.divide((weights * apart).sum(axis=1), total, out=np.full(2, np.inf), where=total > 0)
    return bool(swapped < unchanged)
