"""From a source to its stage: events in, frames out, a take of it all on the side.

A source that fails is opened again and again; until then time goes on without it. A fault in what one event does is
logged and costs that event.
"""

import logging
import math
import time
from pathlib import Path

from capture.events import Cue, Event
from capture.recording import Recorder, as_recorded
from capture.skeleton import SkeletonFrame
from capture.source import Silence, SkeletonSource
from engine_bridge.live.frame import Frame
from engine_bridge.live.logs import OnceASecond, fields
from engine_bridge.live.sources import RECORDED, open_source
from engine_bridge.live.stage import Stage
from puppetline.errors import OutputError, PuppetlineError, SourceError

AGAIN = 0.5
"""Seconds between attempts to open a source that has failed."""

log = logging.getLogger(__name__)
_rarely = OnceASecond(log)


class Line:
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
    source : SkeletonSource
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
        self.source: SkeletonSource = open_source(uri, folder)
        self.events = self.skeletons = self.faults = 0
        self._uri, self._folder = uri, folder
        self._reopen_at = math.inf
        self._recorder: Recorder | None = None
        if self.source.beginning is not None and not stage.recall(self.source.beginning):
            log.info("the take was made with other puppets", extra=fields(stage=stage.name, source=uri))

    @property
    def recording(self) -> str | None:
        """The name of the take that is being recorded."""
        return None if self._recorder is None else self._recorder.path.stem

    def due(self) -> float:
        """Return when `take_in` wants to be called though nothing has come, `time.monotonic`."""
        return min(self.source.due(), self._reopen_at)

    def take_in(self) -> list[Frame]:
        """Take what has come, and return what became of it."""
        if time.monotonic() >= self._reopen_at:
            self._reopen()
        try:
            events = self.source.receive()
        except SourceError as error:
            self._go_silent(error)
            return []
        now, now_ns = self.source.now(), time.monotonic_ns()
        frames: list[Frame] = []
        for event in events:
            frames += self._perform(event, now_ns - int((now - event.time) * 1e9))
        return frames

    def cue(self, do: str, **arguments: object) -> list[Frame]:
        """Have something done on stage.

        Raises
        ------
        ServiceError
            It cannot be done.
        """
        cue = Cue(self.source.now(), do, arguments)
        frames = self.stage.step(cue, time.monotonic_ns())
        self._record(cue)
        return frames

    def start_recording(self, path: Path) -> None:
        """Begin a take.

        Raises
        ------
        OutputError
        """
        recorder = Recorder(path)
        try:
            recorder.write_beginning(self.stage.memory)
        except BaseException:
            recorder.close()
            raise
        self._recorder = recorder

    def stop_recording(self) -> Path | None:
        """End the take and return its file; None if there is none.

        Raises
        ------
        OutputError
            It is not wholly on the disk.
        """
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return None
        recorder.close()
        return recorder.path

    def close(self) -> None:
        """End the take and let go of the source."""
        self.source.close()
        try:
            self.stop_recording()
        except OutputError as error:
            log.error("the take is not whole: %s", error)

    def _perform(self, event: Event, received: int) -> list[Frame]:
        if isinstance(event, SkeletonFrame):
            event = as_recorded(event)
            self.skeletons += 1
        self._record(event)
        self.events += 1
        try:
            return self.stage.step(event, received)
        except PuppetlineError as error:  # a cue of a take that does not fit here
            _rarely.warning("an event was refused", stage=self.stage.name, why=str(error))
        except Exception as error:
            self.faults += 1
            _rarely.warning("a fault cost a frame", stage=self.stage.name, why=f"{type(error).__name__}: {error}")
            log.debug("a fault cost a frame", exc_info=True)
        return []

    def _record(self, event: Event) -> None:
        if self._recorder is None:
            return
        try:
            self._recorder.write(event)
        except OutputError as error:
            log.error("the take has ended: %s", error, extra=fields(stage=self.stage.name))
            self._recorder = None

    def _go_silent(self, error: SourceError) -> None:
        """Go on without the source; a recording that has ended is not opened again."""
        log.warning("the source is silent: %s", error, extra=fields(stage=self.stage.name))
        last = self.source.now()
        self.source.close()
        if not self._uri.startswith(RECORDED):
            self._reopen_at = time.monotonic() + AGAIN
        self.source = Silence(self._uri, self.source.counts, last)

    def _reopen(self) -> None:
        try:
            source = open_source(self._uri, self._folder)
        except PuppetlineError as error:
            _rarely.warning("the source cannot be opened", stage=self.stage.name, why=str(error))
            self._reopen_at = time.monotonic() + AGAIN
            return
        log.info("the source is back", extra=fields(stage=self.stage.name, source=self._uri))
        source.counts = self.source.counts
        self.source, self._reopen_at = source, math.inf
