"""What a smoothing does to a joint: noise that is left, lag, and the response to a step (docs/smoothing.md)."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINTS
from capture.smoothing import FRAMES_PER_SECOND, JointFilter, Smoothing
from engine_bridge.studio.messages import SmoothingReply

NOISE_METRES, STEP_METRES, SPEED = 0.005, 0.3, 1.0
"""Standard deviation of the noise in metres, height of the step in metres, and speed in metres per second."""

NOISE_FRAMES, START_FRAMES = 1200, 300
"""Number of frames over which the noise is measured, after those in which the filter starts."""

SHOWN_FRAMES, STEP_FRAME = 75, 30
"""Number of frames of the curve, and that of the step in it."""

SETTLED_SHARE = 0.9
"""Share of the step after which it counts as made."""


def preview(smoothing: Smoothing) -> SmoothingReply:
    """Return the effect of a smoothing at 30 Hz."""
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
        jitter_mm=float(left * 1e3),
        lag_ms=float(lag * 1e3),
        rise_ms=None if not len(made) else float(made[0] / FRAMES_PER_SECOND * 1e3),
        overshoot_mm=float((response.max() - STEP_METRES) * 1e3),
    )


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
