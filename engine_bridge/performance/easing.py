"""Eases handles and bones from the pose that is shown into the pose that they follow, so that nothing ever jumps."""

import math

import numpy as np
from numpy.typing import NDArray

from capture.events import TICK_SECONDS
from engine_bridge.performance.pose import TargetPose, between, difference_of, smoothstep
from solver.model.bones import Bones

MAX_STEP_SECONDS = 2 * TICK_SECONDS
"""Maximum time by which easing continues from one frame to the next, in seconds.

After a longer pause, the rest of the pause does not count, because the character would jump.
"""


EASE_SECONDS = 0.8
"""Default duration of an easing, in seconds."""


class Easing:
    """The pose of handles, bones and root that is shown of a character.

    Parameters
    ----------
    bones : Bones
        Bones of the deformer.
    rest : TargetPose
        Pose that is shown first.
    seconds : float
        Duration of an easing.

    Attributes
    ----------
    shown : TargetPose
    shown_at : float
        Time of the last frame.
    since : float
        Time at which the last easing began.
    """

    def __init__(self, bones: Bones, rest: TargetPose, seconds: float) -> None:
        self.seconds = seconds
        self.shown = self._start = rest
        self.shown_at = self.since = -math.inf
        self._bones = bones
        self._apart: NDArray[np.float64] | None = None  # from what bones follow to where they eased from

    def begin(self, time: float) -> None:
        """Ease from the pose that is shown into the one that is followed from now on."""
        self._start, self.since, self._apart = self.shown, time, None

    def finished(self, time: float) -> bool:
        """Tell whether the last easing is over."""
        return time - self.since >= self.seconds

    def show(self, time: float, places: TargetPose) -> TargetPose:
        """Return the pose to show at a time, on the way to the one that is followed."""
        if math.isfinite(self.since):
            self.since += max(0.0, time - max(self.shown_at, self.since) - MAX_STEP_SECONDS)
        share = min((time - self.since) / self.seconds, 1.0) if self.seconds > 0 else 1.0
        if share < 1.0:
            if self._apart is None:
                self._apart = difference_of(self._bones, places, self._start)
            places = between(self._bones, self._start, places, smoothstep(share), self._apart)
        self.shown, self.shown_at = places, time
        return places
