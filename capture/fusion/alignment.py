"""Where a second sensor stands and how its clock goes, from a few seconds of a performance that both recorded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.fusion.clocks import offsets, sampled
from capture.pose import Pose, fit
from capture.skeleton import LOST, OPPOSITE
from puppetline.errors import SkeletonLogError

Array = NDArray[np.float64]

PEAKS = 5
"""Shifts of the clock that are tried: whoever does the same thing twice matches themselves twice."""
ROUGH = 8, 100
"""Rounds and frames in which each of them is tried, from two sides."""
FINE = 25, 400
"""Rounds and frames of the best fit: frames are evenly chosen, and half a minute of them says all there is to say."""

SHORTEST = 3.0
"""Seconds for which both must have seen the performer."""
LEAST_ALIKE = 0.2
"""Correlation below which the two did not see the same performance, or nobody moved."""
WORST = 0.12
"""Metres, mean over the joints: trackers that look from two sides differ by a few centimetres."""
CLEAR = 1.5
"""By how much another way to fit must be worse: who only stands, straight and still, looks the same turned round."""

_HALF_TURN = np.diag([-1.0, 1.0, -1.0])
_STEP = 0.05  # seconds before and after a moment from which its velocity is taken


@dataclass(frozen=True, slots=True)
class Alignment:
    """How a second recording fits the first.

    Attributes
    ----------
    pose : Pose
        Of the second sensor in the first one's frame.
    clock : float
        Seconds by which the second clock is ahead of the first.
    residual : float
        Metres, the mean distance between what the two say of a joint, by their confidence.
    seconds : float
        For how long both saw the performer.
    swapped : float
        Share of the frames in which the two disagree about which side is left.
    """

    pose: Pose
    clock: float
    residual: float
    seconds: float
    swapped: float


def align(first: SkeletonClip, other: SkeletonClip, where: str) -> Alignment:
    """Fit the recording of one sensor to that of another one of the same performer.

    Correlation gives the clock to a few milliseconds; then pose, clock, and which frames have left and right swapped
    are fitted in turns, with less weight for joints that were guessed or are far off.

    Parameters
    ----------
    first, other : SkeletonClip
    where : str
        What errors call the two.

    Raises
    ------
    SkeletonLogError
        They have too little in common, or what they have does not fit.
    """
    shifts = offsets(first, other, PEAKS)
    alike = shifts[0][1] if shifts else 0.0
    if alike < LEAST_ALIKE:
        raise SkeletonLogError(
            where,
            found=f"motion that has little in common (correlation {alike:.2f})",
            expected=f"two recordings of the same performance, made at the same time (at least {LEAST_ALIKE:g})",
            fix="Record both again at once, and walk about with swinging arms for ten seconds.",
        )
    fits = [
        _fitted(first, other, each, reverse, ROUGH)
        for each, _ in shifts
        if _together(first, other, each) >= SHORTEST
        for reverse in (False, True)
    ]
    if not fits:
        raise SkeletonLogError(
            where,
            found=f"less than {SHORTEST:g} s in which both saw the performer",
            expected="ten seconds or more",
            fix="Record again where both sensors see the whole body.",
        )
    nearest = min(fits, key=_residual)
    best = _improved(first, other, nearest.pose, nearest.clock, FINE)
    if best.residual > WORST:
        raise SkeletonLogError(
            where,
            found=f"joints that are {100 * best.residual:.1f} cm apart (mean) in the best alignment",
            expected=f"at most {100 * WORST:.0f} cm",
            fix="Record one performer alone, with both sensors unmirrored and in metres; then try again.",
        )
    rivals = [_residual(each) for each in fits if _turned(each.pose, best.pose)]
    if rivals and min(rivals) < CLEAR * nearest.residual:
        raise SkeletonLogError(
            where,
            found=f"two poses of the second sensor, turned by 180°, that fit about as well "
            f"({100 * nearest.residual:.1f} and {100 * min(rivals):.1f} cm)",
            expected="a motion that tells front from back",
            fix="Record again; walk towards one sensor and away, and lift a knee or reach forward.",
        )
    return best


def _residual(fitted: Alignment) -> float:
    return fitted.residual


def _chosen(first: SkeletonClip, other: SkeletonClip, clock: float) -> NDArray[np.intp]:
    """Return the frames of the first in which both know half of the joints."""
    _, trust = sampled(other, first.times + clock)
    return np.flatnonzero(((trust > LOST) & (first.confidence > LOST)).sum(axis=1) >= 10)


def _together(first: SkeletonClip, other: SkeletonClip, clock: float) -> float:
    """Return for how many seconds both saw the performer: by frames, as there may be gaps."""
    return len(_chosen(first, other, clock)) * float(np.median(np.diff(first.times)))


def _fitted(
    first: SkeletonClip, other: SkeletonClip, clock: float, reverse: bool, effort: tuple[int, int]
) -> Alignment:
    """Fit from the pose that the body's middle suggests, or from its reverse.

    The middle between a joint and its counterpart is the same whichever is taken for which.
    """
    chosen = _chosen(first, other, clock)
    here, (there, trust) = first.positions[chosen], sampled(other, first.times[chosen] + clock)
    trust = (trust * first.confidence[chosen]) ** 2
    here, there, trust = (here + here[:, OPPOSITE]) / 2, (there + there[:, OPPOSITE]) / 2, trust * trust[:, OPPOSITE]
    pose = _fit(there, here, trust)
    if reverse:
        centre = there[trust > LOST].mean(axis=0)
        rotation = pose.rotation @ _HALF_TURN
        pose = Pose(rotation, pose.apply(centre) - rotation @ centre)
    return _improved(first, other, pose, clock, effort)


def _improved(first: SkeletonClip, other: SkeletonClip, pose: Pose, clock: float, effort: tuple[int, int]) -> Alignment:
    """Fit pose, clock and sides in turns, with so many rounds and frames."""
    rounds, most = effort
    chosen = _chosen(first, other, clock)
    seconds = _together(first, other, clock)
    chosen = chosen[:: 1 + (len(chosen) - 1) // most]
    times, here, trust_here = first.times[chosen], first.positions[chosen], first.confidence[chosen] ** 2.0
    # The joints' velocities, evenly about each moment: so their noise has nothing to do with that of the positions.
    (before, _), (after, _) = sampled(first, times - _STEP), sampled(first, times + _STEP)
    velocity = np.nan_to_num((after - before) / (2 * _STEP))
    rows = np.arange(len(times))[:, None]
    residual, swapped = np.inf, np.zeros(len(times), dtype=bool)
    for _ in range(rounds):
        there, trust = sampled(other, times + clock)
        laid = pose.apply(there)
        swapped = _far(laid[:, OPPOSITE], here) < _far(laid, here)
        side = np.where(swapped[:, None], OPPOSITE, np.arange(len(OPPOSITE)))
        there, laid, trust = (each[rows, side] for each in (there, laid, trust))
        apart = np.nan_to_num(np.linalg.norm(laid - here, axis=2))
        weights = trust_here * trust**2
        residual = float((weights * apart).sum() / weights.sum())
        weights /= (1 + (apart / max(2 * residual, 1e-9)) ** 2) ** 2
        pose = _fit(there, here, weights)
        # Where the joints are behind their own motion, the clock is.
        behind = np.nan_to_num(here - pose.apply(there))
        speed = float((weights * (velocity**2).sum(axis=2)).sum())
        clock += float((weights * (behind * velocity).sum(axis=2)).sum()) / max(speed, 1e-9)
    return Alignment(pose, clock, residual, seconds, float(swapped.mean()))


def _fit(points: Array, onto: Array, weights: Array) -> Pose:
    known = (weights > 0) & np.isfinite(points).all(axis=2) & np.isfinite(onto).all(axis=2)
    return fit(points[known], onto[known], weights[known])


def _far(laid: Array, here: Array) -> Array:
    """Return the mean distance of the joints in each frame (T,)."""
    apart = np.linalg.norm(laid - here, axis=2)
    return np.nansum(apart, axis=1) / np.maximum(np.isfinite(apart).sum(axis=1), 1)


def _turned(one: Pose, other: Pose) -> bool:
    """Tell whether two poses differ by more than a quarter turn."""
    return bool(np.trace(one.rotation.T @ other.rotation) < 1.0)
