"""Channels: named numbers from 0 to 1 beside the joints, such as how loud the performer speaks."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

CHANNELS = (
    "voice",
    "mouth_open",
    "mouth_wide",
    "smile",
    "blink_left",
    "blink_right",
    "brow_up",
    "hand_open_left",
    "hand_open_right",
    "point_left",
    "point_right",
)
"""Names of channels; left and right are the performer's.

``voice`` is measured by `capture.voice`, the others by `capture.trackers.face` and `capture.trackers.hands`.
Senders (`capture.network.channels`) and recordings of the Kinect v2 (`capture.formats`) have some of them too.
"""

FINGERS = ("thumb", "index", "middle", "ring", "little")

FINGER_CHANNELS = tuple(
    f"{finger}_{joint}_{side}" for side in ("left", "right") for finger in FINGERS for joint in (1, 2, 3)
)
"""Names of the channels of the joints of fingers, from the palm to the tip: how far each is bent."""

ALL_CHANNELS = CHANNELS + FINGER_CHANNELS

FULL_BEND_DEGREES = 120.0
"""Bend of a finger's joint from the flat hand at which its channel is 1."""


class SmoothedChannels:
    """Channels that follow what is measured, and fall to 0 while nothing is.

    Parameters
    ----------
    names : sequence of str
    seconds, lost_seconds : float
        Time constants of the one and of the other, in seconds.
    """

    def __init__(self, names: Sequence[str], seconds: float, lost_seconds: float) -> None:
        self._names, self._seconds, self._lost_seconds = names, seconds, lost_seconds
        self._values, self._time = np.zeros(len(names)), 0.0

    def step(self, time: float, measured: NDArray[np.float64] | None) -> dict[str, float]:
        """Return the channels at a time in seconds, with what is measured then; None for nothing."""
        target, seconds = (0.0, self._lost_seconds) if measured is None else (measured, self._seconds)
        self._values += (target - self._values) * (1 - np.exp(min(self._time - time, 0.0) / seconds))
        self._time = time
        return dict(zip(self._names, self._values.tolist(), strict=True))
