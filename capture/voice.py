"""The channel ``voice``: how loud somebody speaks, from 0 to 1, whatever the microphone and the room.

The level is the root mean square of short windows in decibels, between about 150 Hz and 4 kHz. The noise floor falls
with the level immediately and rises slowly, so that it is that of the pauses; the loudest level falls slowly. The
channel is 0 up to `MARGIN` above the floor and 1 near the loudest level, with a fast attack and a slower release.
"""

import math

import numpy as np
from numpy.typing import NDArray

STEP_SECONDS = 0.01
"""Interval of the channel's values, in seconds."""

SLOW_SECONDS = 0.004
"""Length of the moving average that is subtracted: hum and rumble below about 150 Hz vary too much to be a floor."""

WINDOW_STEPS = 2
"""Length of a window, in steps."""

MARGIN = 10.0
"""Level above the noise floor up to which the channel is 0, in decibels: noise varies by some decibels."""

LEAST_RANGE = 15.0
"""Least distance from there to the level at which the channel is 1, in decibels, so that whispers open little."""

SILENCE, FIRST_FLOOR = -85.0, -50.0
"""Level below which there is no signal, in decibels of full scale, and the noise floor that is assumed after it."""

FLOOR_RISE, PEAK_FALL = 1.5, 2.0
"""Speeds at which the floor rises and the loudest level falls, in decibels per second."""

FLOOR_FALL_SECONDS, ATTACK_SECONDS, RELEASE_SECONDS = 0.05, 0.015, 0.045
"""Time constants with which the floor falls, and the channel rises and falls."""


class Voice:
    """Follows the loudness of a sound that arrives in blocks; the result does not depend on their sizes.

    Parameters
    ----------
    rate : int
        Samples per second.
    """

    def __init__(self, rate: int) -> None:
        self._step = round(rate * STEP_SECONDS)
        self._mean = max(round(rate / 8000), 1)
        self._slow = round(SLOW_SECONDS * rate / self._mean)
        self._before = np.zeros(self._slow - 1)
        self._left = np.zeros(0, np.float32)
        self._powers: list[float] = []
        self._floor: float | None = None
        self._peak, self._value = -math.inf, 0.0

    def add(self, samples: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the values (k,) of the steps that the samples (n,) complete."""
        self._left = np.concatenate([self._left, samples.astype(np.float32)])
        count = len(self._left) // self._step
        if not count:
            return np.zeros(0, np.float32)
        steps = self._left[: count * self._step].reshape(count, self._step).astype(np.float64)
        self._left = self._left[count * self._step :]
        groups = self._step // self._mean
        low = steps[:, : groups * self._mean].reshape(count * groups, self._mean).mean(axis=1)
        low = np.concatenate([self._before, low])
        self._before = low[count * groups :]
        around = np.lib.stride_tricks.sliding_window_view(low, self._slow)
        heard = around[:, self._slow // 2] - around.mean(axis=1)
        powers = (heard.reshape(count, groups) ** 2).mean(axis=1)
        return np.array([self._next(float(power)) for power in powers], np.float32)

    def _next(self, power: float) -> float:
        self._powers = [*self._powers[1 - WINDOW_STEPS :], power]
        level = 10 * np.log10(max(sum(self._powers) / len(self._powers), 1e-12))
        if self._floor is None:
            self._floor = level if level > SILENCE else FIRST_FLOOR
        if level > self._floor:
            self._floor += min(FLOOR_RISE * STEP_SECONDS, level - self._floor)
        elif level > SILENCE:
            self._floor += (level - self._floor) * STEP_SECONDS / FLOOR_FALL_SECONDS
        opens = self._floor + MARGIN
        self._peak = max(self._peak - PEAK_FALL * STEP_SECONDS, level)
        reach = max(self._peak - opens, LEAST_RANGE)
        target = min(max((level - opens) / (0.8 * reach), 0.0), 1.0)
        seconds = ATTACK_SECONDS if target > self._value else RELEASE_SECONDS
        self._value += (target - self._value) * (1 - np.exp(-STEP_SECONDS / seconds))
        return self._value


def voice_of(samples: NDArray[np.floating], rate: int, times: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the channel at times (T,) of a sound (n,), in seconds; 0 outside it."""
    values = Voice(rate).add(samples)
    centres = (np.arange(len(values)) + 0.5) * STEP_SECONDS
    return (
        np.interp(times, centres, values, left=0.0, right=0.0).astype(np.float32)
        if len(values)
        else np.zeros(len(times), np.float32)
    )
