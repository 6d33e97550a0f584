"""Who plays which character: several people before one sensor."""

import math
from dataclasses import dataclass, field
from typing import Literal

People = Literal["each", "nearest", "queue"]
"""One character each in the order in which they came; the nearest ones; or turns, in the order in which they came."""

NEARER = 0.3
"""Metres by which somebody must be nearer than a performer to take over."""

FOR_A_WHILE = 1.0
"""Seconds for which they must be."""

STEADY = 0.15
"""Seconds over which a distance is smoothed."""


@dataclass
class Presence:
    """Somebody whom the sensor sees.

    Attributes
    ----------
    waits_since : float
        When they came, or when their last turn ended.
    seen : float
        When they were last seen.
    distance : float
        Metres from the sensor, smoothed.
    nearer_since : float or None
        Since when they have been nearer than a performer.
    """

    waits_since: float
    seen: float
    distance: float
    nearer_since: float | None = None


@dataclass
class UserAssignment:
    """Gives characters to people.

    Attributes
    ----------
    people : {"each", "nearest", "queue"}
    turn : float
        Seconds after which a performer must make room while others wait; with ``"queue"``.
    cast : list of (int or None)
        The user who plays each character.
    since : list of float
        When each of them began.
    present : dict
        From user to `Presence`.
    chosen : set of int
        Those whom somebody chose: nobody takes their place before they leave.
    """

    people: People
    turn: float
    cast: list[int | None]
    since: list[float] = field(default_factory=list)
    present: dict[int, Presence] = field(default_factory=dict)
    chosen: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.since = self.since or [0.0] * len(self.cast)

    def see(self, user: int, time: float, distance: float) -> None:
        """Take note that somebody is there."""
        known = self.present.get(user)
        if known is None:
            self.present[user] = Presence(time, time, distance)
        else:
            known.distance += (1 - math.exp((known.seen - time) / STEADY)) * (distance - known.distance)
            known.seen = time

    def gone(self, user: int) -> None:
        """Take note that somebody has left."""
        self.present.pop(user, None)
        self.chosen.discard(user)
        self.cast = [None if performer == user else performer for performer in self.cast]

    def choose(self, character: int, user: int | None, time: float) -> None:
        """Give a character to somebody, whoever has it now, and they may change places; or to nobody for the moment."""
        performer = self.cast[character]
        if performer is not None:
            self.chosen.discard(performer)
        if user is not None:
            self.chosen.add(user)
        if user is not None and user in self.cast:
            self._give(self.cast.index(user), performer, time)
        self._give(character, user, time)

    def recast(self, time: float) -> None:
        """Bring the cast up to date with who is there."""
        if self.people == "queue":
            self._end_turns(time)
        if self.people == "nearest":
            self._make_room_for_nearer(time)
        for character, performer in enumerate(self.cast):
            waiting = self._waiting()
            if performer is None and waiting:
                self._give(character, waiting[0], time)

    def blind(self, seconds: float) -> None:
        """Do not hold it against anybody that they were not seen while nothing was."""
        for presence in self.present.values():
            presence.seen += seconds

    def rearrange(self, before: list[int | None]) -> None:
        """Take over other characters: for each, which of those so far it was, or None for a new one."""
        self.since = [0.0 if k is None else self.since[k] for k in before]
        self.cast = [None if k is None else self.cast[k] for k in before]

    def _give(self, character: int, user: int | None, time: float) -> None:
        self.cast[character], self.since[character] = user, time
        if user in self.present:
            self.present[user].nearer_since = None

    def _waiting(self) -> list[int]:
        """List those who play nothing, the next one first."""
        idle = [user for user in self.present if user not in self.cast]
        if self.people == "nearest":
            return sorted(idle, key=lambda user: self.present[user].distance)
        return sorted(idle, key=lambda user: self.present[user].waits_since)

    def _end_turns(self, time: float) -> None:
        """Let performers whose turn is over go to the end of the queue, as far as others wait."""
        by_age = sorted(range(len(self.cast)), key=lambda character: self.since[character])
        for character, _ in zip(by_age, self._waiting(), strict=False):
            performer = self.cast[character]
            over = time - self.since[character] >= self.turn
            if performer is not None and performer not in self.chosen and over:
                self.present[performer].waits_since = time
                self._give(character, None, time)

    def _make_room_for_nearer(self, time: float) -> None:
        """Free the farthest performer's character where somebody else has been clearly nearer for a while."""
        playing = [user for user in self.cast if user in self.present and user not in self.chosen]
        if not playing or None in self.cast:
            return
        farthest = max(playing, key=lambda user: self.present[user].distance)
        limit = self.present[farthest].distance - NEARER
        for user in self._waiting():
            presence = self.present[user]
            if presence.distance > limit:
                presence.nearer_since = None
            elif presence.nearer_since is None:
                presence.nearer_since = time
        nearest = next(iter(self._waiting()), None)
        if nearest is None:
            return
        since = self.present[nearest].nearer_since
        if since is not None and time - since >= FOR_A_WHILE:
            self.present[nearest].nearer_since = None
            self._give(self.cast.index(farthest), None, time)
