"""Pose and clock of a second sensor, from a few seconds of motion that both sensors recorded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.fusion.clocks import clock_offsets, sampled
from capture.sensor_pose import SensorPose, fit
from capture.skeleton import LOST, OPPOSITE
from puppetline.errors import SkeletonLogError

Array = NDArray[np.float64]

MAX_SHIFTS = 5
"""Maximum number of clock shifts to try. A motion that is repeated correlates at several shifts."""
COARSE_ROUNDS_AND_FRAMES = 8, 100
"""Number of rounds and frames of the fit of each shift, with two initial poses."""
FINE_ROUNDS_AND_FRAMES = 25, 400
"""Number of rounds and frames of the final fit. The frames are evenly spaced; more frames do not improve the fit."""

MIN_COMMON_SECONDS = 3.0
"""Minimum time for which both sensors must have seen the performer."""
MIN_CORRELATION = 0.2
"""Minimum correlation. With a lower one, the recordings show different motions or no motion."""
MAX_RESIDUAL_METRES = 0.12
"""Maximum mean distance over the joints. Trackers in two directions differ by a few centimetres."""
MIN_RESIDUAL_RATIO = 1.5
"""Minimum ratio of the residual of the opposite pose to that of the best pose. It is near 1 if the performer does not
move enough to distinguish front and back."""

_HALF_TURN = np.diag([-1.0, 1.0, -1.0])
_VELOCITY_STEP_SECONDS = 0.05  # before and after a time at which the velocity is measured


@dataclass(frozen=True, slots=True)
class Alignment:
    """Fit of a second recording to the first.

    Attributes
    ----------
    pose : SensorPose
        Pose of the second sensor in the coordinates of the first.
    clock : float
        Seconds by which the second clock is ahead of the first.
    residual : float
        Mean distance in metres between a joint in the two recordings, weighted by confidence.
    seconds : float
        Time for which both sensors saw the performer.
    swapped : float
        Share of the frames in which the recordings have left and right swapped.
    """

    pose: SensorPose
    clock: float
    residual: float
    seconds: float
    swapped: float


def align(first: SkeletonClip, other: SkeletonClip, where: str) -> Alignment:
    """Fit one sensor's recording to another sensor's recording of the same performer.

    Correlation determines the clock to a few milliseconds. Pose, clock, and the frames with left and right swapped are
    then fitted in turn. Joints that are inferred or far from the fit have lower weights.

    Parameters
    ----------
    first, other : SkeletonClip
    where : str
        Names of the two recordings, for errors.

    Raises
    ------
    SkeletonLogError
        The recordings have too little in common, or no pose fits.
    """
    shifts = clock_offsets(first, other, MAX_SHIFTS)
    alike = shifts[0][1] if shifts else 0.0
    if alike < MIN_CORRELATION:
        raise SkeletonLogError(
            where,
            found=f"motions that have little in common (correlation {alike:.2f})",
            expected=f"two recordings of the same motion, made at the same time (at least {MIN_CORRELATION:g})",
            fix="Record both again at the same time, and walk around with swinging arms for ten seconds.",
        )
    fits = [
        _initial_fit(first, other, each, reverse, COARSE_ROUNDS_AND_FRAMES)
        for each, _ in shifts
        if _common_seconds(first, other, each) >= MIN_COMMON_SECONDS
        for reverse in (False, True)
    ]
    if not fits:
        raise SkeletonLogError(
            where,
            found=f"less than {MIN_COMMON_SECONDS:g} s in which both sensors saw the performer",
            expected="ten seconds or more",
            fix="Record again in the area where both sensors see the whole body.",
        )
    nearest = min(fits, key=_residual)
    best = _refined_fit(first, other, nearest.pose, nearest.clock, FINE_ROUNDS_AND_FRAMES)
    if best.residual > MAX_RESIDUAL_METRES:
        raise SkeletonLogError(
            where,
            found=f"a mean distance of {100 * best.residual:.1f} cm between the joints in the best fit",
            expected=f"at most {100 * MAX_RESIDUAL_METRES:.0f} cm",
            fix="Record one performer alone, with both sensors not mirrored and in metres.",
        )
    # poses that differ by more than a quarter turn
    opposite = [_residual(each) for each in fits if np.trace(each.pose.rotation.T @ best.pose.rotation) < 1.0]
    if opposite and min(opposite) < MIN_RESIDUAL_RATIO * nearest.residual:
        raise SkeletonLogError(
            where,
            found=f"two opposite poses of the second sensor that fit similarly well "
            f"({100 * nearest.residual:.1f} and {100 * min(opposite):.1f} cm)",
            expected="a motion that distinguishes front and back",
            fix="Record again. Walk towards one sensor and away from it, and lift a knee or reach forward.",
        )
    return best


def _residual(fitted: Alignment) -> float:
    return fitted.residual


def _common_frames(first: SkeletonClip, other: SkeletonClip, clock: float) -> NDArray[np.intp]:
    """Return the frames of the first recording in which half of the joints are known in both."""
    _, trust = sampled(other, first.times + clock)
    return np.flatnonzero(((trust > LOST) & (first.confidence > LOST)).sum(axis=1) >= 10)


def _common_seconds(first: SkeletonClip, other: SkeletonClip, clock: float) -> float:
    """Return the time for which both sensors saw the performer; frames are counted, because there may be gaps."""
    return len(_common_frames(first, other, clock)) * float(np.median(np.diff(first.times)))


def _initial_fit(
    first: SkeletonClip, other: SkeletonClip, clock: float, reverse: bool, effort: tuple[int, int]
) -> Alignment:
    """Fit the recordings, starting from the pose that fits the midpoints of joint pairs, or from the opposite pose.

    The midpoint between a joint and its counterpart does not depend on whether they are swapped.
    """
    chosen = _common_frames(first, other, clock)
    here, (there, trust) = first.positions[chosen], sampled(other, first.times[chosen] + clock)
    trust = (trust * first.confidence[chosen]) ** 2
    here, there, trust = (here + here[:, OPPOSITE]) / 2, (there + there[:, OPPOSITE]) / 2, trust * trust[:, OPPOSITE]
    pose = _fit(there, here, trust)
    if reverse:
        centre = there[trust > LOST].mean(axis=0)
        rotation = pose.rotation @ _HALF_TURN
        pose = SensorPose(rotation, pose.apply(centre) - rotation @ centre)
    return _refined_fit(first, other, pose, clock, effort)


def _refined_fit(
    first: SkeletonClip, other: SkeletonClip, pose: SensorPose, clock: float, effort: tuple[int, int]
) -> Alignment:
    """Fit pose, clock and sides in turn, with a number of rounds and a maximum number of frames."""
    rounds, max_frames = effort
    chosen = _common_frames(first, other, clock)
    seconds = _common_seconds(first, other, clock)
    chosen = chosen[:: 1 + (len(chosen) - 1) // max_frames]
    times, here, trust_here = first.times[chosen], first.positions[chosen], first.confidence[chosen] ** 2.0
    # The velocities do not use the frame itself, so their noise is independent of the positions' noise.
    before, _ = sampled(first, times - _VELOCITY_STEP_SECONDS)
    after, _ = sampled(first, times + _VELOCITY_STEP_SECONDS)
    velocity = np.nan_to_num((after - before) / (2 * _VELOCITY_STEP_SECONDS))
    rows = np.arange(len(times))[:, None]
    residual, swapped = np.inf, np.zeros(len(times), dtype=bool)
    for _ in range(rounds):
        there, trust = sampled(other, times + clock)
        moved = pose.apply(there)
        swapped = _mean_distance(moved[:, OPPOSITE], here) < _mean_distance(moved, here)
        side = np.where(swapped[:, None], OPPOSITE, np.arange(len(OPPOSITE)))
        there, moved, trust = (each[rows, side] for each in (there, moved, trust))
        apart = np.nan_to_num(np.linalg.norm(moved - here, axis=2))
        weights = trust_here * trust**2
        residual = float((weights * apart).sum() / weights.sum())
        weights /= (1 + (apart / max(2 * residual, 1e-9)) ** 2) ** 2
        pose = _fit(there, here, weights)
        # If the joints are behind their own motion, so is the clock.
        behind = np.nan_to_num(here - pose.apply(there))
        speed = float((weights * (velocity**2).sum(axis=2)).sum())
        clock += float((weights * (behind * velocity).sum(axis=2)).sum()) / max(speed, 1e-9)
    return Alignment(pose, clock, residual, seconds, float(swapped.mean()))


def _fit(points: Array, onto: Array, weights: Array) -> SensorPose:
    known = (weights > 0) & np.isfinite(points).all(axis=2) & np.isfinite(onto).all(axis=2)
    return fit(points[known], onto[known], weights[known])


def _mean_distance(one: Array, other: Array) -> Array:
    """Return the mean distance of the joints in each frame (T,)."""
    apart = np.linalg.norm(one - other, axis=2)
    return np.nansum(apart, axis=1) / np.maximum(np.isfinite(apart).sum(axis=1), 1)
