"""Joints that a sender has lost, although it repeats their last positions for ever."""

import numpy as np
from numpy.typing import NDArray

from capture.network.dialect import PerformerPose
from capture.skeleton import JOINTS, LOST

FROZEN_SECONDS = 0.5
"""Time without any change after which a joint is frozen, in seconds, if others move: measurements always differ."""

MOVING_SHARE = 0.5
"""Share of a performer's joints that must move, so that the others are frozen and not the whole performer."""


class FrozenJoints:
    """The last positions of one performer's joints, and when each of them last changed."""

    def __init__(self) -> None:
        self._positions = np.full((len(JOINTS), 3), np.nan)
        self._changed = np.full(len(JOINTS), -np.inf)

    def lost(self, pose: PerformerPose, time: float) -> NDArray[np.float32]:
        """Return the confidence (20,) of a pose, in which frozen joints are lost.

        Parameters
        ----------
        pose : (positions, confidence)
        time : float
            Seconds, increasing from call to call.
        """
        positions, confidence = pose
        known = confidence > LOST
        self._changed[known & (positions != self._positions).any(axis=1)] = time
        self._positions[known] = positions[known]
        moving = known & (time - self._changed < FROZEN_SECONDS)
        alive = max(2, MOVING_SHARE * np.count_nonzero(known))
        return np.where(known & ~moving, np.float32(LOST), confidence) if moving.sum() >= alive else confidence
