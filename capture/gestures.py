"""Gestures that give commands: both hands raised and held."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, LOST, SkeletonFrame

ABOVE_HEAD_METRES = 0.05
"""Height above the head at which a hand counts as raised, in metres."""

BELOW_SECONDS = 0.3
"""Time for which hands may sink or be lost without ending the gesture, in seconds: sensors lose raised hands."""

_HANDS = [JOINT_INDEX["hand_left"], JOINT_INDEX["hand_right"]]
_WRISTS = [JOINT_INDEX["wrist_left"], JOINT_INDEX["wrist_right"]]
_SHOULDERS = [JOINT_INDEX["shoulder_left"], JOINT_INDEX["shoulder_right"]]
_HEAD = JOINT_INDEX["head"]


@dataclass
class _Arms:
    """The arms of one performer.

    Attributes
    ----------
    since : float or None
        Time since which both hands are raised.
    raised_at : float
        Time at which they were last seen raised.
    lowered : bool
        Whether a hand was below the shoulders since the last gesture.
    """

    since: float | None = None
    raised_at: float = -math.inf
    lowered: bool = True


class HandsUp:
    """Finds performers who hold both hands above their heads.

    After a gesture, a hand must go below the shoulders before the next one.

    Parameters
    ----------
    seconds : float
        Time for which the hands are held.
    """

    def __init__(self, seconds: float = 2.0) -> None:
        self._seconds = seconds
        self._arms: dict[int, _Arms] = {}

    def step(self, frame: SkeletonFrame) -> bool:
        """Return whether a performer's next frame, levelled, completes the gesture."""
        arms = self._arms.setdefault(frame.user, _Arms())
        hands, head = _known(frame, _HANDS, _WRISTS), _known(frame, [_HEAD], [_HEAD])[0]
        if (hands[:, 1] < _known(frame, _SHOULDERS, _SHOULDERS)[:, 1]).any():
            arms.since, arms.lowered = None, True
        elif (hands[:, 1] > head[1] + ABOVE_HEAD_METRES).all():
            arms.since = frame.time if arms.since is None else arms.since
            arms.raised_at = frame.time
        if frame.time - arms.raised_at > BELOW_SECONDS:
            arms.since = None
        if arms.since is None or not arms.lowered or frame.time - arms.since < self._seconds:
            return False
        arms.lowered = False
        return True


def _known(frame: SkeletonFrame, joints: list[int], instead: list[int]) -> NDArray[np.float64]:
    """Return positions (n, 3) of joints, or of others instead of lost ones; NaN if both are lost."""
    found = np.where(frame.confidence[joints, None] > LOST, frame.positions[joints], frame.positions[instead])
    known = np.maximum(frame.confidence[joints], frame.confidence[instead]) > LOST
    return np.where(known[:, None], found, np.nan)
