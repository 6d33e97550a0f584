"""Direction in which a performer walks. Performers walk forwards, so it distinguishes front and back."""

import cmath
import math

import numpy as np

from capture.skeleton import JOINT_INDEX, SkeletonFrame

WALKING_METRES_PER_SECOND = 0.6
"""Minimum speed that counts as walking."""
MAX_WALK_METRES = 2.0
"""Distance walked backwards at which front and back are considered swapped. Performers also step back, but not as fast
for as long."""
MIN_HEADING_COSINE = 0.7
"""Minimum cosine of the angle between walking and facing; with a smaller one, the performer walks sideways."""
SPEED_PERIOD_SECONDS = 0.32
"""Period over which a speed is measured (ten frames). A performer who sways or jumps does not walk."""

_CORNERS = [JOINT_INDEX[name] for name in ("shoulder_left", "hip_left", "shoulder_right", "hip_right")]
_MIDDLE_AND_ACROSS = np.array([[0.25, 0.25, 0.25, 0.25], [-0.5, -0.5, 0.5, 0.5]])


class Walk:
    """The distance that a performer has walked.

    Attributes
    ----------
    forwards : float
        Metres walked forwards minus metres walked backwards, at most `MAX_WALK_METRES`.
    """

    def __init__(self) -> None:
        self.forwards = 0.0
        self._time, self._place = -math.inf, 0j  # on the floor: x, and z times i

    def follow(self, frame: SkeletonFrame) -> None:
        """Add the next frame. It is skipped if a shoulder or hip is lost."""
        (x, _, z), (right, _, back) = (_MIDDLE_AND_ACROSS @ frame.positions[_CORNERS]).tolist()
        place, ahead = complex(x, z), complex(back, -right)
        seconds, moved = frame.time - self._time, place - self._place
        if not ahead or not cmath.isfinite(place + ahead) or seconds < SPEED_PERIOD_SECONDS:
            return
        self._time, self._place = frame.time, place
        if seconds > 2 * SPEED_PERIOD_SECONDS:  # the motion in the meantime is unknown
            self.forwards = 0.0
            return
        metres = (moved * ahead.conjugate()).real / abs(ahead)
        if abs(metres) > max(WALKING_METRES_PER_SECOND * seconds, MIN_HEADING_COSINE * abs(moved)):
            self.forwards = min(self.forwards + metres, MAX_WALK_METRES)
