"""Which way a performer walks: forwards, so it tells front from back where sensors cannot."""

import cmath
import math

import numpy as np

from capture.skeleton import JOINT_INDEX, SkeletonFrame

PACE = 0.6
"""Speed from which a performer walks, in metres per second."""
ENOUGH = 2.0
"""Metres, backwards more than forwards, from which front and back have been mistaken for each other: people step back
as well, but not as fast for as long."""
ALONG = 0.7
"""Cosine to the way that a body faces from which it walks that way and not sideways."""
STRIDE = 0.32
"""Period over which a speed is measured, in seconds (ten frames): a performer who sways or jumps does not walk."""

_CORNERS = [JOINT_INDEX[name] for name in ("shoulder_left", "hip_left", "shoulder_right", "hip_right")]
_MIDDLE_AND_ACROSS = np.array([[0.25, 0.25, 0.25, 0.25], [-0.5, -0.5, 0.5, 0.5]])


class Walk:
    """How a performer walks.

    Attributes
    ----------
    forwards : float
        Metres, those walked backwards taken off. More than `ENOUGH` is not kept.
    """

    def __init__(self) -> None:
        self.forwards = 0.0
        self._time, self._place = -math.inf, 0j  # on the floor: x, and z times i

    def follow(self, frame: SkeletonFrame) -> None:
        """Take in the next frame; it says nothing where shoulders or hips are not known."""
        (x, _, z), (right, _, back) = (_MIDDLE_AND_ACROSS @ frame.positions[_CORNERS]).tolist()
        place, ahead = complex(x, z), complex(back, -right)
        seconds, moved = frame.time - self._time, place - self._place
        if not ahead or not cmath.isfinite(place + ahead) or seconds < STRIDE:
            return
        self._time, self._place = frame.time, place
        if seconds > 2 * STRIDE:  # nothing is known of the time between
            self.forwards = 0.0
            return
        metres = (moved * ahead.conjugate()).real / abs(ahead)
        if abs(metres) > max(PACE * seconds, ALONG * abs(moved)):
            self.forwards = min(self.forwards + metres, ENOUGH)
