"""The protocol that every source of skeletons implements.

A source never blocks and requires no thread of its caller. The caller waits until the source's file descriptor is
readable or its time is due, and then receives the events::

    while True:
        ready = select([source.fileno()], timeout=source.due() - clock.now())
        for event in source.receive(): …
"""

import select
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from capture.events import TICK_SECONDS, Event, Tick
from capture.skeleton import SkeletonFrame
from puppetline import clock

SENSOR_RECORDINGS = ".oni", ".db3", ".bag"
"""Endings of the names of sensors' own recordings."""

MAX_WAIT_SECONDS = 1.0
"""Maximum time of one wait, so that the caller's reports continue without events."""


@dataclass
class Counts:
    """Counts of a source's input.

    Attributes
    ----------
    received : int
        Packets, or events of a recording.
    dropped : int
        Complete frames that were not used, because newer ones of the same performer had arrived or were too many.
    refused : Counter
        Refused packets and messages by reason. The reasons are a closed set.
    """

    received: int = 0
    dropped: int = 0
    refused: Counter[str] = field(default_factory=Counter)

    def add(self, before: "Counts") -> None:
        """Add the counts of an earlier source with the same name."""
        self.received += before.received
        self.dropped += before.dropped
        self.refused.update(before.refused)


class SkeletonSource(Protocol):
    """A source of performers' frames.

    Attributes
    ----------
    name : str
        The URI.
    counts : Counts
    recorded : bool
        Whether the source is a recording, which ends.
    """

    name: str
    counts: Counts
    recorded: bool

    def fileno(self) -> int | None:
        """Return a file descriptor that becomes readable when an event arrives, or None if only `due` matters."""

    def due(self) -> float:
        """Return the time, of `puppetline.clock`, at which to call `receive` without an arrival; infinity for never."""

    def now(self) -> float:
        """Return the time in seconds on the clock of this source's events."""

    def receive(self) -> list[Event]:
        """Return the events since the last call, oldest first, without waiting.

        The times of a performer's frames increase strictly; a frame that is received late has the time at which it
        arrived. Every frame is returned, so that recordings are complete; `newest` drops those that a live character
        does not need. After `capture.events.TICK_SECONDS` without an event, there is a
        tick.

        Raises
        ------
        SourceError
            The source has ended: the recording is over, or the device is disconnected.
        """

    def close(self) -> None:
        """Close sockets and files; closing again does nothing."""


def newest(events: Sequence[Event]) -> list[Event]:
    """Return the events without the frames of a performer before the newest one."""
    last = {event.user: number for number, event in enumerate(events) if isinstance(event, SkeletonFrame)}
    return [
        event
        for number, event in enumerate(events)
        if not isinstance(event, SkeletonFrame) or last[event.user] == number
    ]


def wait(source: SkeletonSource, deadline: float) -> None:
    """Wait for an event, until the source or the deadline is due, at most `MAX_WAIT_SECONDS`."""
    descriptor = source.fileno()
    until = min(source.due(), deadline, clock.now() + MAX_WAIT_SECONDS)
    if descriptor is None:
        clock.sleep_until(until)  # Windows refuses to select from nothing
    else:
        clock.block(until, lambda seconds: select.select([descriptor], [], [], seconds)[0])


class SilentSource:
    """The replacement of a source that has ended or failed: time passes without a performer.

    Parameters
    ----------
    name : str
        The URI of the source.
    counts : Counts
        Counts of the source, which do not change.
    start : float
        Present time on the source's clock, which continues to run.
    """

    recorded = False

    def __init__(self, name: str, counts: Counts, start: float) -> None:
        self.name, self.counts = name, counts
        self._offset = start - clock.now()
        self._last = start

    def fileno(self) -> int | None:
        """Return None, because nothing arrives."""
        return None

    def due(self) -> float:
        """Return the time of the next tick."""
        return self._last + TICK_SECONDS - self._offset

    def now(self) -> float:
        """Return the time on the source's clock."""
        return clock.now() + self._offset

    def receive(self) -> list[Event]:
        """Return a tick if one is due."""
        if clock.now() < self.due():
            return []
        self._last = self.now()
        return [Tick(self._last)]

    def close(self) -> None:
        """Do nothing, because nothing is open."""
