"""Runs a stage: reads events from its source, returns frames, and records takes.

A source that fails is reopened; until then the stage continues without it. If an internal error occurs while an event
is processed, it is logged, and that event is lost.
"""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from capture import body, sound
from capture.events import Cue, Event
from capture.reconnecting import ReopeningSource
from capture.recording import Recorder, as_recorded
from capture.sensors.source_report import SourceMonitor, SourceReport
from capture.skeleton import SkeletonFrame
from capture.sound_input import open_sound
from capture.source import newest
from capture.sources.registry import open_source
from engine_bridge.performance.motion import Motion
from engine_bridge.performance.pose import TargetPose
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.service.monitoring.logs import OnceASecond, fields
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.stages.stage import Stage
from puppetline import clock
from puppetline.errors import OutputError, PuppetlineError, ServiceError

WATCHED_SECONDS = 3.0
"""Maximum period that a report on the source covers, in seconds; it starts again after so long without a request."""

_AnyEvent = TypeVar("_AnyEvent", bound=Event)

log = logging.getLogger(__name__)
_rarely = OnceASecond(log)


class StageRunner:
    """A source and the stage that it feeds.

    Parameters
    ----------
    uri : str
        Source.
    stage : Stage
    folder : Path
        Folder that files of the source and the sound are relative to.
    sound_name : str, optional
        What `open_sound` opens: the performers' voice, which is also recorded beside takes.

    Attributes
    ----------
    stage : Stage
    source : ReopeningSource
    sound_name : str or None
    events, skeletons : int
        Numbers of events processed so far, and of skeletons among them.
    watch : callable
        Called with each performer's frame.
    faults : int
        Number of events lost to internal errors.

    Raises
    ------
    PuppetlineError
        The source or the sound cannot be opened.
    """

    def __init__(self, uri: str, stage: Stage, folder: Path, sound_name: str | None = None) -> None:
        self.stage = stage
        self.events = self.skeletons = self.faults = 0
        self.watch: Callable[[SkeletonFrame], None] = lambda _: None
        self.sound_name = sound_name
        self._sound = None if sound_name is None else open_sound(sound_name, folder)
        self._sound_cue: str | None = None  # name of a file whose begin is not in the take yet
        self.source = ReopeningSource(uri, lambda: open_source(uri, folder))
        self._recorder: Recorder | None = None
        self._time = -math.inf
        self._directed: frozenset[str] = frozenset()  # characters whose calibrations come from a take
        self._overruled = False  # after a command, a take is like any other recording
        self._monitor: SourceMonitor | None = None
        self._reported_at = -math.inf

    @property
    def recorded(self) -> bool:
        """Whether the source is a recording."""
        return self.source.recorded

    @property
    def recording(self) -> str | None:
        """The name of the take that is being recorded."""
        return None if self._recorder is None else self._recorder.path.stem

    def due(self) -> float:
        """Return when to call `take_in` even if nothing has arrived, in seconds of `puppetline.clock`."""
        return self.source.due()

    def take_in(self) -> list[Frame]:
        """Process the events that have arrived, and return the frames.

        A take gets every frame, in which case each is shown too, because the take replays to the same motion.
        """
        self._listen()
        events = self.source.receive()
        self._watch(events)
        if not self.recorded and self._recorder is None:
            count, events = len(events), newest(events)
            self.source.counts.dropped += count - len(events)
        now, now_ns = self.source.now(), clock.now_ns()
        frames: list[Frame] = []
        for event in events:
            if isinstance(event, Cue) and self._skips(event):
                continue
            received = now_ns - int((now - event.time) * 1e9)
            event = self._with_voice(event, received)
            for each in (*self.stage.beginnings(event.time, self.recorded, self._directed), event):
                self._warn_of_pose(each)
                frames += self._perform(each, received)
        return frames

    def report(self) -> SourceReport:
        """Return what has arrived from the source while reports were requested, at most `WATCHED_SECONDS` ago."""
        return self._watched().report()

    def trace(self, joint: str) -> dict[int, tuple[list[float], list[list[float]]]]:
        """Return where a joint of each performer was in the last seconds, see `SourceMonitor.trace`."""
        return self._watched().trace(joint)

    def cue(self, do: str, **arguments: object) -> list[Frame]:
        """Carry out a command on the stage.

        Raises
        ------
        ServiceError
            It cannot be carried out; nothing changes.
        """
        self._overrule()
        cue = self._in_order(Cue(self.source.now(), do, arguments))
        try:
            frames = self.stage.step(cue, clock.now_ns())
        except ServiceError:
            raise
        except Exception:
            self._record(cue)  # it was carried out in part, as it will be in the replay
            raise
        self._record(cue)
        return frames

    def remap(self, player: CharacterPlayer, puppet: Puppet) -> None:
        """Change a character's mapping."""
        self._overrule()
        player.remap(puppet, max(self._time, self.source.now()))

    def replace_players(self, players: Sequence[CharacterPlayer]) -> None:
        """Replace the characters, see `Stage.replace_players`."""
        self._overrule()
        self.stage.replace_players(players)

    def take_idle(self, player: CharacterPlayer, idle: Motion[TargetPose] | None) -> None:
        """Use the idle motion that was computed for a character's new mapping."""
        player.take_idle(idle, max(self._time, self.source.now()))

    def start_recording(self, path: Path, timeline: Callable[[float], dict[str, Any] | None] = lambda _: None) -> None:
        """Begin a take.

        Parameters
        ----------
        path : Path
        timeline : callable
            Returns the takes that play and their timeline's position at a time of the source's clock, which the new
            take stores; None if no take plays.

        Raises
        ------
        OutputError
        """
        recorder = Recorder(path)
        try:
            if self._sound is not None:
                self._sound.record(path.with_suffix(sound.ENDING))
                self._sound_cue = path.with_suffix(sound.ENDING).name
            snapshot = self.stage.snapshot(self.source.now())
            snapshot["timeline"] = timeline(snapshot["time"])
            self._time = max(self._time, snapshot["time"])
            recorder.write(Cue(snapshot["time"], "stage", snapshot))
        except BaseException:
            recorder.close()
            self._stop_sound()
            raise
        self._recorder = recorder

    def stop_recording(self) -> Recorder | None:
        """End the take and return its recorder, whose closing may wait for the disk; None without a take."""
        if self._recorder is not None:
            self._listen()  # what was said since the last frame
        recorder, self._recorder = self._recorder, None
        self._stop_sound()
        return recorder

    def close(self) -> None:
        """End the take and close the source and the sound."""
        self.source.close()
        recorder = self.stop_recording()
        if self._sound is not None:
            self._sound.close()
        try:
            if recorder is not None:
                recorder.close()
        except OutputError as error:
            log.error("the take is incomplete: %s", error)

    def _watched(self) -> SourceMonitor:
        """Return the monitor of the source, which is dropped after `WATCHED_SECONDS` without a request."""
        self._reported_at = clock.now()
        if self._monitor is None:
            self._monitor = SourceMonitor(self.source, WATCHED_SECONDS)
        return self._monitor

    def _watch(self, events: list[Event]) -> None:
        """Remember events while reports are requested."""
        if self._monitor is None:
            return
        if clock.now() - self._reported_at > WATCHED_SECONDS:
            self._monitor = None
        else:
            self._monitor.remember(events)

    def _skips(self, cue: Cue) -> bool:
        """Return whether a cue of a recording does not apply here."""
        return (self._overruled and cue.do in ("stage", "begin")) or (self._sound is not None and cue.do == "sound")

    def _listen(self) -> None:
        """Process the sound that has arrived, and write its beginning into the take, once."""
        if self._sound is None:
            return
        try:
            self._sound.take_in()
        except OutputError as error:
            log.error("the sound has ended: %s", error, extra=fields(stage=self.stage.name))
        begin = self._sound.start
        if self._sound_cue is not None and begin is not None:
            begin += self.source.now() - clock.now()
            self._record(Cue(self._time, "sound", {"file": self._sound_cue, "at": begin}))
            self._sound_cue = None

    def _stop_sound(self) -> None:
        self._sound_cue = None
        if self._sound is None:
            return
        try:
            self._sound.stop()
        except OSError as error:
            log.error("the sound is incomplete: %s", error, extra=fields(stage=self.stage.name))

    def _with_voice(self, event: Event, received: int) -> Event:
        """Return a frame with the voice of its own time, in nanoseconds of the monotonic clock, unless it has one."""
        if self._sound is None or not isinstance(event, SkeletonFrame):
            return event
        return replace(event, channels={"voice": self._sound.voice_at(received / 1e9), **(event.channels or {})})

    def _warn_of_pose(self, event: Event) -> None:
        """Log a calibration that limbs which turn count from, in another pose than an upright stand."""
        if not isinstance(event, Cue) or event.do != "begin":
            return
        for player in self.stage.players:
            calibrated = player.next_calibration
            if player.character.name != event.arguments.get("character") or calibrated is None:
                continue
            turns = any(limb.follow == "turn" for limb in calibrated.prepared.puppet.limb)
            pose = calibrated.calibration.sensor.upright(calibrated.calibration.rest)
            bent = body.not_upright(pose) if turns else []
            if bent:
                log.warning(
                    "the performer did not stand upright with hanging arms; the character is at rest in that pose",
                    extra=fields(character=player.character.name, bent=", ".join(bent)),
                )

    def _perform(self, event: Event, received: int) -> list[Frame]:
        event = self._in_order(event)
        if isinstance(event, SkeletonFrame):
            event = as_recorded(event)
            self.skeletons += 1
            self.watch(event)
        self._record(event)
        self.events += 1
        try:
            frames = self.stage.step(event, received)
            if isinstance(event, Cue) and event.do == "stage":
                self._directed = frozenset(event.arguments["characters"])
            return frames
        except PuppetlineError as error:  # a cue of a take that does not fit this stage, an impossible pose
            _rarely.warning("an event was refused", stage=self.stage.name, why=str(error))
        except Exception as error:
            self.faults += 1
            _rarely.warning(
                "an internal error cost an event", stage=self.stage.name, why=f"{type(error).__name__}: {error}"
            )
            log.debug("an internal error cost an event", exc_info=True)
        return []

    def _overrule(self) -> None:
        """Ignore the calibrations of a take from now on."""
        self._directed, self._overruled = frozenset(), True

    def _in_order(self, event: _AnyEvent) -> _AnyEvent:
        """Return an event no earlier than the one before, so that a take is in order."""
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
