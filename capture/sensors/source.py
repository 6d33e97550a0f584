"""A device and a tracker behind the protocol of live sources: pictures in, performers out.

One thread waits for pictures, another one finds the people in the newest; opening is theirs too, for a device may take
seconds, or never come back. What they find wakes whoever runs the source through its file descriptor.

Events of a live device are on the monotonic clock, at the moments of their pictures, as evenly spaced as the device's
own clock says; where nothing comes, ticks follow at a distance, so as not to be ahead of the picture that is being
tracked. What is older than `OLDEST` is left out, before it is tracked and when it is given; but on a machine that is
late for `SLOW` pictures more than not, people are given late rather than never. Of a recording, every picture is
tracked, at the recording's own times.

Where pictures have depth and the floor is in them, a cue ``level`` says how the sensor stands: see
`capture.trackers.floor`.
"""

import logging
import math
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import asdict, replace

import numpy as np

from capture.events import TICK_SECONDS, Cue, Event, Lost, Tick
from capture.sensors.clock import DeviceClock
from capture.sensors.threads import start
from capture.skeleton import SkeletonFrame
from capture.source import Counts
from capture.trackers.floor import FloorWatch
from capture.trackers.picture import Device, Picture, Tracker
from puppetline.errors import SourceError, heading

OPENING = 10.0
"""Seconds in which a device is open and has given its first picture, or is taken for dead."""
SILENT = 2.0
"""Seconds without a picture after which a device is taken for gone."""
OLDEST = 0.1
"""Seconds; a picture older than that is not tracked, and who was found in it not given: nobody wants to see it."""
SLOW = 10
"""Pictures, more than those in time, that people were found in too late, after which these are given all the same until
as many come in time: this machine cannot do better, and late is better than never."""
PATIENCE = 1.0
"""Seconds by which a recording in real time may be late before the rest of it comes as much later."""

_READ = 0.1  # seconds that a device is waited for at a time: closing takes as long
_CLOSING = 0.5  # seconds that closing waits for a device or tracker that does not come back

_LOOK_AFTER = "Look after its cable and its power supply, and whether another program uses it."

_News = SkeletonFrame | Lost | Tick | Cue

log = logging.getLogger(__name__)


class SensorSource:
    """A device that people are found in; implements `capture.source.SkeletonSource`.

    Parameters
    ----------
    name : str
        The URI.
    open_device : callable
        Returns the device; called in another thread. What it raises is raised by `receive`.
    open_tracker : callable
        Returns what finds people in that device's pictures; as `open_device`. The tracker is closed before the device.
    recorded : bool
        Whether it is a recording: every picture counts, and its times are kept.
    fast : bool
        Whether to play a recording as fast as it can be tracked, not in real time.

    Attributes
    ----------
    name : str
    counts : Counts
        Received are pictures; dropped are those that were overtaken or too old, and so are frames.
    seen : Picture or None
        The newest picture in which people were looked for.
    """

    def __init__(
        self,
        name: str,
        open_device: Callable[[], Device],
        open_tracker: Callable[[Device], Tracker],
        recorded: bool = False,
        fast: bool = False,
    ) -> None:
        self.name = name
        self.counts = Counts()
        self.seen: Picture | None = None
        self._open_device, self._open_tracker = open_device, open_tracker
        self.recorded, self._fast = recorded, fast
        self._given = 0.0 if recorded else time.monotonic() - OLDEST  # the time of the last event
        self._behind = OLDEST  # seconds by which ticks are late, so as not to be ahead of what is being tracked
        self._late = 0  # how much more often what was found was too old than not, 0 to SLOW
        self._slow = self._told = False  # whether that is the rule on this machine, and whether it was said
        self._waker, self._waiter = socket.socketpair()
        self._waker.setblocking(False)
        self._waiter.setblocking(False)

        # What the threads and the caller share, and the condition that guards it.
        self._changed = threading.Condition()
        self._picture: tuple[float, Picture] | None = None  # when it was taken, and what is to be tracked next
        self._news: list[_News] = []
        self._deadline = time.monotonic() + OPENING  # for the next picture
        self._failure: SourceError | None = None
        self._over = False  # nothing more is to be read
        self._read_all = False  # nor tracked, once the last picture is
        self._shut = False  # device and tracker are closed

        self._done = start(self._run, f"{name} reader", self._stop)

    def fileno(self) -> int:
        """Return what becomes readable when somebody was found."""
        return self._waiter.fileno()

    def due(self) -> float:
        """Return when a tick is due, or when a device that gives nothing is given up."""
        if self._shut:
            return time.monotonic()
        return self._deadline if self.recorded else min(self._deadline, self._given + TICK_SECONDS + self._behind)

    def now(self) -> float:
        """Return the time on the clock of the events."""
        return self._given if self.recorded else time.monotonic()

    def receive(self) -> list[Event]:
        """Return who was found or lost since the last call, or a tick in silence; never waits.

        Raises
        ------
        SourceError
            The device or the tracker cannot be opened or fails, the device gives no pictures, a recording has ended.
        """
        with suppress(BlockingIOError):
            self._waiter.recv(4096)
        with self._changed:
            news, self._news = self._news if self.recorded else self._fresh(self._news), []
            failure = self._failure if self._shut else None
            silent = time.monotonic() >= self._deadline
            self._changed.notify_all()
        if not news and failure is not None:
            raise failure
        if not news and silent:
            raise self._silent()
        tick = time.monotonic() - self._behind
        if not (news or self.recorded) and tick - self._given >= TICK_SECONDS:
            news.append(Tick(tick))
        return [self._in_order(event) for event in news]

    def close(self) -> None:
        """Let go of device and tracker, unless they do not come back."""
        self._stop()
        self._done.wait(_CLOSING)
        self._waker.close()
        self._waiter.close()

    def _stop(self) -> None:
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def _fresh(self, news: list[_News]) -> list[_News]:
        """Leave out who is seen too late, unless this machine cannot do better."""
        if not news:
            return news
        now = time.monotonic()
        age = now - max(event.time for event in news)
        self._late = min(self._late + 1, SLOW) if age > OLDEST else max(self._late - 1, 0)
        self._slow = self._late > (0 if self._slow else SLOW - 1)
        self._behind = max(age, OLDEST) if self._slow else OLDEST
        if self._slow:
            if not self._told:
                log.warning("%s finding people takes so long here that they are %.2f s late", heading(self.name), age)
            self._told = True
            return news
        fresh = [event for event in news if isinstance(event, Lost | Cue) or now - event.time <= OLDEST]
        self.counts.dropped += _frames(news) - _frames(fresh)
        return fresh

    def _in_order(self, event: _News) -> _News:
        """Return an event that is not before those that were given, as one of a slow tracker may be."""
        if event.time < self._given:
            event = replace(event, time=math.nextafter(self._given, math.inf))
        self._given = event.time
        return event

    def _run(self) -> None:
        """Read pictures until something fails or the source is closed."""
        what = "the device"
        try:
            with ExitStack() as stack:
                device = self._open_device()
                stack.callback(device.close)
                what = "the tracker"
                tracker = self._open_tracker(device)
                stack.callback(tracker.close)
                log.info(
                    "%s %s gives the pictures, %s finds people in them", heading(self.name), device.name, tracker.name
                )
                tracking = start(lambda: self._track(tracker), f"{self.name} tracker", self._stop)
                stack.callback(tracking.wait)
                stack.callback(self._end)
                what = device.name
                self._read(device)
        except Exception as error:  # whatever a driver throws, somebody must be told
            self._fail(what, error)
        self._shut = True
        self._wake()

    def _read(self, device: Device) -> None:
        clock, told = DeviceClock(), False
        begun = None
        while not self._over:
            picture = device.read(_READ)
            if picture is None:
                continue
            now = time.monotonic()
            if self.recorded:
                taken = picture.time
                if begun is None or now - begun - taken > PATIENCE:
                    begun = now - taken
                self._offer(taken, picture, now if self._fast else begun + taken)
            else:
                self._offer(clock.moment(picture.time, now), picture, now)
                if clock.pace is not None and not told:
                    told = True
                    log.warning(
                        "%s a second is %g s on the clock of %s: frames have the moments at which pictures come",
                        heading(self.name),
                        clock.pace,
                        device.name,
                    )

    def _offer(self, taken: float, picture: Picture, due: float) -> None:
        """Hand a picture over when it is due; that of a live device instead of the one before."""
        with self._changed:
            self.counts.received += 1
            if self.recorded:
                self._deadline = math.inf  # as long as the tracker takes
                self._changed.wait_for(lambda: self._over, max(0.0, due - time.monotonic()))
                self._changed.wait_for(lambda: self._over or self._picture is None)
            elif due - taken > OLDEST:
                self.counts.dropped += 1
                return
            elif self._picture is not None:
                self.counts.dropped += 1
            self._picture = taken, picture
            self._deadline = time.monotonic() + SILENT
            self._changed.notify_all()

    def _track(self, tracker: Tracker) -> None:
        """Find people in one picture after the other."""
        present: set[int] = set()
        last = -math.inf
        watch = FloorWatch()
        try:
            while (next_one := self._take()) is not None:
                taken, picture = next_one
                last = max(taken, math.nextafter(last, math.inf))
                people = tracker.track(picture)
                self.seen = picture
                frames = [
                    SkeletonFrame(last, person.user, person.positions.astype(np.float64), person.confidence)
                    for person in people
                ]
                found = {frame.user for frame in frames}
                self._tell([*(Lost(last, user) for user in sorted(present - found)), *frames] or [Tick(last)])
                present = found
                if (floor := watch.see(last, picture)) is not None:  # once nobody waits for it
                    log.info("%s the sensor is %s", heading(self.name), floor)
                    self._tell([Cue(last, "level", asdict(floor))])
        except Exception as error:  # as of a device
            self._fail(tracker.name, error)

    def _take(self) -> tuple[float, Picture] | None:
        """Wait for a picture to track; None when there will be none."""
        with self._changed:
            while True:
                self._changed.wait_for(lambda: self._over or self._read_all or self._picture is not None)
                found, self._picture = self._picture, None
                self._changed.notify_all()
                if self._over or found is None:
                    return None
                if self.recorded or time.monotonic() - found[0] <= OLDEST:
                    return found
                self.counts.dropped += 1

    def _tell(self, news: list[_News]) -> None:
        """Give news to the caller: those of a live device instead of what is older and of the same kind."""
        with self._changed:
            if self.recorded:
                self._changed.wait_for(lambda: self._over or not self._news)
            kinds = {_kind(event) for event in news}
            overtaken = kinds & {_kind(event) for event in self._news}
            self.counts.dropped += sum(kind is SkeletonFrame for kind, _ in overtaken)
            left = [event for event in self._news if _kind(event) not in overtaken]
            self._news = left + news
            self._wake()

    def _end(self) -> None:
        """Have the tracker finish."""
        with self._changed:
            self._read_all = True
            if self.recorded:
                self._deadline = math.inf
            self._changed.notify_all()

    def _fail(self, what: str, error: Exception) -> None:
        """Have `receive` raise an error, once all is closed; nothing more is read or tracked."""
        if not isinstance(error, SourceError):
            log.debug("%s %s failed", heading(self.name), what, exc_info=error)
            error = SourceError(
                self.name,
                found=f"a failure of {what} ({type(error).__name__}: {error})",
                expected="images with people in them",
                fix="Unplug the device and plug it in again; puppetline doctor reports what is installed.",
            )
        with self._changed:
            self._failure = self._failure or error
            self._over = True
            self._changed.notify_all()

    def _silent(self) -> SourceError:
        expected, fix = "a device that gives pictures", _LOOK_AFTER
        if self.recorded:
            expected, fix = "a recording that goes on to its end", "It is damaged: record it again."
        found = f"no new picture within {SILENT:g} s, nor a first one within {OPENING:g} s"
        return SourceError(self.name, found=found, expected=expected, fix=fix)

    def _wake(self) -> None:
        with suppress(BlockingIOError, OSError):  # a full pipe is readable, and a closed one has no reader
            self._waker.send(b"\0")


def _frames(news: list[_News]) -> int:
    return sum(isinstance(event, SkeletonFrame) for event in news)


def _kind(event: _News) -> tuple[type[_News], int | None]:
    return type(event), None if isinstance(event, Tick | Cue) else event.user
