"""From a source to its stage: events in, frames out, a take of it all on the side.

A source that fails is opened again and again; until then time goes on without it. A fault in what one event does is
logged and costs that event.
"""

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from capture.events import Cue, Event
from capture.reconnecting import Reopening
from capture.recording import Recorder, as_recorded
from capture.skeleton import SkeletonFrame
from capture.sources.registry import open_source
from engine_bridge.performance.idle import Idle
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.service.character_player import CharacterPlayer
from engine_bridge.service.monitoring.logs import OnceASecond, fields
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.stage import Stage
from puppetline.errors import OutputError, PuppetlineError, ServiceError

PREPARATION = 0.3
"""Seconds from a calibration to its use where a recording is played, which must do the same each time. It takes less
than that to work out; live, it is used as soon as it is there."""

_AnyEvent = TypeVar("_AnyEvent", bound=Event)

log = logging.getLogger(__name__)
_rarely = OnceASecond(log)


class StageRunner:
    """A source and the stage that it feeds.

    Parameters
    ----------
    uri : str
        Of the source.
    stage : Stage
    folder : Path
        What the files of a source are relative to.

    Attributes
    ----------
    stage : Stage
    source : Reopening
    events, skeletons : int
        Taken in so far, and how many of them were frames.
    faults : int
        Events so far that were lost to a fault.

    Raises
    ------
    PuppetlineError
        The source cannot be opened.
    """

    def __init__(self, uri: str, stage: Stage, folder: Path) -> None:
        self.stage = stage
        self.events = self.skeletons = self.faults = 0
        self.source = Reopening(uri, lambda: open_source(uri, folder))
        self._recorder: Recorder | None = None
        self._time = -math.inf
        self._directed: frozenset[str] = frozenset()  # characters whose calibrations a take says
        self._overruled = False  # as soon as somebody else has a say, a take is like any other recording

    @property
    def recorded(self) -> bool:
        """Whether the source is a recording, which nobody performs now."""
        return self.source.recorded

    @property
    def recording(self) -> str | None:
        """The name of the take that is being recorded."""
        return None if self._recorder is None else self._recorder.path.stem

    def due(self) -> float:
        """Return when `take_in` wants to be called though nothing has come, `time.monotonic`."""
        return self.source.due()

    def take_in(self) -> list[Frame]:
        """Take what has come, and return what became of it."""
        events = self.source.receive()
        now, now_ns = self.source.now(), time.monotonic_ns()
        frames: list[Frame] = []
        for event in events:
            if self._overruled and isinstance(event, Cue) and event.do in ("stage", "begin"):
                continue
            received = now_ns - int((now - event.time) * 1e9)
            for each in (*self._beginnings(event.time), event):
                frames += self._perform(each, received)
        return frames

    def cue(self, do: str, **arguments: object) -> list[Frame]:
        """Have something done on stage.

        Raises
        ------
        ServiceError
            It cannot be done, and nothing was.
        """
        self._overrule()
        cue = self._in_order(Cue(self.source.now(), do, arguments))
        try:
            frames = self.stage.step(cue, time.monotonic_ns())
        except ServiceError:
            raise
        except Exception:
            self._record(cue)  # half of it was done, and will be when the take plays
            raise
        self._record(cue)
        return frames

    def remap(self, role: CharacterPlayer, puppet: Puppet) -> None:
        """Have other joints move a character's handles."""
        self._overrule()
        role.remap(puppet, max(self._time, self.source.now()))

    def replace_roles(self, roles: Sequence[CharacterPlayer]) -> None:
        """Take over characters that were loaded again."""
        self._overrule()
        self.stage.replace_roles(roles)

    def take_idle(self, role: CharacterPlayer, idle: Idle | None) -> None:
        """Let a character do by itself what was worked out for its new mapping."""
        role.take_idle(idle, max(self._time, self.source.now()))

    def start_recording(self, path: Path) -> None:
        """Begin a take.

        Raises
        ------
        OutputError
        """
        recorder = Recorder(path)
        try:
            snapshot = self.stage.snapshot(self.source.now())
            self._time = max(self._time, snapshot["time"])
            recorder.write(Cue(snapshot["time"], "stage", snapshot))
        except BaseException:
            recorder.close()
            raise
        self._recorder = recorder

    def stop_recording(self) -> Recorder | None:
        """End the take and return what is to be closed, which may wait for the disk; None if there is none."""
        recorder, self._recorder = self._recorder, None
        return recorder

    def close(self) -> None:
        """End the take and let go of the source."""
        self.source.close()
        recorder = self.stop_recording()
        try:
            if recorder is not None:
                recorder.close()
        except OutputError as error:
            log.error("the take is not whole: %s", error)

    def _beginnings(self, moment: float) -> list[Cue]:
        """Return cues for the calibrations that are to be used from now on; a take has those of its characters."""
        return [
            Cue(moment, "begin", {"character": role.character.name, "calibration": role.next_calibration.to_json()})
            for role in self.stage.roles
            if role.next_calibration is not None
            and role.character.name not in self._directed
            and (
                moment >= role.next_calibration.asked + PREPARATION
                if self.recorded
                else role.next_calibration.working.done()
            )
        ]

    def _perform(self, event: Event, received: int) -> list[Frame]:
        event = self._in_order(event)
        if isinstance(event, SkeletonFrame):
            event = as_recorded(event)
            self.skeletons += 1
        self._record(event)
        self.events += 1
        try:
            frames = self.stage.step(event, received)
            if isinstance(event, Cue) and event.do == "stage":
                self._directed = frozenset(event.arguments["characters"])
            return frames
        except PuppetlineError as error:  # a cue of a take that does not fit here, a pose that is none
            _rarely.warning("an event was refused", stage=self.stage.name, why=str(error))
        except Exception as error:
            self.faults += 1
            _rarely.warning("a fault cost a frame", stage=self.stage.name, why=f"{type(error).__name__}: {error}")
            log.debug("a fault cost a frame", exc_info=True)
        return []

    def _overrule(self) -> None:
        """Give the take no say any more in who is calibrated when."""
        self._directed, self._overruled = frozenset(), True

    def _in_order(self, event: _AnyEvent) -> _AnyEvent:
        """Return an event at no earlier a time than the one before: what a take plays must be in order."""
        self._time = max(self._time, event.time)
        return event if event.time == self._time else replace(event, time=self._time)

    def _record(self, event: Event) -> None:
        if self._recorder is None:
            return
        try:
            self._recorder.write(event)
        except OutputError as error:
            log.error("the take has ended: %s", error, extra=fields(stage=self.stage.name))
            self._recorder = None
