"""Assigns the performers of one sensor to characters."""

import math
from dataclasses import dataclass, field
from typing import Literal

People = Literal["each", "nearest", "queue"]
"""Policy: performers in order of arrival, the nearest performers, or turns in order of arrival."""

NEARER_METRES = 0.3
"""Distance by which a waiting performer must be nearer than one who drives a character to replace them, in metres."""

NEARER_SECONDS = 1.0
"""Time for which the waiting performer must be nearer, in seconds."""

SMOOTHING_SECONDS = 0.15
"""Time constant with which distances are smoothed, in seconds."""


@dataclass
class Presence:
    """A performer in view.

    Attributes
    ----------
    waits_since : float
        Time of the arrival, or of the end of the last turn.
    seen : float
        Time at which the performer was last tracked.
    distance : float
        Distance from the sensor in metres, smoothed.
    nearer_since : float or None
        Time since which the performer has been nearer than one who drives a character.
    """

    waits_since: float
    seen: float
    distance: float
    nearer_since: float | None = None


@dataclass
class UserAssignment:
    """Assigns performers to characters.

    Attributes
    ----------
    people : {"each", "nearest", "queue"}
    turn : float
        Time after which a performer is replaced while others wait, in seconds; with ``"queue"``.
    performers : list of (int or None)
        User number of each character's performer.
    since : list of float
        Time at which each character's performer was assigned.
    present : dict
        From user numbers to `Presence`.
    chosen : set of int
        Performers who were chosen by a command: they are not replaced before they leave.
    reserved : set of int
        Characters that takes drive: they get no performer.
    """

    people: People
    turn: float
    performers: list[int | None]
    since: list[float] = field(default_factory=list)
    present: dict[int, Presence] = field(default_factory=dict)
    chosen: set[int] = field(default_factory=set)
    reserved: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.since = self.since or [0.0] * len(self.performers)

    def see(self, user: int, time: float, distance: float) -> None:
        """Record that a performer is in view."""
        known = self.present.get(user)
        if known is None:
            self.present[user] = Presence(time, time, distance)
        else:
            known.distance += (1 - math.exp((known.seen - time) / SMOOTHING_SECONDS)) * (distance - known.distance)
            known.seen = time

    def gone(self, user: int) -> None:
        """Record that a performer has left."""
        self.present.pop(user, None)
        self.chosen.discard(user)
        self.performers = [None if performer == user else performer for performer in self.performers]

    def choose(self, character: int, user: int | None, time: float) -> None:
        """Assign a performer to a character; its present performer takes over the other's character, if there is one.

        None frees the character until the next assignment.
        """
        performer = self.performers[character]
        if performer is not None:
            self.chosen.discard(performer)
        if user is not None:
            self.chosen.add(user)
        if user is not None and user in self.performers:
            self._give(self.performers.index(user), performer, time)
        self._give(character, user, time)

    def reserve(self, character: int) -> None:
        """Take a character from its performer, who may get another one."""
        if (performer := self.performers[character]) is not None:
            self.chosen.discard(performer)
        self.performers[character] = None
        self.reserved.add(character)

    def assign(self, time: float) -> None:
        """Assign free characters to waiting performers."""
        if self.people == "queue":
            self._end_turns(time)
        if self.people == "nearest":
            self._make_room_for_nearer(time)
        for character, performer in enumerate(self.performers):
            waiting = self._waiting()
            if performer is None and waiting and character not in self.reserved:
                self._give(character, waiting[0], time)

    def blind(self, seconds: float) -> None:
        """Extend the presence of all performers by a time during which the source sent nothing."""
        for presence in self.present.values():
            presence.seen += seconds

    def rearrange(self, before: list[int | None]) -> None:
        """Replace the characters; `before` has the previous index of each, or None for a new one."""
        self.reserved = {k for k, earlier in enumerate(before) if earlier in self.reserved}
        self.since = [0.0 if k is None else self.since[k] for k in before]
        self.performers = [None if k is None else self.performers[k] for k in before]

    def _give(self, character: int, user: int | None, time: float) -> None:
        self.performers[character], self.since[character] = user, time
        if user in self.present:
            self.present[user].nearer_since = None

    def _waiting(self) -> list[int]:
        """Return the performers without a character, the next one first."""
        idle = [user for user in self.present if user not in self.performers]
        if self.people == "nearest":
            return sorted(idle, key=lambda user: self.present[user].distance)
        return sorted(idle, key=lambda user: self.present[user].waits_since)

    def _end_turns(self, time: float) -> None:
        """Move performers whose turn is over to the end of the queue, as far as others wait."""
        by_age = sorted(range(len(self.performers)), key=lambda character: self.since[character])
        for character, _ in zip(by_age, self._waiting(), strict=False):
            performer = self.performers[character]
            over = time - self.since[character] >= self.turn
            if performer is not None and performer not in self.chosen and over:
                self.present[performer].waits_since = time
                self._give(character, None, time)

    def _make_room_for_nearer(self, time: float) -> None:
        """Free the farthest performer's character if a waiting one has been nearer for `NEARER_SECONDS`."""
        playing = [user for user in self.performers if user in self.present and user not in self.chosen]
        free = (k for k, performer in enumerate(self.performers) if performer is None and k not in self.reserved)
        if not playing or next(free, None) is not None:
            return
        farthest = max(playing, key=lambda user: self.present[user].distance)
        limit = self.present[farthest].distance - NEARER_METRES
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
        if since is not None and time - since >= NEARER_SECONDS:
            self.present[nearest].nearer_since = None
            self._give(self.performers.index(farthest), None, time)
