"""Eases handles and bones from where they are shown to what they follow, so that nothing ever jumps."""

import math

import numpy as np
from numpy.typing import NDArray

from capture.events import TICK_SECONDS
from engine_bridge.performance.idle import TargetPose
from solver.model.bones import Bones
from solver.motion.motion_blend import difference, moved_by

MAX_STEP_SECONDS = 2 * TICK_SECONDS
"""Maximum time between two frames by which easing continues, in seconds; after a longer pause it would jump."""


class Easing:
    """What is shown of the handles, bones and root of a character.

    Parameters
    ----------
    bones : Bones
        Bones of the deformer.
    rest : TargetPose
        Shown first.
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
        """Ease from what is shown to what is followed from now on."""
        self._start, self.since, self._apart = self.shown, time, None

    def finished(self, time: float) -> bool:
        """Tell whether the last easing is over."""
        return time - self.since >= self.seconds

    def show(self, time: float, places: TargetPose) -> TargetPose:
        """Return the places to show at a time, on the way to those that are followed."""
        if math.isfinite(self.since):
            self.since += max(0.0, time - max(self.shown_at, self.since) - MAX_STEP_SECONDS)
        share = min((time - self.since) / self.seconds, 1.0) if self.seconds > 0 else 1.0
        if share < 1.0:
            places = self._between(places, share * share * (3.0 - 2.0 * share))
        self.shown, self.shown_at = places, time
        return places

    def _between(self, places: TargetPose, share: float) -> TargetPose:
        """Return the places after a share of the way.

        The rest of the way is a rotation relative to the one that a bone follows, computed once per easing: a bone that
        follows beyond a half turn would jump otherwise.
        """
        start = self._start
        if self._apart is None:
            self._apart = difference(self._bones, places.motions, start.motions)
        return TargetPose(
            start.targets + share * (places.targets - start.targets),
            moved_by(self._bones, places.motions, self._apart, 1.0 - share),
            start.root + share * (places.root - start.root),
        )
