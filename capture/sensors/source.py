"""A device and a tracker as a live source: images in, performers out.

One thread waits for images, and another tracks the newest. The first also opens the device and the tracker, because a
device may take seconds to open, or never return. Results make the source's file descriptor readable.

Events of a live device have the times of their images on the monotonic clock. Without results, ticks follow with a
delay, so that they are never ahead of the image that is being tracked. Images older than `MAX_AGE_SECONDS` are not
tracked. If `MAX_LATE_COUNT` more results were late than in time, the machine is too slow, and ticks wait for results.
Every image of a recording is tracked, at the recording's own time.

If images have depth and show the floor, a cue ``level`` reports tilt, roll and height of the sensor; see
`capture.trackers.floor`.
"""

import logging
import math
import socket
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import asdict, replace

from capture.events import TICK_SECONDS, Cue, Event, Lost, Tick
from capture.sensors.clock import DeviceClock
from capture.sensors.threads import start
from capture.source import Counts, newest
from capture.trackers.floor import FloorTracker
from capture.trackers.picture import Device, Picture, Tracker
from puppetline import clock
from puppetline.errors import SourceError, heading

OPENING_SECONDS = 10.0
"""Maximum time until a device is open, and then until its first image has arrived, in seconds."""
SLOW_SHARE = 0.5
"""Share of a recording's images per second below which this computer is too slow for it."""
SILENCE_SECONDS = 2.0
"""Time without an image after which a device counts as failed, in seconds."""
MAX_AGE_SECONDS = 0.1
"""Maximum age of an image that is tracked, in seconds; an older result is late."""
MAX_LATE_COUNT = 10
"""Number of late results, minus those in time, from which ticks wait for late results, until it is 0 again."""
MAX_WAITING_RESULTS = 256
"""Maximum number of results that wait for the caller."""
MAX_LAG_SECONDS = 1.0
"""Maximum delay of a recording in real time, in seconds; at a longer one, the rest is played that much later."""

_READ_SECONDS = 0.1  # timeout of one read from a device, by which closing may be delayed
_CLOSING_SECONDS = 0.5  # maximum time that closing waits for a device or tracker

log = logging.getLogger(__name__)


class SensorSource:
    """A device with a tracker; implements `capture.source.SkeletonSource`.

    Parameters
    ----------
    name : str
        URI of the source.
    open_device : callable
        Returns the device; called in another thread. `receive` raises its errors.
    open_tracker : callable
        Returns the tracker for the device; called and closed in the same thread, before the device is closed.
    recorded : bool
        Whether the device is a recording, of which every image is tracked at its own time.
    fast : bool
        Whether to play a recording as fast as tracking allows, instead of in real time.

    Attributes
    ----------
    name : str
    counts : Counts
        Images received; images that were not tracked because newer ones arrived or because they were too old.
    tracked_picture : Picture or None
        The newest tracked image.
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
        self.tracked_picture: Picture | None = None
        self._open_device, self._open_tracker = open_device, open_tracker
        self.recorded, self._fast = recorded, fast
        self._last_time = 0.0 if recorded else clock.now() - MAX_AGE_SECONDS  # time of the last event
        self._tick_delay = MAX_AGE_SECONDS  # delay of ticks, in seconds
        self._late = 0  # number of late results minus those in time, 0 to MAX_LATE_COUNT
        self._slow = self._slow_logged = False  # whether ticks wait for late results, and whether that was logged
        self._waker, self._waiter = socket.socketpair()
        self._waker.setblocking(False)
        self._waiter.setblocking(False)

        # shared by the threads and the caller, protected by the condition
        self._changed = threading.Condition()
        self._picture: tuple[float, Picture] | None = None  # the next image to be tracked, and its time
        self._results: list[Event] = []
        self._opened = clock.now()
        self._recorded_seconds = 0.0  # of a recording, up to its last image
        self._deadline = self._opened + OPENING_SECONDS  # for the next image
        self._failure: SourceError | None = None
        self._stopping = False  # no more images are read
        self._read_all = False  # no more images follow the current one
        self._closed = False  # device and tracker are closed

        self._done = start(self._run, f"{name} reader", self._stop)

    def fileno(self) -> int:
        """Return the file descriptor that becomes readable when there are results."""
        return self._waiter.fileno()

    def due(self) -> float:
        """Return when a tick is due, or when a silent device counts as failed."""
        if self._closed:
            return clock.now()
        tick = math.inf if self.recorded else self._last_time + TICK_SECONDS + self._tick_delay
        return min(self._deadline, tick)

    def now(self) -> float:
        """Return the time on the clock of the events, in seconds."""
        return self._last_time if self.recorded else clock.now()

    def receive(self) -> list[Event]:
        """Return the results since the last call, or a tick if one is due, without waiting.

        Raises
        ------
        SourceError
            The device or the tracker does not open or fails, the device delivers no images, or a recording has ended.
        """
        with suppress(BlockingIOError):
            self._waiter.recv(4096)
        with self._changed:
            results, self._results = self._results, []
            failure = self._failure if self._closed else None
            silent = clock.now() >= self._deadline
            self._changed.notify_all()
        if not results and failure is not None:
            raise failure
        if not results and silent:
            raise self._silence_error()
        if results and not self.recorded:
            self._delay_ticks(clock.now() - max(event.time for event in results))
            late = [event for event in results if event.time < self._last_time]  # a tick was ahead of them
            results[: len(late)] = newest(late)
        tick = clock.now() - self._tick_delay
        if not (results or self.recorded) and tick - self._last_time >= TICK_SECONDS:
            results.append(Tick(tick))
        return [self._in_order(event) for event in results]

    def close(self) -> None:
        """Close device and tracker, or leave them if they do not return in time."""
        self._stop()
        self._done.wait(_CLOSING_SECONDS)
        self._waker.close()
        self._waiter.close()

    def _stop(self) -> None:
        with self._changed:
            self._stopping = True
            self._changed.notify_all()

    def _delay_ticks(self, age: float) -> None:
        """Let ticks wait for results that are usually late, after results of this age in seconds."""
        self._late = min(self._late + 1, MAX_LATE_COUNT) if age > MAX_AGE_SECONDS else max(self._late - 1, 0)
        self._slow = self._late > (0 if self._slow else MAX_LATE_COUNT - 1)
        self._tick_delay = max(age, MAX_AGE_SECONDS) if self._slow else MAX_AGE_SECONDS
        if self._slow and not self._slow_logged:
            message = "%s tracking is too slow on this machine: performers are %.2f s late"
            log.warning(message, heading(self.name), age)
            self._slow_logged = True

    def _in_order(self, event: Event) -> Event:
        """Return an event with a time not before the last one; a slow tracker's results may be before a tick."""
        if event.time < self._last_time:
            event = replace(event, time=math.nextafter(self._last_time, math.inf))
        self._last_time = event.time
        return event

    def _run(self) -> None:
        """Read images until something fails or the source is closed."""
        what = "the device"
        try:
            with ExitStack() as stack:
                device = self._open_device()
                stack.callback(device.close)
                what = "the tracker"
                self._await_image(math.inf)  # a tracker may compile first
                tracker = self._open_tracker(device)
                stack.callback(tracker.close)
                self._await_image(OPENING_SECONDS)
                log.info("%s tracking images of %s with %s", heading(self.name), device.name, tracker.name)
                tracking = start(lambda: self._track(tracker), f"{self.name} tracker", self._stop)
                stack.callback(tracking.wait)
                stack.callback(self._end)
                what = device.name
                self._read(device)
        except Exception as error:  # drivers raise errors of any kind
            self._fail(what, error)
        self._closed = True
        self._wake()

    def _await_image(self, seconds: float) -> None:
        with self._changed:
            self._deadline = clock.now() + seconds

    def _read(self, device: Device) -> None:
        device_clock, logged = DeviceClock(), False
        start_time = first = None
        while not self._stopping:
            picture = device.read(_READ_SECONDS)
            if picture is None:
                continue
            now = clock.now()
            if self.recorded:
                taken = picture.time
                first = taken if first is None else first
                self._recorded_seconds = taken - first
                if start_time is None or now - start_time - taken > MAX_LAG_SECONDS:
                    start_time = now - taken
                self._offer(taken, picture, now if self._fast else start_time + taken)
            else:
                self._offer(device_clock.moment(picture.time, now), picture, now)
                if device_clock.rate is not None and not logged:
                    logged = True
                    message = "%s one second takes %g s on the clock of %s: using the arrival times of images instead"
                    log.warning(message, heading(self.name), device_clock.rate, device.name)

    def _offer(self, taken: float, picture: Picture, due: float) -> None:
        """Pass an image to the tracker when it is due; the image of a live device replaces the waiting one."""
        with self._changed:
            self.counts.received += 1
            if self.recorded:
                self._deadline = math.inf  # the tracker may take any time
                clock.block(due, lambda seconds: self._changed.wait_for(lambda: self._stopping, seconds))
                self._changed.wait_for(lambda: self._stopping or self._picture is None)
            elif due - taken > MAX_AGE_SECONDS:
                self.counts.dropped += 1
                return
            elif self._picture is not None:
                self.counts.dropped += 1
            self._picture = taken, picture
            self._deadline = clock.now() + SILENCE_SECONDS
            self._changed.notify_all()

    def _track(self, tracker: Tracker) -> None:
        """Track one image after another."""
        present: set[int] = set()
        last = -math.inf
        floor_tracker = FloorTracker()
        try:
            while (waiting := self._take()) is not None:
                taken, picture = waiting
                last = max(taken, math.nextafter(last, math.inf))
                people = tracker.track(picture)
                self.tracked_picture = picture
                frames = [person.frame(last) for person in people]
                found = {frame.user for frame in frames}
                self._publish([*(Lost(last, user) for user in sorted(present - found)), *frames] or [Tick(last)])
                present = found
                if (floor := floor_tracker.update(last, picture)) is not None:  # after the frames, which are urgent
                    log.info("%s the sensor is %s", heading(self.name), floor)
                    self._publish([Cue(last, "level", asdict(floor))])
        except Exception as error:  # as in _run
            self._fail(tracker.name, error)

    def _take(self) -> tuple[float, Picture] | None:
        """Return the next image to track and its time; None if there are no more."""
        with self._changed:
            while True:
                self._changed.wait_for(lambda: self._stopping or self._read_all or self._picture is not None)
                found, self._picture = self._picture, None
                self._changed.notify_all()
                if self._stopping or found is None:
                    return None
                if self.recorded or clock.now() - found[0] <= MAX_AGE_SECONDS:
                    return found
                self.counts.dropped += 1

    def _publish(self, results: list[Event]) -> None:
        """Pass results to the caller."""
        with self._changed:
            if self.recorded:
                self._changed.wait_for(lambda: self._stopping or not self._results)
            self._results = [*self._results, *results][-MAX_WAITING_RESULTS:]
            self._wake()

    def _end(self) -> None:
        """Let the tracker finish."""
        with self._changed:
            self._read_all = True
            if self.recorded:
                self._deadline = math.inf
            self._changed.notify_all()

    def _fail(self, what: str, error: Exception) -> None:
        """Stop reading and tracking; `receive` raises the error once everything is closed."""
        if not isinstance(error, SourceError):
            log.debug("%s %s failed", heading(self.name), what, exc_info=error)
            error = SourceError(
                self.name,
                found=f"a failure of {what} ({type(error).__name__}: {error})",
                expected="a working device and tracker",
                fix="Unplug the device and plug it in again; puppetline doctor lists what is installed.",
            )
        with self._changed:
            self._failure = self._failure or error
            self._stopping = True
            self._changed.notify_all()

    def _silence_error(self) -> SourceError:
        expected, fix = "images", "Check the cable and the power supply, and close other programs that use the device."
        if self.recorded:
            seconds, of_images = clock.now() - self._opened, self.counts.received
            needed = of_images / self._recorded_seconds if self._recorded_seconds > 0 else 0.0
            if of_images / seconds < SLOW_SHARE * needed:
                return SourceError(
                    self.name,
                    found="a computer that is too slow for this video: "
                    f"{of_images / seconds:.2g} of {needed:.3g} images per second",
                    expected="at least half of the images in time",
                    fix="Convert the video to a smaller size, or close other programs.",
                )
            expected, fix = "images up to the recording's end", "The recording is damaged: record it again."
        found = f"no new image for {SILENCE_SECONDS:g} s, or no first image for {OPENING_SECONDS:g} s"
        return SourceError(self.name, found=found, expected=expected, fix=fix)

    def _wake(self) -> None:
        with suppress(BlockingIOError, OSError):  # a full pipe is readable, and a closed one has no reader
            self._waker.send(b"\0")
