"""A source that combines several sources, with one skeleton per performer.

A member that fails is opened again while the others continue. Members are live, or all of them are recordings of the
same motion. Recordings are played together, synchronised by their clocks.
"""

import heapq
import math
import selectors
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, TypeGuard

from capture.events import TICK_SECONDS, Cue, Event, Lost, Tick
from capture.fusion.performers import Performers
from capture.reconnecting import ReopeningSource
from capture.sensor_pose import SensorPose
from capture.skeleton import SkeletonFrame
from capture.source import Counts, SkeletonSource
from puppetline import clock
from puppetline.errors import RecordingEndError

MAX_DELAY_SECONDS = 0.1
"""Maximum delay between the time of a frame and its arrival. Ticks have the same delay."""
POLL_SECONDS = 0.005
"""Polling interval on systems that cannot wait for several members at a time."""

_MemberEvent = SkeletonFrame | Lost | Cue


@dataclass(frozen=True)
class Member:
    """One of several sources.

    Attributes
    ----------
    uri : str
    pose : SensorPose
        Pose of its sensor in common coordinates.
    clock : float
        Seconds by which its clock, or the arrival of its frames, is ahead of the first member's.
    """

    uri: str
    pose: SensorPose
    clock: float = 0.0


class FusedSource:
    """Several members as one source; implements `capture.source.SkeletonSource`.

    Parameters
    ----------
    name : str
        The URI.
    members : sequence of Member
        The first member that sees a performer determines the times of the performer's frames. The tilt of the very
        first sensor (a `Cue` "level") is reported if its coordinates are the common ones.
    opener : callable
        Function that opens a member by its URI.
    recorded : bool
        Whether the members are recordings. They are not opened again, and the source ends with the last of them.

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
        self._performers = Performers()
        self._waiting: list[tuple[float, int, int, _MemberEvent]] = []  # a heap: time, order, member, event
        self._order = count()
        self._selector = selectors.DefaultSelector()
        self._offset: float | None = None if recorded else 0.0  # from the recordings' clock to the monotonic clock
        earliest = min(member.clock for member in members)
        self._members: list[_OpenMember] = []
        try:
            for member in members:
                first = not self._members
                self._members.append(_OpenMember(member, member.clock - earliest, opener, first, recorded))
                self._watch(self._members[-1])
        except BaseException:
            self.close()
            raise
        self._delay = MAX_DELAY_SECONDS + max(member.delay for member in self._members) * (not recorded)
        self._last_time = clock.now() - self._delay

    def fileno(self) -> int | None:
        """Return a file descriptor that becomes readable when any member does."""
        descriptor = getattr(self._selector, "fileno", None)
        return None if descriptor is None else descriptor()

    def due(self) -> float:
        """Return when to call `receive` even if nothing has arrived, in seconds of `puppetline.clock`."""
        dues = [member.source.due() for member in self._members if not member.ended]
        if self._waiting:
            dues.append(clock.now() + self._waiting[0][0] - self._now())
        if not self.recorded:
            dues.append(self._last_time + TICK_SECONDS + self._delay)
        polled = math.inf if hasattr(self._selector, "fileno") else clock.now() + POLL_SECONDS
        return min(*dues, polled) if dues else clock.now()

    def now(self) -> float:
        """Return the time on the clock of the events: the monotonic clock, or a clock that follows the recordings."""
        now = self._now()
        return self._last_time if self._offset is None or math.isinf(now) else now + self._offset

    def receive(self) -> list[Event]:
        """Return the performers' frames that are due, the performers who have left, or a tick if nothing happens.

        Raises
        ------
        RecordingEndError
            All recordings have ended.
        """
        for place, member in enumerate(self._members):
            for event in member.receive():
                heapq.heappush(self._waiting, (event.time, next(self._order), place, event))
            self._watch(member)
        self._count()
        if self.recorded and not self._waiting and all(member.ended for member in self._members):
            raise RecordingEndError(
                self.name,
                found="the end of all recordings",
                expected="more frames",
                fix="Open the source again to repeat them.",
            )
        now = self._now()
        if self._offset is None:
            self._offset = clock.now() - now
        fused: list[_MemberEvent] = []
        while self._waiting and (self._waiting[0][0] <= now or not self.recorded):
            _, _, place, event = heapq.heappop(self._waiting)
            fused += self._fused(place, event)
        if math.isfinite(now):
            fused += self._performers.forget(now)
        events: list[Event] = [self._in_order(replace(event, time=event.time + self._offset)) for event in fused]
        if not events and self.now() - self._delay - self._last_time >= TICK_SECONDS:
            events.append(self._in_order(Tick(self.now() - self._delay)))
        return events

    def close(self) -> None:
        """Close the members; closing again does nothing."""
        self._selector.close()
        for member in self._members:
            member.source.close()

    def _watch(self, member: "_OpenMember") -> None:
        """Select a member's file descriptor, which changes when the member is opened again."""
        descriptor = member.fileno()
        if descriptor == member.watched:
            return
        if member.watched is not None:
            self._selector.unregister(member.watched)
        if descriptor is not None:
            self._selector.register(descriptor, selectors.EVENT_READ)
        member.watched = descriptor

    def _now(self) -> float:
        """Return the time on the members' common clock: for recordings, the earliest of their times."""
        if not self.recorded:
            return clock.now()
        return min((member.now() for member in self._members if not member.ended), default=math.inf)

    def _fused(self, place: int, event: _MemberEvent) -> list[_MemberEvent]:
        if isinstance(event, Cue):
            return [event]
        if isinstance(event, Lost):
            return list(self._performers.lose(place, event.user, event.time))
        frame = self._performers.observe(place, event)
        return [] if frame is None else [frame]

    def _in_order(self, event: Any) -> Any:
        """Return the event with a time after all events before."""
        self._last_time = max(event.time, math.nextafter(self._last_time, math.inf))
        return replace(event, time=self._last_time)

    def _count(self) -> None:
        """Add the members' counts since the last call."""
        total = Counts()
        for member in self._members:
            total.add(member.source.counts)
        self.counts.received += total.received - self._counted.received
        self.counts.dropped += total.dropped - self._counted.dropped
        self.counts.refused.update(total.refused - self._counted.refused)
        self._counted = total


class _OpenMember:
    """A member and its open source."""

    def __init__(
        self, member: Member, delay: float, opener: Callable[[str], SkeletonSource], first: bool, recorded: bool
    ) -> None:
        def opened() -> SkeletonSource:
            return opener(member.uri)

        self.delay = delay
        self.ended = False
        self.watched: int | None = None
        self.source: SkeletonSource = opened() if recorded else ReopeningSource(member.uri, opened)
        self._pose = member.pose
        self._reports_level = first and member.pose.is_identity

    def fileno(self) -> int | None:
        return None if self.ended else self.source.fileno()

    def now(self) -> float:
        return self.source.now() - self.delay

    def receive(self) -> list[_MemberEvent]:
        """Return the received events in common coordinates and on the common clock."""
        if self.ended:
            return []
        try:
            events = self.source.receive()
        except Exception:  # only recordings raise, at their end or if they are damaged
            self.ended = True
            return []
        return [self._converted(event) for event in events if self._is_used(event)]

    def _is_used(self, event: Event) -> TypeGuard[_MemberEvent]:
        """Return whether an event is passed on; a sensor's tilt is, if its coordinates are the common ones."""
        if isinstance(event, Cue):
            return self._reports_level and event.do == "level"
        return not isinstance(event, Tick)

    def _converted(self, event: _MemberEvent) -> _MemberEvent:
        event = replace(event, time=event.time - self.delay)
        if isinstance(event, SkeletonFrame):
            return replace(event, positions=self._pose.apply(event.positions))
        return event
