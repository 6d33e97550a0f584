"""What is seen of a source in a few seconds, and in words why nothing moves."""

import math
import re
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.events import Cue, Event, Lost, Tick
from capture.reconnecting import ReopeningSource
from capture.sensor_tilt import SensorTilt
from capture.sensors.source import SensorSource
from capture.skeleton import INFERRED, JOINTS, LOST, SkeletonFrame
from capture.source import Counts, SilentSource, SkeletonSource, wait
from capture.trackers.picture import Picture
from puppetline.errors import SourceError

PATIENCE = 10.0
"""Seconds in which something must have come."""

BLACK, DARK = 10.0, 40.0
"""Mean brightness of a picture, of 255, under which nothing is seen in it, and under which little is."""
NO_DEPTH, LITTLE_DEPTH = 0.02, 0.25
"""Share of a picture with depth under which there is none, and under which there is little."""
NEAREST, FARTHEST = 0.8, 4.5
"""Metres between which depth sensors see somebody well."""
SILENT = 1.0
"""Seconds without a frame after which a performer has gone, though nobody said so."""
RECENT = 2.0
"""Period that a status line is about, in seconds."""
SLOW = 12.0
"""Frames a second under which a performance is seen to stutter."""
FROZEN = 10
"""Frames of the very same pose after which nobody can be behind them."""
UNCERTAIN = 8
"""Joints that may be guessed: senders of 15 joints leave 5 to guess, and a side view hides some."""


@dataclass
class Performer:
    """What has come of one performer.

    Attributes
    ----------
    newest : SkeletonFrame
    since : float
        Time of the first frame.
    frames : int
    still : bool
        Whether every frame had the very same positions.
    """

    newest: SkeletonFrame
    since: float
    frames: int = 1
    still: bool = True

    def take(self, frame: SkeletonFrame) -> None:
        """Go on with a newer frame."""
        self.still &= np.array_equal(frame.positions, self.newest.positions, equal_nan=True)
        self.newest = frame
        self.frames += 1

    @property
    def rate(self) -> float | None:
        """Frames a second, where there are enough to tell."""
        seconds = self.newest.time - self.since
        return (self.frames - 1) / seconds if seconds > 0.5 else None

    @property
    def distance(self) -> float:
        """Metres over the floor from the sensor to the middle of what is known."""
        return float(np.hypot(*np.median(self.newest.positions[self.known()], axis=0)[[0, 2]]))

    def known(self) -> NDArray[np.bool_]:
        """Return (20,) whether a joint has a place at all."""
        return _known(self.newest)

    def seen(self) -> NDArray[np.bool_]:
        """Return (20,) whether a joint was seen rather than guessed."""
        return self.known() & (self.newest.confidence > INFERRED)


@dataclass
class Sight:
    """What was seen of a source in the time that is remembered.

    Attributes
    ----------
    source : str
        Its URI.
    listens : bool
        Whether it waits for senders in the network.
    seconds : float
        For which it was looked at in all.
    received : int
        Pictures, packets, or lines of a file.
    refused : dict
        Packets that were not understood, by the reason.
    picture : Picture or None
        The last one in which people were looked for; None for a source that has none.
    performers : dict
        Those who were there at the end, by user.
    gone : set
        Users who were there before.
    failure : str
        Why it can give no more; empty while it can.
    retried : bool
        Whether it is opened again until it does.
    silent : float
        Seconds since something came, or in all where nothing has.
    level : SensorTilt or None
        How the sensor stands, where it sees the floor.
    """

    source: str
    listens: bool
    seconds: float = 0.0
    received: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    picture: Picture | None = None
    performers: dict[int, Performer] = field(default_factory=dict)
    gone: set[int] = field(default_factory=set)
    failure: str = ""
    retried: bool = False
    silent: float = 0.0
    level: SensorTilt | None = None

    def take(self, event: Event) -> None:
        """Go on with what a source gives."""
        if isinstance(event, SkeletonFrame) and _known(event).any():
            self.gone.discard(event.user)
            if event.user in self.performers:
                self.performers[event.user].take(event)
            else:
                self.performers[event.user] = Performer(event, event.time)
        elif isinstance(event, Lost) and event.user in self.performers:
            del self.performers[event.user]
            self.gone.add(event.user)


@dataclass(frozen=True)
class Reason:
    """Why nothing moves, or not as it should.

    Attributes
    ----------
    what : str
        A sentence.
    fix : str
        What to do, a sentence; empty where the first says it.
    """

    what: str
    fix: str = ""


@dataclass(frozen=True)
class _News:
    """What came at one time, on the source's clock: events, how many packets, and those refused by the reason."""

    time: float
    events: list[Event]
    received: int
    refused: Counter[str]


class Watch:
    """Looks at a source for as long as somebody wants to know what it sees.

    Parameters
    ----------
    source : SkeletonSource
        It is not closed.
    memory : float
        Seconds for which is remembered what came.

    Attributes
    ----------
    begun : bool
        Whether anything has come.
    """

    def __init__(self, source: SkeletonSource, memory: float = math.inf) -> None:
        self.begun = False
        self._source, self._memory = source, memory
        self._listens = not isinstance(self._inner, SensorSource) and source.fileno() is not None
        self._news: deque[_News] = deque()
        self._counted = Counts()
        self._started = self._heard = time.monotonic()
        self._failure = ""
        self._level: SensorTilt | None = None

    @property
    def over(self) -> bool:
        """Whether nothing more can come."""
        return bool(self._failure) or (self._source.recorded and bool(self._trouble))

    @property
    def _inner(self) -> SkeletonSource:
        return self._source.inner if isinstance(self._source, ReopeningSource) else self._source

    @property
    def _trouble(self) -> str:
        """Why a source is opened again: until it is, and of a sensor until a picture comes, its sign of life."""
        if isinstance(self._source, ReopeningSource) and isinstance(self._source.inner, SilentSource | SensorSource):
            return self._source.failure
        return ""

    def take_in(self, deadline: float) -> None:
        """Wait for what comes next, though not beyond a deadline, `time.monotonic`, and remember it."""
        wait(self._source, deadline)
        try:
            events = self._source.receive()
        except SourceError as error:
            self._failure = str(error)
            return
        self._remember([event for event in events if not isinstance(event, Tick)])

    def sight(self) -> Sight:
        """Return what was seen."""
        moment, now, trouble = time.monotonic(), self._source.now(), self._trouble
        sight = Sight(
            self._source.name,
            self._listens,
            moment - self._started,
            failure=self._failure or trouble,
            retried=bool(trouble) and not self.over,
            silent=moment - self._heard,
            level=self._level,
        )
        refused: Counter[str] = Counter()
        for news in self._news:
            sight.received += news.received
            refused.update(news.refused)
            for event in news.events:
                sight.take(event)
        sight.refused = dict(refused)
        patience = 0.0 if sight.retried else SILENT
        for user in [user for user, each in sight.performers.items() if now - each.newest.time > patience]:
            sight.take(Lost(now, user))
        if isinstance(self._inner, SensorSource):
            sight.picture = self._inner.seen
        return sight

    def _remember(self, events: list[Event]) -> None:
        counts, now = self._source.counts, self._source.now()
        received, refused = counts.received - self._counted.received, counts.refused - self._counted.refused
        self._counted = Counts(counts.received, refused=counts.refused.copy())
        if received:
            self._heard, self.begun = time.monotonic(), True
        for event in events:
            if isinstance(event, Cue) and event.do == "level":  # which is said once, and holds
                with suppress(ValueError):  # of a take that was not recorded like that
                    self._level = SensorTilt.of_json(event.arguments)
        if received or events:
            self._news.append(_News(now, events, received, refused))
        while self._news and now - self._news[0].time > self._memory:
            self._news.popleft()


def watch(source: SkeletonSource, seconds: float, patience: float = PATIENCE) -> Sight:
    """Look at a source for so many seconds from the first thing that comes, and return what was seen.

    Parameters
    ----------
    source : SkeletonSource
        It is not closed.
    seconds : float
    patience : float
        Seconds in which the first thing must come.
    """
    looking = Watch(source)
    deadline, waiting = time.monotonic() + patience, True
    while not looking.over and time.monotonic() < deadline:
        looking.take_in(deadline)
        if waiting and looking.begun:
            deadline, waiting = time.monotonic() + seconds, False
    return looking.sight()


def told(performer: Performer) -> str:
    """Say in a few words how well somebody is seen."""
    rate = "" if performer.rate is None else f", {performer.rate:.0f} frames a second"
    seen = f"{performer.seen().sum()} of 20 joints seen"
    return f"user {performer.newest.user}: {seen}, {performer.distance:.2f} m away{rate}"


def reasons(sight: Sight) -> list[Reason]:
    """Return why nothing moves or not as it should, the most important first; empty where all is well."""
    found = [] if sight.picture is None else list(_of_picture(sight.picture))
    if not sight.performers:
        return [*found, *_of_nobody(sight)]
    for user, performer in sorted(sight.performers.items()):
        found += _of_performer(f"User {user}", performer, sight.picture)
    return [*found, _of_failure(sight)] if sight.failure else found


def status_line(sight: Sight) -> str:
    """Return one line that says what is wrong, what to do about it, and how well each performer is seen.

    Texts of drivers and of the network are part of it. Characters that a terminal would obey become spaces.
    """
    problem = next(iter(reasons(sight)), Reason("All is well."))
    performers = [told(performer) for _, performer in sorted(sight.performers.items())]
    line = " · ".join(text for text in (problem.what, problem.fix, *performers) if text)
    return "".join(character if character.isprintable() else " " for character in line)


def summary(sight: Sight, why: Sequence[Reason]) -> dict[str, Any]:
    """Return what was seen as plain values for JSON."""
    return {
        "source": sight.source,
        "seconds": sight.seconds,
        "received": sight.received,
        "refused": sight.refused,
        "picture": None if sight.picture is None else _picture_summary(sight.picture),
        "performers": [
            {
                "user": user,
                "joints_seen": int(performer.seen().sum()),
                "distance": performer.distance,
                "rate": performer.rate,
                "confidence": dict(zip(JOINTS, performer.newest.confidence.tolist(), strict=True)),
            }
            for user, performer in sorted(sight.performers.items())
        ],
        "gone": sorted(sight.gone),
        "sensor": None if sight.level is None else asdict(sight.level),
        "reasons": [asdict(reason) for reason in why],
    }


def _picture_summary(picture: Picture) -> dict[str, Any]:
    return {
        "width": picture.lens.width,
        "height": picture.lens.height,
        "brightness": None if picture.color is None else float(picture.color.mean()),
        "depth_known": None if picture.depth is None else float((picture.depth > 0).mean()),
    }


def _of_picture(picture: Picture) -> Iterator[Reason]:
    if picture.color is not None:
        brightness = float(picture.color.mean())
        if brightness < BLACK:
            yield Reason(
                "The picture is black.", "Uncover the lens, switch on the light, end other programs that use it."
            )
        elif brightness < DARK:
            yield Reason("The picture is dark.", "Light the performer from the front.")
    if picture.depth is not None:
        share = float((picture.depth > 0).mean())
        if share < NO_DEPTH:
            yield Reason(
                "The sensor measures no depth.",
                "Keep the sun off, uncover the sensor's other windows, and stand at least a metre away.",
            )
        elif share < LITTLE_DEPTH:
            yield Reason(
                f"The sensor measures depth in {share:.0%} of the picture.",
                "Keep the sun off, and glass, mirrors and black cloth out of view.",
            )


def _of_failure(sight: Sight) -> Reason:
    return Reason(sight.failure, "It is opened again twice a second." if sight.retried else "")


def _of_nobody(sight: Sight) -> Iterator[Reason]:
    if sight.failure:
        yield _of_failure(sight)
    elif sight.refused:
        kinds = ", ".join(f"{reason} ({count} ×)" for reason, count in sorted(sight.refused.items()))
        yield Reason(
            f"What came were no performers: {kinds}.",
            "Set the sender to one of the formats of docs/senders.md.",
        )
    elif not sight.received and sight.listens:
        yield Reason(
            f"Nothing has come in {sight.silent:.0f} s.",
            "Start the sender, have it send to this machine and port, and let UDP through the firewall.",
        )
    elif not sight.received:
        yield Reason(f"No picture has come in {sight.silent:.0f} s.", "Look after the cable and the power supply.")
    elif sight.listens:
        yield Reason("Packets come, with nobody in them.", "See whether the sender's own window shows somebody.")
    else:
        yield Reason(
            "Nobody is in view.", "Stand 1.5 to 3.5 m away and face the sensor, so that it sees you from head to foot."
        )
    for user in sorted(sight.gone):
        yield Reason(f"User {user} was there and is gone.")


def _of_performer(name: str, performer: Performer, picture: Picture | None) -> Iterator[Reason]:
    known = performer.known()
    if performer.still and performer.frames >= FROZEN:
        yield Reason(
            f"{name} does not move at all: {performer.frames} times the very same pose came.",
            "See whether the sender tracks somebody, or only shows a character at rest.",
        )
    if not known.all():
        yield Reason(f"{name}: nothing is known of {_names(~known)}.", "Turn to the sensor, with nothing in between.")
    guessed = known & ~performer.seen()
    if guessed.sum() > UNCERTAIN:
        yield Reason(
            f"{name}: {guessed.sum()} of 20 joints are guessed: {_names(guessed)}.",
            "Face the sensor from 1.5 to 3.5 m away, from head to foot in its picture and in good light.",
        )
    if picture is not None and (outside := known & ~_inside(performer, picture)).any():
        yield Reason(f"{name}: {_names(outside)} outside the picture.", "Step back, or tilt the sensor.")
    if picture is not None and picture.depth is not None and not NEAREST < performer.distance < FARTHEST:
        yield Reason(
            f"{name} is {performer.distance:.1f} m away.",
            f"Stay between {NEAREST:g} and {FARTHEST:g} m from the sensor.",
        )
    if performer.rate is not None and performer.rate < SLOW:
        yield Reason(
            f"{name}: only {performer.rate:.0f} frames a second come.",
            "Give a camera more light, and this machine or network less to do.",
        )


def _inside(performer: Performer, picture: Picture) -> NDArray[np.bool_]:
    """Return (20,) whether a joint is before the sensor and within its picture."""
    positions = performer.newest.positions
    before = positions[:, 2] > 0
    pixels = picture.lens.project(np.where(before[:, None], positions, 1.0))
    return before & (pixels >= 0).all(axis=1) & (pixels < [picture.lens.width, picture.lens.height]).all(axis=1)


def _known(frame: SkeletonFrame) -> NDArray[np.bool_]:
    return (frame.confidence > LOST) & np.isfinite(frame.positions).all(axis=1)


def _names(joints: NDArray[np.bool_]) -> str:
    """Name joints as people do: left hand, hip center."""
    named = [re.sub("(.+)_(left|right)", r"\2 \1", name).replace("_", " ") for name in JOINTS]
    return ", ".join(name for name, chosen in zip(named, joints, strict=True) if chosen)
