"""What arrived from a source in the last seconds: its performers, its newest image, and its errors."""

import math
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from capture.events import Cue, Event, Lost, Tick
from capture.reconnecting import ReopeningSource
from capture.sensor_tilt import SensorTilt
from capture.sensors.source import SensorSource
from capture.skeleton import INFERRED, JOINT_INDEX, LOST, SkeletonFrame
from capture.source import Counts, SilentSource, SkeletonSource, wait
from capture.trackers.picture import Picture
from puppetline import clock
from puppetline.errors import SourceError

START_SECONDS = 10.0
"""Maximum time until the first data arrives, in seconds."""
LOST_SECONDS = 1.0
"""Time without a frame after which a performer counts as having left, in seconds."""


@dataclass
class PerformerReport:
    """What arrived of one performer.

    Attributes
    ----------
    newest : SkeletonFrame
    since : float
        Time of the first frame, in seconds.
    frames : int
    still : bool
        Whether every frame had exactly the same positions.
    ever_known, ever_tracked : (20,) bool
        Joints that were known, and tracked, in any frame.
    """

    newest: SkeletonFrame
    since: float
    frames: int = 1
    still: bool = True
    ever_known: NDArray[np.bool_] = field(init=False)
    ever_tracked: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        self.ever_known, self.ever_tracked = self.known(), self.tracked()

    def add(self, frame: SkeletonFrame) -> None:
        """Add a newer frame."""
        self.still &= np.array_equal(frame.positions, self.newest.positions, equal_nan=True)
        self.newest = frame
        self.frames += 1
        self.ever_known, self.ever_tracked = self.ever_known | self.known(), self.ever_tracked | self.tracked()

    @property
    def rate(self) -> float | None:
        """Frames per second; None for less than half a second of frames."""
        seconds = self.newest.time - self.since
        return (self.frames - 1) / seconds if seconds > 0.5 else None

    @property
    def distance(self) -> float:
        """Horizontal distance from the sensor to the median of the known joints, in metres."""
        return float(np.hypot(*np.median(self.newest.positions[self.known()], axis=0)[[0, 2]]))

    def known(self) -> NDArray[np.bool_]:
        """Return (20,) whether a joint is tracked or inferred."""
        return _known(self.newest)

    def tracked(self) -> NDArray[np.bool_]:
        """Return (20,) whether a joint is tracked."""
        return self.known() & (self.newest.confidence > INFERRED)


@dataclass
class SourceReport:
    """What arrived from a source in the period that its monitor remembers.

    Attributes
    ----------
    source : str
        URI of the source.
    listens : bool
        Whether the source waits for senders in the network.
    seconds : float
        Time since the monitor started, in seconds.
    received : int
        Number of images, packets, or lines of a file.
    refused : dict
        Number of packets that were not understood, by the reason.
    picture : Picture or None
        The last tracked image; None for a source without images.
    performers : dict
        Performers in view at the end, by user number.
    gone : set
        User numbers of performers who have left.
    failure : str
        The error that ended the source; empty while it works.
    retried : bool
        Whether the source is opened again until it works.
    silent : float
        Time since data arrived, in seconds; since the start if none arrived.
    sensor_tilt : SensorTilt or None
        Tilt, roll and height of the sensor, if it sees the floor.
    """

    source: str
    listens: bool
    seconds: float = 0.0
    received: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    picture: Picture | None = None
    performers: dict[int, PerformerReport] = field(default_factory=dict)
    gone: set[int] = field(default_factory=set)
    failure: str = ""
    retried: bool = False
    silent: float = 0.0
    sensor_tilt: SensorTilt | None = None

    def add(self, event: Event) -> None:
        """Add an event of the source."""
        if isinstance(event, SkeletonFrame) and _known(event).any():
            self.gone.discard(event.user)
            if event.user in self.performers:
                self.performers[event.user].add(event)
            else:
                self.performers[event.user] = PerformerReport(event, event.time)
        elif isinstance(event, Lost) and event.user in self.performers:
            del self.performers[event.user]
            self.gone.add(event.user)


@dataclass(frozen=True)
class _Arrivals:
    """What arrived at one time on the source's clock: events, the number of packets, and those refused by reason."""

    time: float
    events: list[Event]
    received: int
    refused: Counter[str]


class SourceMonitor:
    """Reports what arrives from a source, which it or its caller receives.

    Parameters
    ----------
    source : SkeletonSource
        The monitor does not close it.
    period : float
        How long data counts, in seconds.

    Attributes
    ----------
    started : bool
        Whether any data has arrived.
    """

    def __init__(self, source: SkeletonSource, period: float = math.inf) -> None:
        self.started = False
        self._source, self._period = source, period
        self._listens = not isinstance(self._inner, SensorSource) and source.fileno() is not None
        self._arrivals: deque[_Arrivals] = deque()
        self._counted = _copy(source.counts)
        self._start = self._last_arrival = clock.now()
        self._failure = ""
        self._sensor_tilt: SensorTilt | None = None

    @property
    def ended(self) -> bool:
        """Whether no more data can arrive."""
        return bool(self._failure) or (self._source.recorded and bool(self._retried_error))

    @property
    def _inner(self) -> SkeletonSource:
        return self._source.inner if isinstance(self._source, ReopeningSource) else self._source

    @property
    def _retried_error(self) -> str:
        """Why a source is being opened again; a sensor works again only when its first image has arrived."""
        if isinstance(self._source, ReopeningSource) and isinstance(self._source.inner, SilentSource | SensorSource):
            return self._source.failure
        return ""

    def receive(self, deadline: float) -> None:
        """Wait for data until a deadline, in seconds of `puppetline.clock`, and remember it."""
        wait(self._source, deadline)
        try:
            events = self._source.receive()
        except SourceError as error:
            self._failure = str(error)
            return
        self.remember(events)

    def remember(self, events: Sequence[Event]) -> None:
        """Remember the events of one call of the source's `receive`."""
        events = [event for event in events if not isinstance(event, Tick)]
        counts, now = self._source.counts, self._source.now()
        received, refused = counts.received - self._counted.received, counts.refused - self._counted.refused
        self._counted = _copy(counts)
        if received:
            self._last_arrival, self.started = clock.now(), True
        for event in events:
            if isinstance(event, Cue) and event.do == "level":  # a sensor sends it once, so it outlasts the period
                with suppress(ValueError):  # the cue of a take may hold anything
                    self._sensor_tilt = SensorTilt.of_json(event.arguments)
        if received or events:
            self._arrivals.append(_Arrivals(now, events, received, refused))
        while self._arrivals and now - self._arrivals[0].time > self._period:
            self._arrivals.popleft()

    def trace(self, joint: str) -> dict[int, tuple[list[float], list[list[float]]]]:
        """Return where a joint of each performer was in the period: times, and positions in sensor coordinates.

        Frames in which the joint is lost are omitted.
        """
        index, traces = JOINT_INDEX[joint], dict[int, tuple[list[float], list[list[float]]]]()
        for event in (event for arrivals in self._arrivals for event in arrivals.events):
            if isinstance(event, SkeletonFrame) and _known(event)[index]:
                times, positions = traces.setdefault(event.user, ([], []))
                times.append(event.time)
                positions.append(event.positions[index].tolist())
        return traces

    def report(self) -> SourceReport:
        """Return what arrived in the period."""
        moment, now, retried_error = clock.now(), self._source.now(), self._retried_error
        report = SourceReport(
            self._source.name,
            self._listens,
            moment - self._start,
            failure=self._failure or retried_error,
            retried=bool(retried_error) and not self.ended,
            silent=moment - self._last_arrival,
            sensor_tilt=self._sensor_tilt,
        )
        refused: Counter[str] = Counter()
        for arrivals in self._arrivals:
            report.received += arrivals.received
            refused.update(arrivals.refused)
            for event in arrivals.events:
                report.add(event)
        report.refused = dict(refused)
        max_age = 0.0 if report.retried else LOST_SECONDS
        for user in [user for user, each in report.performers.items() if now - each.newest.time > max_age]:
            report.add(Lost(now, user))
        if isinstance(self._inner, SensorSource):
            report.picture = self._inner.tracked_picture
        return report


def observe(source: SkeletonSource, seconds: float, start_seconds: float = START_SECONDS) -> SourceReport:
    """Receive from a source for some seconds from its first data on, and report what arrived.

    Parameters
    ----------
    source : SkeletonSource
        It is not closed.
    seconds : float
    start_seconds : float
        Maximum time until the first data arrives, in seconds.
    """
    monitor = SourceMonitor(source)
    deadline, waiting = clock.now() + start_seconds, True
    while not monitor.ended and clock.now() < deadline:
        monitor.receive(deadline)
        if waiting and monitor.started:
            deadline, waiting = clock.now() + seconds, False
    return monitor.report()


def _known(frame: SkeletonFrame) -> NDArray[np.bool_]:
    return (frame.confidence > LOST) & np.isfinite(frame.positions).all(axis=1)


def _copy(counts: Counts) -> Counts:
    return Counts(counts.received, refused=counts.refused.copy())
