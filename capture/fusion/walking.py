"""Which way somebody walks: forwards, so it tells front from back where sensors cannot."""

import cmath
import math

import numpy as np

from capture.skeleton import JOINT_INDEX, SkeletonFrame

PACE = 0.6
"""Metres a second from which somebody walks."""
ENOUGH = 2.0
"""Metres, backwards more than forwards, from which front and back have been mistaken for each other: people step back
as well, but not as fast for as long."""
ALONG = 0.7
"""Cosine to the way that a body faces from which it walks that way and not sideways."""
STEADY = 0.3
"""Seconds over which a speed is a mean: whoever sways or jumps does not walk."""
GAP = 0.5
"""Seconds between frames after which it begins anew."""

_CORNERS = [JOINT_INDEX[name] for name in ("shoulder_left", "hip_left", "shoulder_right", "hip_right")]
_MIDDLE_AND_ACROSS = np.array([[0.25, 0.25, 0.25, 0.25], [-0.5, -0.5, 0.5, 0.5]])


class Walk:
    """How somebody walks.

    Attributes
    ----------
    forwards : float
        Metres, those walked backwards taken off. More than `ENOUGH` is not kept.
    """

    def __init__(self) -> None:
        self.forwards = 0.0
        self._time, self._place, self._velocity = -math.inf, 0j, 0j  # on the floor: x, and z times i

    def follow(self, frame: SkeletonFrame) -> None:
        """Take in the next frame; it says nothing where shoulders or hips are not known."""
        (x, _, z), (right, _, back) = (_MIDDLE_AND_ACROSS @ frame.positions[_CORNERS]).tolist()
        place, ahead = complex(x, z), complex(back, -right)
        if not ahead or not cmath.isfinite(place + ahead):
            return
        seconds, moved = frame.time - self._time, place - self._place
        self._time, self._place = frame.time, place
        if seconds > GAP:
            self.forwards, self._velocity = 0.0, 0j
            return
        self._velocity += (1 - math.exp(-seconds / STEADY)) * (moved / seconds - self._velocity)
        speed = (self._velocity * ahead.conjugate()).real / abs(ahead)
        if abs(speed) > max(PACE, ALONG * abs(self._velocity)):
            self.forwards = min(self.forwards + speed * seconds, ENOUGH)
