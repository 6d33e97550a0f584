"""Where live skeletons come from: the protocol that every source follows.

A source never blocks and has no thread that a caller knows of. Whoever runs it waits until its file descriptor can be
read or its time is due, whichever is first, and then takes what has come::

    while True:
        ready = select([source.fileno()], timeout=source.due() - time.monotonic())
        for event in source.receive(): …
"""

import select
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol

from capture.events import TICK_SECONDS, Event, Tick

MAX_WAIT_SECONDS = 1.0
"""Seconds, so that a report goes on while nothing comes."""


@dataclass
class Counts:
    """What a source has seen so far.

    Attributes
    ----------
    received : int
        Packets, or lines of a file.
    dropped : int
        Whole frames that a newer one of the same performer has overtaken before they were taken.
    refused : Counter
        Packets or messages that were not understood, by the reason in a few words. The reasons are a closed set.
    """

    received: int = 0
    dropped: int = 0
    refused: Counter[str] = field(default_factory=Counter)

    def add(self, before: "Counts") -> None:
        """Go on counting where a source of the same name has ended."""
        self.received += before.received
        self.dropped += before.dropped
        self.refused.update(before.refused)


class SkeletonSource(Protocol):
    """Gives what performers do, frame by frame.

    Attributes
    ----------
    name : str
        The URI that opened it.
    counts : Counts
    recorded : bool
        Whether it is a recording, which ends and which nobody performs now.
    """

    name: str
    counts: Counts
    recorded: bool

    def fileno(self) -> int | None:
        """Return what becomes readable when something has come; None where only time matters."""

    def due(self) -> float:
        """Return when `receive` wants to be called though nothing has come: `time.monotonic`, infinity for never."""

    def now(self) -> float:
        """Return the time on the clock of this source's events, seconds."""

    def receive(self) -> list[Event]:
        """Return what has come since the last call, oldest first, without waiting.

        Frames of one performer increase strictly in time. A live source keeps the latest frame of each performer and
        drops what it has overtaken; a recording gives every frame. Where nothing came for
        `capture.events.TICK_SECONDS`, there is a tick.

        Raises
        ------
        SourceError
            It can give no more: a recording has ended, a device is gone for good.
        """

    def close(self) -> None:
        """Let go of sockets and files; closing again does nothing."""


def wait(source: SkeletonSource, deadline: float) -> None:
    """Wait until something has come, or the source or the deadline is due, `time.monotonic`, or a second has passed."""
    seconds = min(source.due(), deadline) - time.monotonic()
    descriptor = source.fileno()
    readable = [] if descriptor is None else [descriptor]
    select.select(readable, [], [], min(max(seconds, 0.0), MAX_WAIT_SECONDS))


class SilentSource:
    """Stands in for a source that has ended or is gone: time passes, and nobody is there.

    Parameters
    ----------
    name : str
        The URI of the source.
    counts : Counts
        Of the source, which stay as they are.
    start : float
        Seconds on the source's clock, which goes on.
    """

    recorded = False

    def __init__(self, name: str, counts: Counts, start: float) -> None:
        self.name, self.counts = name, counts
        self._ahead = start - time.monotonic()
        self._last = start

    def fileno(self) -> int | None:
        """Nothing is ever to be read."""
        return None

    def due(self) -> float:
        """Return when the next tick is due."""
        return self._last + TICK_SECONDS - self._ahead

    def now(self) -> float:
        """Return the time on the source's clock."""
        return time.monotonic() + self._ahead

    def receive(self) -> list[Event]:
        """Return a tick if one is due."""
        if time.monotonic() < self.due():
            return []
        self._last = self.now()
        return [Tick(self._last)]

    def close(self) -> None:
        """Nothing is to be let go of."""
