"""What several sensors say of one performer at one moment, and one skeleton made of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import INFERRED, LOST, OPPOSITE, SkeletonFrame

Array = NDArray[np.float64]

OLDEST = 0.15
"""Seconds after which what a sensor saw says nothing of now."""
FADING = 0.05
"""Seconds in which what was seen loses two thirds of its weight."""
APART = 0.15
"""Metres between what two sensors say of a joint from which one of them is wrong."""
MEMORY = 0.75
"""What the frame before has to say in which one it is, in votes of the surest sensor: it decides between two, and three
outvote it."""
FASTEST = 10.0
"""Metres a second: nobody's joint is faster, so one of the two frames was wrong."""

_BOTH_WAYS = np.stack([np.arange(len(OPPOSITE)), OPPOSITE])


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
        Metres a second, since the frame before; 0 where that is not known, or more than anybody's.
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
            velocities[(velocities**2).sum(axis=1) > FASTEST**2] = 0.0
        return cls(frame.time, frame.positions, velocities, frame.confidence)

    def swapped(self) -> "Sight":
        """Return it with left and right exchanged."""
        return Sight(self.time, self.positions[OPPOSITE], self.velocities[OPPOSITE], self.confidence[OPPOSITE])


def fuse(sights: Sequence[Sight], moment: float, before: Array | None = None) -> tuple[Array, NDArray[np.float32]]:
    """Return the joints at a moment: the mean of what is known, carried on to then, by confidence and age.

    A guessed joint (confidence 0.5) is several times as far off as one that was seen. The weight, its confidence to the
    fourth power, is one sixteenth. A joint that is seen where it cannot be does not count.

    Parameters
    ----------
    sights : sequence of Sight
        One for each sensor. What is older than `OLDEST` then is left out.
    moment : float
        Seconds.
    before : (20, 3) float64, optional
        Where the joints were a moment ago; NaN where that is not known.

    Returns
    -------
    positions : (20, 3) float64
        NaN where nobody knows.
    confidence : (20,) float32
        The best of those that count.
    """
    ages = np.array([[moment - sight.time] for sight in sights])
    confidence = np.stack([sight.confidence for sight in sights])
    positions = np.stack([sight.positions for sight in sights])
    positions = positions + ages[..., None] * np.stack([sight.velocities for sight in sights])
    known = (confidence > LOST) & np.isfinite(positions).all(axis=2) & (np.abs(ages) <= OLDEST)
    positions = np.where(known[..., None], positions, 0.0)
    weights = np.where(known, confidence.astype(np.float64) ** 4 * np.exp(-np.maximum(ages, 0.0) / FADING), 0.0)
    weights[_wrong(positions, np.where(confidence > INFERRED, weights, 0.0), before)] = 0.0
    total = weights.sum(axis=0)
    mean = (weights[..., None] * positions).sum(axis=0) / np.where(total > 0, total, np.nan)[:, None]
    return mean, np.where(weights > 0, confidence, np.float32(LOST)).max(axis=0)


def _wrong(positions: Array, weights: Array, before: Array | None) -> NDArray[np.bool_]:
    """Tell what lies far from the likeliest: the one that is nearest to all others and to where the joint was.

    Parameters
    ----------
    positions : (sensors, 20, 3) float64
    weights : (sensors, 20) float64
        0 for what is not seen.
    before : (20, 3) float64 or None
    """
    apart = np.linalg.norm(positions[:, None] - positions, axis=3)
    far = (apart > APART) & (weights[:, None] > 0) & (weights > 0)
    if not far.any():
        return np.zeros(weights.shape, dtype=np.bool_)
    doubt = np.where(weights > 0, (weights * apart).sum(axis=1), np.inf)
    if before is not None:
        doubt += MEMORY * weights.max(axis=0) * np.nan_to_num(np.linalg.norm(positions - before, axis=2))
    return far[doubt.argmin(axis=0), :, np.arange(len(OPPOSITE))].T


def other_way_round(positions: Array, confidence: NDArray[np.float32], like: Array, trust: NDArray[np.float32]) -> bool:
    """Tell whether a body is nearer to another one with left and right exchanged.

    Parameters
    ----------
    positions, like : (20, 3) float64
        Metres.
    confidence, trust : (20,) float32
        Of the two.
    """
    weights = confidence[_BOTH_WAYS] * trust
    apart = np.nan_to_num(np.linalg.norm(positions[_BOTH_WAYS] - like, axis=2))
    total = weights.sum(axis=1)
    as_it_is, exchanged = np.divide((weights * apart).sum(axis=1), total, out=np.full(2, np.inf), where=total > 0)
    return bool(exchanged < as_it_is)
