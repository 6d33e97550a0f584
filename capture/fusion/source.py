"""Several sources as one: the performers that all of them see, each as one skeleton.

Members stand where their poses say. One that fails is opened again, as a service does with a source, while the others
go on. Members are live, or all of them are recordings of one performance: these play together, by their clocks.
"""

import heapq
import math
import selectors
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, TypeGuard

from capture.events import TICK, Cue, Event, Lost, Tick
from capture.fusion.people import People
from capture.pose import Pose
from capture.reconnecting import Reopening
from capture.skeleton import SkeletonFrame
from capture.source import Counts, SkeletonSource
from puppetline.errors import SourceError

LATE = 0.1
"""Seconds by which a frame may come after its time: ticks keep that distance."""
POLLING = 0.005
"""Seconds between looks where the system cannot wait for several members at once."""

_News = SkeletonFrame | Lost | Cue


@dataclass(frozen=True)
class Member:
    """One of several sources.

    Attributes
    ----------
    uri : str
    pose : Pose
        Of its sensor in the common frame.
    clock : float
        Seconds by which its clock, or the moment at which it says what it saw, is ahead of the first one's.
    """

    uri: str
    pose: Pose
    clock: float = 0.0


class FusedSource:
    """Members seen as one source; implements `capture.source.SkeletonSource`.

    Parameters
    ----------
    name : str
        The URI.
    members : sequence of Member
        The first one that sees a performer sets the pace of the performer's frames. What the very first says of how its
        sensor stands (a `Cue` "level") is passed on where its frame is the common one.
    opener : callable
        Opens a member by its URI.
    recorded : bool
        Whether the members are recordings. They are not opened again, and the source ends with the last of them.

    Attributes
    ----------
    name : str
    counts : Counts
        The sum of the members'.

    Raises
    ------
    PuppetlineError
        A member cannot be opened.
    """

    def __init__(
        self, name: str, members: Sequence[Member], opener: Callable[[str], SkeletonSource], recorded: bool = False
    ) -> None:
        self.name = name
        self.counts = Counts()
        self._counted = Counts()
        self.recorded = recorded
        self._people = People()
        self._waiting: list[tuple[float, int, int, _News]] = []  # a heap: time, order, member, what came
        self._order = count()
        self._selector = selectors.DefaultSelector()
        self._ahead: float | None = 0.0 if not recorded else None  # of the recordings' clock; known once they play
        earliest = min(member.clock for member in members)
        self._lines: list[_Line] = []
        try:
            for member in members:
                first = not self._lines
                self._lines.append(_Line(member, member.clock - earliest, opener, first, recorded))
                self._watch(self._lines[-1])
        except BaseException:
            self.close()
            raise
        self._late = LATE + max(line.delay for line in self._lines) * (not recorded)
        self._given = time.monotonic() - self._late

    def fileno(self) -> int | None:
        """Return what becomes readable when any member does."""
        descriptor = getattr(self._selector, "fileno", None)
        return None if descriptor is None else descriptor()

    def due(self) -> float:
        """Return when a member is due, or to be opened again, or a tick."""
        dues = [line.source.due() for line in self._lines if not line.ended]
        if self._waiting:
            dues.append(time.monotonic() + self._waiting[0][0] - self._now())
        if not self.recorded:
            dues.append(self._given + TICK + self._late)
        polled = math.inf if hasattr(self._selector, "fileno") else time.monotonic() + POLLING
        return min(*dues, polled) if dues else time.monotonic()

    def now(self) -> float:
        """Return the time on the clock of the events, which is the monotonic one, or runs as the recordings do."""
        now = self._now()
        return self._given if self._ahead is None or math.isinf(now) else now + self._ahead

    def receive(self) -> list[Event]:
        """Return the performers' frames that are due, who has gone, or a tick in silence.

        Raises
        ------
        SourceError
            All recordings have ended.
        """
        for place, line in enumerate(self._lines):
            for event in line.receive():
                heapq.heappush(self._waiting, (event.time, next(self._order), place, event))
            self._watch(line)
        self._count()
        if self.recorded and not self._waiting and all(line.ended for line in self._lines):
            raise SourceError(
                self.name,
                found="the end of all recordings",
                expected="more frames",
                fix="Open the source again to replay them.",
            )
        now = self._now()
        if self._ahead is None:
            self._ahead = time.monotonic() - now
        news: list[_News] = []
        while self._waiting and (self._waiting[0][0] <= now or not self.recorded):
            _, _, place, event = heapq.heappop(self._waiting)
            news += self._fused(place, event)
        if math.isfinite(now):
            news += self._people.forget(now)
        if not self.recorded:
            news = self._latest(news)
        events: list[Event] = [self._in_order(replace(event, time=event.time + self._ahead)) for event in news]
        if not events and self.now() - self._late - self._given >= TICK:
            events.append(self._in_order(Tick(self.now() - self._late)))
        return events

    def close(self) -> None:
        """Close the members; closing again does nothing."""
        self._selector.close()
        for line in self._lines:
            line.source.close()

    def _watch(self, line: "_Line") -> None:
        """Wake for a member, which has another descriptor when it was opened again."""
        descriptor = line.fileno()
        if descriptor == line.watched:
            return
        if line.watched is not None:
            self._selector.unregister(line.watched)
        if descriptor is not None:
            self._selector.register(descriptor, selectors.EVENT_READ)
        line.watched = descriptor

    def _now(self) -> float:
        """Return the time on the members' common clock: of recordings, that of the one which is least far."""
        if not self.recorded:
            return time.monotonic()
        return min((line.now() for line in self._lines if not line.ended), default=math.inf)

    def _fused(self, place: int, event: _News) -> list[_News]:
        if isinstance(event, Cue):
            return [event]
        if isinstance(event, Lost):
            return list(self._people.lose(place, event.user, event.time))
        frame = self._people.see(place, event)
        return [] if frame is None else [frame]

    def _latest(self, news: list[_News]) -> list[_News]:
        """Leave out frames that a later one of the same performer has overtaken."""
        last = {event.user: k for k, event in enumerate(news) if isinstance(event, SkeletonFrame)}
        kept = [event for k, event in enumerate(news) if not isinstance(event, SkeletonFrame) or last[event.user] == k]
        self.counts.dropped += len(news) - len(kept)
        return kept

    def _in_order(self, event: Any) -> Any:
        """Return an event that is later than all before."""
        self._given = max(event.time, math.nextafter(self._given, math.inf))
        return replace(event, time=self._given)

    def _count(self) -> None:
        """Add what the members have counted since the last time."""
        total = Counts()
        for line in self._lines:
            total.add(line.source.counts)
        self.counts.received += total.received - self._counted.received
        self.counts.dropped += total.dropped - self._counted.dropped
        self.counts.refused.update(total.refused - self._counted.refused)
        self._counted = total


class _Line:
    """A member and its source."""

    def __init__(
        self, member: Member, delay: float, opener: Callable[[str], SkeletonSource], first: bool, recorded: bool
    ) -> None:
        def opened() -> SkeletonSource:
            return opener(member.uri)

        self.delay = delay
        self.ended = False
        self.watched: int | None = None
        self.source: SkeletonSource = opened() if recorded else Reopening(member.uri, opened)
        self._pose = member.pose
        self._levels = first and member.pose.is_identity

    def fileno(self) -> int | None:
        return None if self.ended else self.source.fileno()

    def now(self) -> float:
        return self.source.now() - self.delay

    def receive(self) -> list[_News]:
        """Return what has come, in the common frame and on the common clock."""
        if self.ended:
            return []
        try:
            events = self.source.receive()
        except Exception:  # only recordings raise, in the end or where they are damaged
            self.ended = True
            return []
        return [self._placed(event) for event in events if self._is_news(event)]

    def _is_news(self, event: Event) -> TypeGuard[_News]:
        """Tell whether an event is one for all: how a sensor stands is, if its frame is everybody's."""
        if isinstance(event, Cue):
            return self._levels and event.do == "level"
        return not isinstance(event, Tick)

    def _placed(self, event: _News) -> _News:
        event = replace(event, time=event.time - self.delay)
        if isinstance(event, SkeletonFrame):
            return replace(event, positions=self._pose.apply(event.positions))
        return event
