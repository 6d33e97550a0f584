"""Decides when a performer is calibrated without a command, and in which pose; calibrations that are computed."""

from concurrent.futures import Future
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.performance.calibration import POSE_SECONDS, Calibration, RecentFrames, same_body
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.retargeting import Retargeting

Calibrate = Literal["still", "at_once", "command"]
"""When to calibrate: after the first second without motion; after a moment, in any pose; or only by command."""


@dataclass(frozen=True)
class PreparedCalibration:
    """A calibration, and the retargeting that is computed from it.

    Attributes
    ----------
    calibration : Calibration
    mirror : bool
    asked : float
        Time at which it was requested.
    prepared : PreparedCharacter
        The character when it was requested, whose mapping the retargeting applies.
    working : Future
        Computes the retargeting, which takes a tenth of a second.
    """

    calibration: Calibration
    mirror: bool
    asked: float
    prepared: PreparedCharacter
    working: Future[Retargeting]

    def retargeting(self) -> Retargeting:
        """Return a retargeting without frames so far, once it is computed."""
        return deepcopy(self.working.result())

    def to_json(self) -> dict[str, Any]:
        """Return values of JSON's types, from which `CharacterPlayer.begin` prepares the same calibration."""
        return self.calibration.to_json() | {"mirror": self.mirror}


class AutomaticCalibration:
    """Watches a performer for a pose to calibrate with.

    A limb that follows directions needs no calibration pose. With ``"still"``, a performer of a character with such
    limbs is therefore calibrated after a moment, and again when they first stand still. A returning performer who
    stands still and whose body differs from the one in the calibration is calibrated again.

    Parameters
    ----------
    calibrate : {"still", "at_once", "command"}
    """

    def __init__(self, calibrate: Calibrate) -> None:
        self.calibrate = calibrate
        self._recent = RecentFrames()
        self._returning = False
        self._provisional = False  # calibrated before standing still

    def enter(self, returning: bool) -> None:
        """Watch another performer; a returning one has a calibration already."""
        self._returning, self._provisional = returning, False
        self._recent.clear()

    def forget(self) -> None:
        """Forget the performer's frames so far."""
        self._recent.clear()

    def add(self, frame: SkeletonFrame) -> None:
        """Add a frame of the performer."""
        self._recent.add(frame)

    def present_pose(self) -> NDArray[np.float64] | None:
        """Return the performer's present pose (20, 3) in metres, sensor coordinates; None if too little is known."""
        return self._recent.pose(POSE_SECONDS) if self._recent.cover(0.0) else None

    def due(self, rest: NDArray[np.float64] | None, directs: bool) -> NDArray[np.float64] | None:
        """Return the pose to calibrate with now, if there is one.

        Parameters
        ----------
        rest : (20, 3) float64 or None
            Pose of the performer's calibration; None without a calibration.
        directs : bool
            Whether the character has limbs that follow directions.

        Returns
        -------
        (20, 3) float64 or None
            Metres, sensor coordinates.
        """
        last = self._recent
        if rest is not None:
            return self._again(rest)
        if self.calibrate == "still" and last.is_still():
            return last.pose()
        if (self.calibrate == "at_once" or (self.calibrate == "still" and directs)) and last.cover(POSE_SECONDS):
            self._provisional = self.calibrate == "still"
            return last.pose(POSE_SECONDS)
        return None

    def _again(self, rest: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the pose with which to repeat a performer's calibration; None to keep the calibration."""
        if not (self._provisional or self._returning) or not self._recent.is_still():
            return None
        pose = self._recent.pose()
        if self._provisional:
            self._provisional = False
            return pose
        self._returning = False
        return None if same_body(pose, rest) else pose
