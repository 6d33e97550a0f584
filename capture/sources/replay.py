"""Recordings as live sources: ``replay:FILE`` and ``demo:NAME``.

A take of a stage, which begins with the cue ``stage``, yields exactly the events that were recorded. In other
recordings, ticks fill gaps that are longer than `MAX_SILENCE_SECONDS`, so that a character continues to ease and wait.

The clock of the events is the recording's. It starts with the first call of `receive` and runs like the monotonic
clock. If the caller is late by more than `MAX_LATENESS_SECONDS`, the recording's clock is delayed instead of skipping
ahead.
"""

import logging
import math
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from heapq import merge
from itertools import chain, count
from operator import attrgetter
from pathlib import Path
from typing import Self

import numpy as np

from capture.clip import SkeletonClip
from capture.events import TICK_SECONDS, Cue, Event, Lost, Tick
from capture.formats import puppetline_log, read_log, recognize
from capture.skeleton import MAX_DISTANCE_METRES, SkeletonFrame
from capture.source import Counts
from puppetline import clock
from puppetline.errors import PuppetlineError, RecordingEndError, SkeletonLogError, SourceError

log = logging.getLogger(__name__)

MAX_SILENCE_SECONDS = 3 * TICK_SECONDS
"""Maximum gap in a recording that is not filled with ticks; slow sensors send 10 frames per second."""

MAX_LATENESS_SECONDS = 1.0
"""Maximum lateness of a caller who still receives all events that are due."""

MAX_EVENTS = 1000
"""Maximum number of events per call of `receive`."""


class RecordingSource:
    """A recording as a `capture.source.SkeletonSource`.

    Parameters
    ----------
    name : str
        The URI.
    play : callable
        Function that returns the recording's events from the start.
    loop : bool
        Whether to play in a loop. The first pass has the recording's times; in later passes, times continue to
        increase.

    Raises
    ------
    SourceError
        The recording has no event.
    """

    def __init__(self, name: str, play: Callable[[], Iterable[Event]], loop: bool) -> None:
        self.name = name
        self.counts = Counts()
        self.recorded = True
        self._play = play
        self._events = self._passes() if loop else self.events()
        self._end: PuppetlineError = SourceError(
            name, found="a recording without frames", expected="frames of a performer", fix="Record again."
        )
        self._next = self._next_event()
        if self._next is None:
            raise self._end
        self._end = RecordingEndError(
            name, found="the end of the recording", expected="more frames", fix="Add ?loop to play it in a loop."
        )
        self._last_time = self._next.time
        self._started_at: float | None = None  # on the monotonic clock, when the recording's clock was at _start
        self._start = self._next.time

    @classmethod
    def of_file(cls, name: str, path: Path, loop: bool = False) -> Self:
        """Play a recording in any supported format, with all its performers.

        A take is read while it plays, other formats at the start.

        Raises
        ------
        SkeletonLogError
            The format is unknown or violated; in a take, only as far as its first event.
        SourceError
            The recording has no event.
        """
        if recognize(path) is not puppetline_log:
            return cls.of_clips(name, read_log(path), loop)
        if puppetline_log.has_old_state(path):
            log.warning("%s: recorded by an earlier version: performers are calibrated again", path)
        return cls(name, lambda: _checked_events(path), loop)

    @classmethod
    def of_clips(cls, name: str, clips: Sequence[SkeletonClip], loop: bool = False) -> Self:
        """Play the clips of several performers together.

        Raises
        ------
        SourceError
            The clips have no frame.
        """
        return cls(name, lambda: merge(*(clip.frames() for clip in clips), key=attrgetter("time")), loop)

    def fileno(self) -> None:
        """Return None, because a recording has no file descriptor to wait for."""
        return

    def due(self) -> float:
        """Return the time of the next event on the monotonic clock."""
        if self._next is None or self._started_at is None:
            return clock.now()
        return self._started_at + (self._next.time - self._start)

    def now(self) -> float:
        """Return the time on the recording's clock, between the last event and the next one."""
        if self._started_at is None:
            return self._start
        now = max(self._last_time, self._start + (clock.now() - self._started_at))
        return now if self._next is None else min(now, self._next.time)

    def receive(self) -> list[Event]:
        """Return all events that are due, in order.

        Raises
        ------
        SourceError
            The recording has ended, or its next event cannot be read.
        """
        now = clock.now()
        if self._next is None:
            raise self._end
        if self._started_at is None or now - self.due() > MAX_LATENESS_SECONDS:
            self._started_at, self._start = now, self._next.time
        events: list[Event] = []
        while self._next is not None and self.due() <= now and len(events) < MAX_EVENTS:
            events.append(self._next)
            self._next = self._next_event()
        if events:
            self._last_time = events[-1].time
            self.counts.received += len(events)
        return events

    def close(self) -> None:
        """Close the file."""
        self._next = None
        self._events.close()

    def _passes(self) -> Generator[Event, None, None]:
        """Yield the events of one pass after the other. A pass begins one tick after the end of the pass before.

        Between two passes all performers leave, because they would jump from their last positions to their first.
        """
        end: float | None = None
        while True:
            start, shift = end, 0.0
            users: set[int] = set()
            for k, event in enumerate(self.events()):
                if start is not None and k == 0:
                    shift = start + TICK_SECONDS - event.time
                if isinstance(event, SkeletonFrame):
                    users.add(event.user)
                yield replace(event, time=event.time + shift) if shift else event
                end = event.time + shift
            if end is None or end == start:
                return
            for user in sorted(users):
                yield Lost(end, user, again=True)

    def events(self) -> Generator[Event, None, None]:
        """Yield the events of the whole recording from its start, without waiting.

        Raises
        ------
        SkeletonLogError
            During the iteration, if an event cannot be read.
        """
        events = _increasing(self._play(), self.counts.refused)
        for first in events:
            rest = chain([first], events)
            yield from rest if isinstance(first, Cue) and first.do == "stage" else _with_ticks(rest)

    def _next_event(self) -> Event | None:
        try:
            return next(self._events, None)
        except SkeletonLogError as error:
            self._end = SourceError(error.where, found=error.found, expected=error.expected, fix=error.fix)
            return None


def _checked_events(path: Path) -> Iterator[Event]:
    """Yield a take's events; raise an error for positions that no sensor measures."""
    for event in puppetline_log.events(path):
        if isinstance(event, SkeletonFrame) and (np.abs(event.positions) > MAX_DISTANCE_METRES).any():
            raise SkeletonLogError(
                path,
                found=f"a joint {np.nanmax(np.abs(event.positions)):.4g} m away at second {event.time:g}",
                expected=f"a position within {MAX_DISTANCE_METRES:g} m of the sensor",
                fix="Correct or delete that frame.",
            )
        yield event


def _with_ticks(events: Iterable[Event]) -> Generator[Event, None, None]:
    """Yield events, and ticks in gaps longer than `MAX_SILENCE_SECONDS`."""
    before = math.inf
    for event in events:
        if event.time - before > MAX_SILENCE_SECONDS:
            for k in count(1):
                tick = before + k * TICK_SECONDS
                if tick >= event.time:
                    break
                yield Tick(tick)
        yield event
        before = event.time


def _increasing(events: Iterable[Event], refused: Counter[str]) -> Generator[Event, None, None]:
    """Yield the events whose times increase. In a take that was continued after a restart, times may go back."""
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
