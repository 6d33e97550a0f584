"""Recorded skeletons given again as a live source gives them: ``replay:FILE`` and ``demo:NAME``.

A take of a stage (one that begins with the cue ``stage``) gives the very events that were recorded. Other recordings
are frames and little else; where they are silent for longer than `GAP`, ticks are put in, so that what waits or eases
goes on.

The clock of the events is the recording's own. It runs as the monotonic clock does from the first call of `receive` on,
and waits for a caller who was away for longer than `PATIENCE`: what comes then is late, and not all at once.
"""

import logging
import math
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from heapq import merge
from itertools import chain, count
from pathlib import Path
from typing import Self

import numpy as np

from capture.clip import SkeletonClip
from capture.events import TICK_SECONDS, Cue, Event, Lost, Tick
from capture.formats import puppetline_log, read_log, recognize
from capture.skeleton import MAX_DISTANCE_METRES, SkeletonFrame
from capture.source import Counts
from puppetline.errors import PuppetlineError, SkeletonLogError, SourceError

log = logging.getLogger(__name__)

GAP = 3 * TICK_SECONDS
"""Seconds of silence in a recording that are not filled with ticks: slow sensors give 10 frames a second."""

PATIENCE = 1.0
"""Seconds by which a caller may be late and still get all that is due."""

BATCH = 1000
"""Events given at a time, however many a recording has at one moment."""


class RecordingSource:
    """A recording as a `capture.source.SkeletonSource`.

    Parameters
    ----------
    name : str
        The URI that opened it.
    play : callable
        Goes through the recording's events from the start.
    loop : bool
        Whether to play it again when it has ended. The times go on then; those of the first pass are the recording's.

    Raises
    ------
    SourceError
        If the recording has no event.
    """

    def __init__(self, name: str, play: Callable[[], Iterable[Event]], loop: bool) -> None:
        self.name = name
        self.counts = Counts()
        self.recorded = True
        self._play = play
        self.damaged = False
        """Whether it cannot be read any further, though it has not ended."""

        self._events = self._endless() if loop else self._pass()
        self._end: PuppetlineError = SourceError(
            name, found="that it has ended", expected="a recording that goes on", fix="Add ?loop to play it in a loop."
        )
        self._next = self._following()
        if self._next is None:
            raise self._end
        self._given = self._next.time
        self._listening_since: float | None = None  # on the monotonic clock, when the recording's clock was at _start
        self._start = self._next.time

    @classmethod
    def of_file(cls, name: str, path: Path, loop: bool = False) -> Self:
        """Play a take, or a log of any format that `capture.formats` knows, all its performers together.

        A take is read as it is played, any other log at once.

        Raises
        ------
        SkeletonLogError
            No known format, or a file that does not keep to its format; of a take, as far as its first event.
        SourceError
            If there is no event in it.
        """
        if recognize(path) is not puppetline_log:
            return cls.of_clips(name, read_log(path), loop)
        if puppetline_log.has_old_state(path):
            log.warning("%s: recorded by an earlier version: performers are calibrated again", path)
        return cls(name, lambda: _within_reach(path), loop)

    @classmethod
    def of_clips(cls, name: str, clips: Sequence[SkeletonClip], loop: bool = False) -> Self:
        """Play the clips of several performers together, each at its own times.

        Raises
        ------
        SourceError
            If there is no frame in them.
        """
        return cls(name, lambda: merge(*(clip.frames() for clip in clips), key=_time), loop)

    def fileno(self) -> None:
        """Only time matters here."""
        return

    def due(self) -> float:
        """Return when the next event is due, on the monotonic clock."""
        if self._next is None or self._listening_since is None:
            return time.monotonic()
        return self._listening_since + (self._next.time - self._start)

    def now(self) -> float:
        """Return the time on the recording's clock: not before what has been given, nor after what comes next."""
        if self._listening_since is None:
            return self._start
        now = max(self._given, self._start + (time.monotonic() - self._listening_since))
        return now if self._next is None else min(now, self._next.time)

    def receive(self) -> list[Event]:
        """Return the events that are due, every one and in order.

        Raises
        ------
        SourceError
            The recording has ended, or cannot be read any further.
        """
        now = time.monotonic()
        if self._next is None:
            raise self._end
        if self._listening_since is None or now - self.due() > PATIENCE:
            self._listening_since, self._start = now, self._next.time
        events: list[Event] = []
        while self._next is not None and self.due() <= now and len(events) < BATCH:
            events.append(self._next)
            self._next = self._following()
        if events:
            self._given = events[-1].time
            self.counts.received += len(events)
        return events

    def close(self) -> None:
        """Let go of the file."""
        self._next = None
        self._events.close()

    def _endless(self) -> Generator[Event, None, None]:
        """Play again and again, each pass beginning a tick after the end of the one before.

        In between everybody leaves: they would jump from where the recording ends to where it begins.
        """
        end: float | None = None
        while True:
            start, shift = end, 0.0
            users: set[int] = set()
            for k, event in enumerate(self._pass()):
                if start is not None and k == 0:
                    shift = start + TICK_SECONDS - event.time
                if isinstance(event, SkeletonFrame):
                    users.add(event.user)
                yield replace(event, time=event.time + shift) if shift else event
                end = event.time + shift
            if end is None or end == start:
                return
            for user in sorted(users):
                yield Lost(end, user)

    def _pass(self) -> Generator[Event, None, None]:
        events = _forward(self._play(), self.counts.refused)
        for first in events:
            rest = chain([first], events)
            yield from rest if isinstance(first, Cue) and first.do == "stage" else _with_ticks(rest)

    def _following(self) -> Event | None:
        try:
            return next(self._events, None)
        except SkeletonLogError as error:
            self.damaged = True
            self._end = SourceError(error.where, found=error.found, expected=error.expected, fix=error.fix)
            return None


def _time(event: Event) -> float:
    return event.time


def _within_reach(path: Path) -> Iterator[Event]:
    """Go through a take's events, refusing positions that are no performer's."""
    for event in puppetline_log.events(path):
        if isinstance(event, SkeletonFrame) and (np.abs(event.positions) > MAX_DISTANCE_METRES).any():
            raise SkeletonLogError(
                path,
                found=f"a joint {np.nanmax(np.abs(event.positions)):.4g} m away at second {event.time:g}",
                expected=f"a position within {MAX_DISTANCE_METRES:g} m of the sensor",
                fix="Mend or delete that frame.",
            )
        yield event


def _with_ticks(events: Iterable[Event]) -> Generator[Event, None, None]:
    """Fill what is silent for longer than `GAP` with ticks."""
    before = math.inf
    for event in events:
        if event.time - before > GAP:
            for k in count(1):
                tick = before + k * TICK_SECONDS
                if tick >= event.time:
                    break
                yield Tick(tick)
        yield event
        before = event.time


def _forward(events: Iterable[Event], refused: Counter[str]) -> Generator[Event, None, None]:
    """Leave out what goes back in time, as the later part of a take does that was continued after a restart."""
    latest = -math.inf
    performers: dict[int, float] = {}
    for event in events:
        if event.time < latest or (
            isinstance(event, SkeletonFrame) and event.time <= performers.get(event.user, -math.inf)
        ):
            refused["goes back in time"] += 1
            continue
        latest = event.time
        if isinstance(event, SkeletonFrame):
            performers[event.user] = event.time
        yield event
