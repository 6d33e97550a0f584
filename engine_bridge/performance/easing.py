"""Eases handles and bones from the pose that is shown into the pose that they follow, so that nothing ever jumps."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.events import TICK_SECONDS
from solver.model.bones import Bones
from solver.motion.motion_blend import difference, moved_by

MAX_STEP_SECONDS = 2 * TICK_SECONDS
"""Maximum time by which easing continues from one frame to the next, in seconds.

After a longer pause, the rest of the pause does not count, because the character would jump.
"""


EASE_SECONDS = 0.8
"""Default duration of an easing, in seconds."""


class TargetPose(NamedTuple):
    """Pose that a character's handles and bones are moved to.

    Attributes
    ----------
    targets : (h, 3) float64
        Positions of the handles without the root's motion, mesh file's coordinates.
    motions : (b, 4, 3) float64
        Motions of the bones without the root's motion.
    root : (3,) float64
        The root's translation.
    """

    targets: NDArray[np.float64]
    motions: NDArray[np.float64]
    root: NDArray[np.float64]


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
            places = self._between(places, share * share * (3.0 - 2.0 * share))
        self.shown, self.shown_at = places, time
        return places

    def _between(self, places: TargetPose, share: float) -> TargetPose:
        """Return the pose after a share of the way.

        The rest of the way is a rotation relative to the one that a bone follows. It is computed once per easing;
        otherwise a bone would jump when the rotation that it follows passes a half turn.
        """
        start = self._start
        if self._apart is None:
            self._apart = difference(self._bones, places.motions, start.motions)
        return TargetPose(
            start.targets + share * (places.targets - start.targets),
            moved_by(self._bones, places.motions, self._apart, 1.0 - share),
            start.root + share * (places.root - start.root),
        )
