"""The effect of smoothing settings on a joint: remaining noise, lag, and step response (docs/smoothing.md)."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINTS
from capture.smoothing import FRAMES_PER_SECOND, JointFilter, Smoothing
from engine_bridge.studio.messages.performers import SmoothingReply

NOISE_METRES, STEP_METRES, SPEED = 0.005, 0.3, 1.0
"""Standard deviation of the noise in metres, height of the step in metres, and speed in metres per second."""

NOISE_FRAMES, START_FRAMES = 1200, 300
"""Number of frames over which the noise is measured, and number of frames before them in which the filter starts."""

SHOWN_FRAMES, STEP_FRAME = 75, 30
"""Number of frames of the curve, and number of the frame with the step."""

SETTLED_SHARE = 0.9
"""Share of the step at which the rise time ends."""

MIN_FRAMES = 15
"""Minimum number of frames of a live joint for its noise and lag to be computed."""

MOVED_METRES = 0.05
"""Extent of a joint's motion below which its lag is not computed, in metres."""

MAX_LAG_SECONDS = 0.4
"""Largest lag of a live joint that is detected, in seconds; a prediction of up to half of it is detected too."""


def preview(smoothing: Smoothing) -> SmoothingReply:
    """Return the effect of smoothing settings on a test signal at 30 Hz."""
    noise = _noise()
    steps = np.where(np.arange(SHOWN_FRAMES + 300) < STEP_FRAME, 0.0, STEP_METRES)
    ramp = np.maximum(np.arange(300) - 10, 0) * SPEED / FRAMES_PER_SECOND
    response = _filtered(smoothing, _along_x(steps))[STEP_FRAME:, 0, 0]
    lag = (ramp - _filtered(smoothing, _along_x(ramp))[:, 0, 0])[-1] / SPEED
    left = _filtered(smoothing, noise)[START_FRAMES:].std()
    made = np.flatnonzero(response >= SETTLED_SHARE * STEP_METRES)
    shown = _along_x(steps[:SHOWN_FRAMES]) + noise[:SHOWN_FRAMES]
    return SmoothingReply(
        times=(np.arange(SHOWN_FRAMES) / FRAMES_PER_SECOND).tolist(),
        measured=shown[:, 0, 0].tolist(),
        smoothed=_filtered(smoothing, shown)[:, 0, 0].tolist(),
        measured_mm=NOISE_METRES * 1e3,
        jitter_mm=float(left * 1e3),
        lag_ms=float(lag * 1e3),
        rise_ms=None if not len(made) else float(made[0] / FRAMES_PER_SECOND * 1e3),
        overshoot_mm=float((response.max() - STEP_METRES) * 1e3),
    )


def preview_of(smoothing: Smoothing, times: Sequence[float], positions: Sequence[Sequence[float]]) -> SmoothingReply:
    """Return the effect of smoothing settings on a measured joint.

    Noise is computed from third differences, to which motion contributes little: for white noise, their standard
    deviation is √20 times as large. The median of their magnitudes is used, because a few frames of fast motion would
    dominate a mean.

    Parameters
    ----------
    smoothing : Smoothing
    times : sequence of float
        Seconds; at least `MIN_FRAMES`.
    positions : sequence of (x, y, z)
        Metres.
    """
    measured, at = np.asarray(positions, dtype=np.float64), np.asarray(times, dtype=np.float64)
    joint_filter, tracked = JointFilter(smoothing), np.ones(len(JOINTS), dtype=np.float32)
    repeated = np.repeat(measured[:, None], len(JOINTS), axis=1)
    smoothed = np.array([joint_filter.step(t, each, tracked)[0] for t, each in zip(at, repeated, strict=True)])
    axis = int(np.ptp(measured, axis=0).argmax())
    return SmoothingReply(
        times=(at - at[0]).tolist(),
        measured=measured[:, axis].tolist(),
        smoothed=smoothed[:, axis].tolist(),
        measured_mm=_jitter(measured) * 1e3,
        jitter_mm=_jitter(smoothed) * 1e3,
        lag_ms=_lag(at, measured, smoothed),
        rise_ms=None,
        overshoot_mm=None,
    )


def _jitter(positions: NDArray[np.float64]) -> float:
    """Return the noise of a path (frames, 3) per axis, in its unit; a normal deviate's median magnitude is 0.6745."""
    return float(np.median(np.abs(np.diff(positions, n=3, axis=0))) / (0.6745 * np.sqrt(20)))


def _lag(times: NDArray[np.float64], measured: NDArray[np.float64], smoothed: NDArray[np.float64]) -> float | None:
    """Return the shift at which a smoothed path fits the measured one best, in milliseconds; None without motion."""
    if np.ptp(measured, axis=0).max() < MOVED_METRES:
        return None
    shifts = np.arange(-MAX_LAG_SECONDS / 2, MAX_LAG_SECONDS, 0.002)
    inside = times[(times >= times[0] + MAX_LAG_SECONDS) & (times <= times[-1] - MAX_LAG_SECONDS / 2)]

    def misfit(shift: float) -> float:
        earlier = [np.interp(inside - shift, times, path) for path in measured.T]
        now = [np.interp(inside, times, path) for path in smoothed.T]
        return float(np.square(np.subtract(earlier, now)).sum())

    return float(shifts[np.argmin([misfit(shift) for shift in shifts])] * 1e3)


@lru_cache(1)
def _noise() -> NDArray[np.float64]:
    """Return noise (frames, 20, 3), the same every time."""
    return np.random.default_rng(0).normal(scale=NOISE_METRES, size=(START_FRAMES + NOISE_FRAMES, len(JOINTS), 3))


def _along_x(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions (frames, 20, 3) of joints that all move along x."""
    return x[:, None, None] * np.array([1.0, 0.0, 0.0]) * np.ones((1, len(JOINTS), 1))


def _filtered(smoothing: Smoothing, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smoothed positions (frames, 20, 3)."""
    joint_filter, tracked = JointFilter(smoothing), np.ones(len(JOINTS), dtype=np.float32)
    return np.array([joint_filter.step(k / FRAMES_PER_SECOND, each, tracked) for k, each in enumerate(positions)])
