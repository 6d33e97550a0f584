"""Identities of performers: senders exchange and renew their numbers, but a person stays where they are."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.cuts import is_cut
from capture.network.dialect import PerformerPose
from capture.skeleton import LOST

SAME_PLACE_METRES = 0.4
"""Largest distance of the median joint from where a performer was, so that another number is the same person."""

MIN_INTERVAL_SHARE = 0.6
"""Time without a frame of a performer, as a share of that between the last two, after which another number can be
theirs: two people can be at one place, but then frames of both arrive."""

FORGET_SECONDS = 1.0
"""Time after which a performer's place no longer identifies them, and one who is lost is forgotten, in seconds."""


@dataclass(slots=True)
class _Performer:
    """A performer's last pose, its time, and the time between the last two.

    `sent` is the sender's number for them; None after the sender has lost them.
    """

    pose: PerformerPose
    time: float
    interval: float
    sent: int | None


class Identities:
    """Numbers of performers that stay with a person whose number changes, or is exchanged with another's.

    A performer has the sender's first number for them if it is free.
    """

    def __init__(self) -> None:
        self._performers: dict[int, _Performer] = {}

    def user(self, sent: int, pose: PerformerPose, time: float) -> int:
        """Return the user number of the performer with a pose, which is now their last one.

        Parameters
        ----------
        sent : int
            The sender's number.
        pose : (positions, confidence)
        time : float
            Seconds.
        """
        self._performers = {
            user: each
            for user, each in self._performers.items()
            if each.sent is not None or time - each.time < FORGET_SECONDS
        }
        user = self._of(sent)
        known = None if user is None else self._performers[user]
        there = None
        if known is None:
            there = self._at(pose, time, MIN_INTERVAL_SHARE)
        elif time - known.time < FORGET_SECONDS and is_cut(*known.pose, *pose, time - known.time):
            there = self._at(pose, time)
            if there is not None:
                known.sent = self._performers[there].sent
        if there is not None:
            user = there
        elif user is None:
            user = sent
            while user in self._performers and self._performers[user].sent is not None:
                user += 1
        before = self._performers.get(user)
        interval = math.inf if before is None else time - before.time
        self._performers[user] = _Performer(pose, time, interval, sent)
        return user

    def lost(self, sent: int) -> int | None:
        """Return the user number of the performer with a sender's number, who keeps it on return; None for nobody."""
        user = self._of(sent)
        if user is not None:
            self._performers[user].sent = None
        return user

    def _of(self, sent: int) -> int | None:
        return next((user for user, each in self._performers.items() if each.sent == sent), None)

    def _at(self, pose: PerformerPose, time: float, share: float = 0.0) -> int | None:
        """Return the performer who was last where a pose is, and sends no more for a share of their interval."""
        found = {
            user: _distance(each.pose, pose)
            for user, each in self._performers.items()
            if time - each.time < FORGET_SECONDS
            and (each.sent is None or share == 0 or time - each.time > share * each.interval)
        }
        nearest = min(found, key=lambda user: found[user], default=None)
        return nearest if nearest is not None and found[nearest] < SAME_PLACE_METRES else None


def _distance(one: PerformerPose, other: PerformerPose) -> float:
    """Return the distance of the median joint that two poses know; infinite if there is none."""
    known = (one[1] > LOST) & (other[1] > LOST)
    ways: NDArray[np.float64] = (one[0] - other[0])[known]
    return float(np.median(np.linalg.norm(ways, axis=1))) if len(ways) else np.inf
