"""Which way somebody walks: forwards, so it tells front from back where sensors cannot."""

import math

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, SkeletonFrame

PACE = 0.6
"""Metres a second. People step back as well, but not as fast for long."""
ENOUGH = 1.0
"""Metres, backwards more than forwards, from which front and back have been mistaken for each other."""
ALONG = 0.7
"""Cosine to the way that a body faces from which it walks that way and not sideways."""
STEADY = 0.3
"""Seconds over which a speed is a mean: whoever sways or jumps does not walk."""
GAP = 0.5
"""Seconds between frames after which it begins anew."""

_LEFT = [JOINT_INDEX[name] for name in ("shoulder_left", "hip_left")]
_RIGHT = [JOINT_INDEX[name] for name in ("shoulder_right", "hip_right")]
_SPINE = JOINT_INDEX["shoulder_center"], JOINT_INDEX["hip_center"]

Array = NDArray[np.float64]


class Walk:
    """How somebody walks.

    Attributes
    ----------
    forwards : float
        Metres, those walked backwards taken off. More than `ENOUGH` is not kept.
    """

    def __init__(self) -> None:
        self.forwards = 0.0
        self._velocity = np.zeros(3)
        self._time, self._place = -math.inf, np.zeros(3)

    def follow(self, frame: SkeletonFrame) -> None:
        """Take in the next frame; it says nothing where shoulders or hips are not known."""
        left, right = frame.positions[_LEFT].mean(axis=0), frame.positions[_RIGHT].mean(axis=0)
        top, bottom = frame.positions[_SPINE, :]
        place, ahead = (left + right) / 2, np.cross(top - bottom, right - left)
        if not np.isfinite(place + ahead).all():
            return
        seconds, moved = frame.time - self._time, place - self._place
        self._time, self._place = frame.time, place
        if seconds > GAP:
            self.forwards, self._velocity = 0.0, np.zeros(3)
            return
        self._velocity += (1 - math.exp(-seconds / STEADY)) * (moved / seconds - self._velocity)
        speed = float(self._velocity @ ahead) / math.hypot(*ahead)
        if abs(speed) > max(PACE, ALONG * math.hypot(*self._velocity)):
            self.forwards = min(self.forwards + speed * seconds, ENOUGH)
