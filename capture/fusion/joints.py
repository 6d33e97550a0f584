"""What several sensors say of one performer at one moment, and one skeleton made of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import LOST, OPPOSITE, SkeletonFrame

Array = NDArray[np.float64]

OLDEST = 0.15
"""Seconds after which what a sensor saw says nothing of now."""
FADING = 0.05
"""Seconds in which what was seen loses two thirds of its weight."""


@dataclass(frozen=True, slots=True)
class Sight:
    """What one sensor last saw of a performer, in the common frame and on the common clock.

    Attributes
    ----------
    time : float
        Seconds.
    positions : (20, 3) float64
        Metres; NaN where lost.
    velocities : (20, 3) float64
        Metres a second, since the frame before; 0 where that is not known.
    confidence : (20,) float32
    """

    time: float
    positions: Array
    velocities: Array
    confidence: NDArray[np.float32]

    @classmethod
    def after(cls, before: "Sight | None", frame: SkeletonFrame) -> Self:
        """Make what a frame shows, with the velocities since what was seen before."""
        velocities = np.zeros_like(frame.positions)
        if before is not None and 0 < frame.time - before.time <= OLDEST:
            known = (frame.confidence > LOST) & (before.confidence > LOST)
            moved = np.where(known[:, None], frame.positions - before.positions, 0.0)
            velocities = moved / (frame.time - before.time)
        return cls(frame.time, frame.positions, velocities, frame.confidence)

    def swapped(self) -> "Sight":
        """Return it with left and right exchanged."""
        return Sight(self.time, self.positions[OPPOSITE], self.velocities[OPPOSITE], self.confidence[OPPOSITE])


def fuse(sights: Sequence[Sight], moment: float) -> tuple[Array, NDArray[np.float32]]:
    """Return the joints at a moment: the mean of what is known, carried on to then, by confidence and age.

    A guessed joint (confidence 0.5) is several times as far off as one that was seen. The weight, its confidence to the
    fourth power, is one sixteenth.

    Parameters
    ----------
    sights : sequence of Sight
        One for each sensor. What is older than `OLDEST` then is left out.
    moment : float
        Seconds.

    Returns
    -------
    positions : (20, 3) float64
        NaN where nobody knows.
    confidence : (20,) float32
        The best of those that know the joint.
    """
    total, weights = np.zeros((len(OPPOSITE), 3)), np.zeros(len(OPPOSITE))
    confidence = np.zeros(len(OPPOSITE), dtype=np.float32)
    for sight in sights:
        age = moment - sight.time
        if abs(age) > OLDEST:
            continue
        known = (sight.confidence > LOST) & np.isfinite(sight.positions).all(axis=1)
        weight = np.where(known, sight.confidence.astype(np.float64) ** 4, 0.0) * np.exp(-max(age, 0.0) / FADING)
        total += weight[:, None] * np.nan_to_num(sight.positions + age * sight.velocities)
        weights += weight
        confidence = np.where(known, np.maximum(confidence, sight.confidence), confidence)
    known = weights > 0
    positions = np.where(known[:, None], total / np.where(known, weights, 1.0)[:, None], np.nan)
    return positions, confidence


def other_way_round(positions: Array, confidence: NDArray[np.float32], like: Array, trust: NDArray[np.float32]) -> bool:
    """Tell whether a body is nearer to another one with left and right exchanged.

    Parameters
    ----------
    positions, like : (20, 3) float64
        Metres.
    confidence, trust : (20,) float32
        Of the two.
    """
    as_it_is = _distance(positions, confidence, like, trust)
    return _distance(positions[OPPOSITE], confidence[OPPOSITE], like, trust) < as_it_is


def _distance(one: Array, confidence: NDArray[np.float32], other: Array, trust: NDArray[np.float32]) -> float:
    """Return the mean distance of the joints, by confidence; infinity where nothing can be compared."""
    weights = confidence * trust
    apart = np.nan_to_num(np.linalg.norm(one - other, axis=1))
    return float((weights * apart).sum() / weights.sum()) if weights.any() else np.inf
