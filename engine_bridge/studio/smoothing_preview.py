"""What a smoothing does to a joint: noise that is left, lag, and the response to a step (docs/smoothing.md)."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINTS
from capture.smoothing import FRAMES_PER_SECOND, JointFilter, Smoothing
from engine_bridge.studio.messages import SmoothingReply

NOISE_METRES, STEP_METRES, SPEED = 0.005, 0.3, 1.0
"""Standard deviation of the noise in metres, height of the step in metres, and speed in metres per second."""

NOISE_FRAMES, START_FRAMES = 600, 30
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
    response = _filtered(smoothing, steps[:, None])[STEP_FRAME:, 0]
    lag = (ramp - _filtered(smoothing, ramp[:, None])[:, 0])[-1] / SPEED
    left = _filtered(smoothing, noise)[START_FRAMES:].std()
    made = np.flatnonzero(response >= SETTLED_SHARE * STEP_METRES)
    shown = steps[:SHOWN_FRAMES] + noise[:SHOWN_FRAMES, 0]
    return SmoothingReply(
        times=(np.arange(SHOWN_FRAMES) / FRAMES_PER_SECOND).tolist(),
        measured=shown.tolist(),
        smoothed=_filtered(smoothing, shown[:, None])[:, 0].tolist(),
        jitter_mm=float(left * 1e3),
        lag_ms=float(lag * 1e3),
        rise_ms=None if not len(made) else float(made[0] / FRAMES_PER_SECOND * 1e3),
        overshoot_mm=float((response.max() - STEP_METRES) * 1e3),
    )


@lru_cache(1)
def _noise() -> NDArray[np.float64]:
    """Return noise (frames, 20), the same every time."""
    return np.random.default_rng(0).normal(scale=NOISE_METRES, size=(START_FRAMES + NOISE_FRAMES, len(JOINTS)))


def _filtered(smoothing: Smoothing, along_x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (frames, k) the filtered positions of k joints that move along x."""
    frames, count = along_x.shape
    positions = np.zeros((frames, len(JOINTS), 3))
    positions[:, :count, 0] = along_x
    joint_filter, tracked = JointFilter(smoothing), np.ones(len(JOINTS), dtype=np.float32)
    smoothed = [joint_filter.step(k / FRAMES_PER_SECOND, each, tracked) for k, each in enumerate(positions)]
    return np.array(smoothed)[:, :count, 0]
