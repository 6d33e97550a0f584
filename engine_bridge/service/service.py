"""The live service: one loop that reads skeletons and sends characters until it is stopped.

Everything happens in one thread, in the order in which it arrives, and nothing waits: late data is dropped, unless a
take needs it. Jobs (calibrations, loading and writing files), logs, the announcement, the metrics and the status table
have threads.
"""

import contextlib
import logging
import math
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from functools import partial
from pathlib import Path
from typing import Any

import zmq

from engine_bridge.puppet.puppet import Puppet
from engine_bridge.service.background_jobs import Jobs
from engine_bridge.service.control.control_socket import Control
from engine_bridge.service.control.dispatcher import Command, Deferred, Dispatcher
from engine_bridge.service.control.requests import PlayTake
from engine_bridge.service.discovery import Announcement
from engine_bridge.service.kiosk.kiosk import Kiosk
from engine_bridge.service.loading.service_file import ServiceFile
from engine_bridge.service.loading.stage_loader import LoadedStage, load_stages
from engine_bridge.service.look_command import Looking
from engine_bridge.service.monitoring.logs import OnceASecond, fields
from engine_bridge.service.monitoring.status import Status
from engine_bridge.service.monitoring.systemd import Notifier
from engine_bridge.service.outputs.output import Opening, Output
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.security.endpoints import Endpoint, endpoints_of
from engine_bridge.service.security.guard import Guard
from engine_bridge.service.stages import calibration_store
from engine_bridge.service.stages.stage import Stage
from engine_bridge.service.stages.stage_runner import StageRunner
from engine_bridge.service.status_report import Reporter
from engine_bridge.service.system_signals import Signals
from engine_bridge.service.takes.count_in import CountIn
from engine_bridge.service.takes.take_folder import Takes
from engine_bridge.service.takes.take_playback import TakePlayback
from engine_bridge.service.takes.take_track import TakeTrack
from engine_bridge.service.takes.take_tracks import TakeTracks
from puppetline import clock
from puppetline.errors import ServiceError
from puppetline.memory import trim_memory

STATUS_SECONDS = 1.0
"""Time between two statuses, in seconds."""

STORE_SECONDS = 5.0
"""Time between two writes of the calibrations while a performer drives a character, in seconds."""

SWITCH_SECONDS = 0.0005
"""Maximum time that another thread may hold up the loop, in seconds; Python's default is ten times as long."""

log = logging.getLogger(__name__)
_rarely = OnceASecond(log)


class Service:
    """Everything that `puppetline serve` runs.

    Parameters
    ----------
    settings : ServiceFile
    folder : Path
        Folder that the files of the settings are relative to.
    commands : callable
        Binds the commands of the control socket to this service, see `engine_bridge.service.commands.commands`.
    show : callable, optional
        Called with each status.
    read_settings : callable, optional
        Reads the service file again at each reload. Its stages replace the previous ones; its other tables apply at the
        next start. Without it, the service file is not read again, only the puppet files.
    jobs : Jobs, optional
        Runs what must not delay the loop, in threads by default; the service closes it.

    Attributes
    ----------
    runners : list of StageRunner
    control : Control
    dispatcher : Dispatcher
        Carries out requests.
    takes : Takes
    playback : TakePlayback
    count_in : CountIn
    reloading : bool
        Whether stages and puppet files are being loaded again.
    status : Status
        The latest.

    Raises
    ------
    PuppetlineError
        An error in the settings or files, or a port that cannot be bound.
    """

    def __init__(
        self,
        settings: ServiceFile,
        folder: Path,
        commands: Callable[["Service"], Mapping[str, Command]],
        show: Callable[[Status], None] | None = None,
        read_settings: Callable[[], ServiceFile] | None = None,
        jobs: Jobs | None = None,
    ) -> None:
        self._settings, self._folder, self._commands, self._show = settings, folder, commands, show
        self._read_settings = read_settings
        self._jobs = jobs or Jobs()
        self._resources = contextlib.ExitStack()
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        settings, folder, keep = self._settings, self._folder, self._resources
        endpoints = endpoints_of(settings.network, folder)  # first: nothing else is as likely to fail
        keep.callback(self._jobs.close)
        self._tracks = TakeTracks()
        self.playback = TakePlayback(self.find, self.show_frames)
        self.count_in = CountIn(self.playback)
        self._reported: object = None
        outputs = [table for _, table in settings.output_tables()]
        self._load_stages = partial(load_stages, folder=folder, executor=self._jobs.calibrating, outputs=outputs)
        self.runners = [stage.runner for stage in self._load_stages(settings)]
        keep.callback(self._close_runners)
        calibration_store.recall(self._live_stages(), calibration_store.state_file())
        self._outputs: list[Output] = []
        self._bind(endpoints)
        self.takes = Takes(folder / settings.takes)
        self.kiosk: Kiosk | None = None
        self._reporter = Reporter()
        self._looking = Looking(self._jobs, self._answer)
        self.status = self._current_status()
        if settings.metrics is not None:
            from engine_bridge.service.monitoring.metrics import MetricsServer  # importing it takes a while

            keep.callback(MetricsServer(lambda: self.status, settings.metrics.port).close)
        self._announcement: Announcement | None = None
        if settings.announce:
            streams = [each for each in self.stream if each.startswith("tcp://")]  # ZeroMQ's, one per endpoint
            self._announcement = Announcement.of_most_open(streams, self.control.endpoints, endpoints, self.names)
            keep.callback(self._announcement.close)
        self._notifier = Notifier()
        keep.callback(self._notifier.close)
        self.reloading = self._reload_again = False
        self._waiting: list[Deferred] = []
        self._status_at = self._store_at = clock.now()
        if settings.kiosk is not None:  # last: closing it deletes the clips that it continues
            self.kiosk = Kiosk(settings.kiosk, self.takes.folder, self.count_in, self._play_clip, self._jobs)
            keep.callback(self.kiosk.close)

    def _bind(self, endpoints: list[Endpoint]) -> None:
        settings, keep = self._settings, self._resources
        context: zmq.Context[Any] = zmq.Context()
        keep.callback(context.term)
        try:
            self._guard = Guard(context, endpoints, settings.network.max_clients)
            keep.callback(self._guard.close)
            self.dispatcher = Dispatcher(self._commands(self))
            answer = partial(self.dispatcher.take, encoding="json")
            opening = Opening(self._characters(), context, endpoints, self._guard, answer)
            for _, table in settings.output_tables():
                output = table.open(opening)
                keep.callback(output.close)
                self._outputs.append(output)
            self.control = Control(context, endpoints, self.dispatcher)
            keep.callback(self.control.close)
        except zmq.ZMQError as error:
            where = ", ".join(f"{each.stream} and {each.control}" for each in endpoints)
            raise ServiceError(
                "[network]",
                found=f"addresses that cannot be bound: {where} ({error})",
                expected="ports that no other program uses",
                fix="Stop the other service, or choose another port with --port.",
            ) from error
        for socket in self.control.sockets:
            self._guard.watch(socket)
        self._poller = zmq.Poller()
        self._polled: set[Any] = set()

    @property
    def stream(self) -> list[str]:
        """Addresses at which clients receive characters."""
        return [address for output in self._outputs for address in output.endpoints]

    def run(self, signals: Signals) -> None:
        """Serve until a signal stops it."""
        with contextlib.ExitStack() as undo:
            undo.callback(sys.setswitchinterval, sys.getswitchinterval())
            sys.setswitchinterval(SWITCH_SECONDS)
            self._poller.register(signals, zmq.POLLIN)
            undo.callback(self._poller.unregister, signals)
            self._notifier.ready()
            log.info("serving", extra=fields(stream=self.stream, control=self.control.endpoints))
            while not signals.stop:
                self.turn()
                if signals.take_reload():
                    self._reload(None)
            self._notifier.stopping()

    def close(self) -> None:
        """End all takes and close everything; closing again does nothing."""
        self._resources.close()

    def reload(self) -> Deferred:
        """Load stages and puppet files again, while the stream continues; the answer comes when they are loaded."""
        deferred = Deferred()
        self._reload(deferred)
        return deferred

    @property
    def players(self) -> list[tuple[StageRunner, CharacterPlayer]]:
        """The players of all characters, each with its stage."""
        return [(runner, player) for runner in self.runners for player in runner.stage.players]

    @property
    def names(self) -> list[str]:
        """Names of all characters."""
        return [player.character.name for _, player in self.players]

    def find(self, character: str) -> tuple[StageRunner, CharacterPlayer] | None:
        """Return the stage and the player of a character; None for an unknown name."""
        return next((found for found in self.players if found[1].character.name == character), None)

    def play_take(self, player: CharacterPlayer, path: Path, asked: PlayTake) -> Deferred:
        """Play a take on a character; the answer comes when its motion is computed."""

        def played(track: TakeTrack) -> dict[str, Any]:
            added = self.playback.add(track, asked.at, asked.start, asked.stop, asked.beside, pause=asked.pause)
            self._refresh_takes()  # a reload may have replaced the character meanwhile
            return {**added, "note": track.note or None}

        return self._later(self._jobs.loading, partial(self._tracks.of, player, path, asked.part), played)

    def load_take(self, player: CharacterPlayer, path: Path, part: str | None) -> Deferred:
        """Compute the motion of a take on a character, so that it can be played at once."""
        load = partial(self._tracks.of, player, path, part)
        return self._later(self._jobs.loading, load, lambda track: {"seconds": track.seconds})

    def _refresh_takes(self) -> None:
        """Compute the motion of takes again for characters whose mapping or files have changed."""
        for player, track in self.playback.stale():
            load = partial(self._tracks.of, player, track.path, track.part)
            self._jobs.start(self._jobs.loading, load, lambda loaded: self.playback.replace(loaded.result()))

    def stop_recording(self, runner: StageRunner) -> Deferred | None:
        """End a take; the answer comes when all of it is on the disk. None if there is no take."""
        recorder = runner.stop_recording()
        if recorder is None:
            return None
        path, stage = recorder.path, runner.stage.name

        def facts(_: None) -> dict[str, Any]:
            return {"stage": stage, "take": path.stem, "bytes": path.stat().st_size}

        return self._later(self._jobs.writing, recorder.close, facts)

    def _play_clip(self, name: str, path: Path) -> None:
        """Show what a visitor has recorded, unless the character is gone."""
        found = self.find(name)
        if found is not None:
            self.play_take(found[1], path, PlayTake(character=name, take=path.stem, at=0.0))

    def look(self, runner: StageRunner) -> Deferred:
        """Report what the source of a stage sees; the answer comes when the image is drawn."""
        return self._looking.ask(runner)

    def remap(self, runner: StageRunner, player: CharacterPlayer, puppet: Puppet) -> None:
        """Move a character's handles by other joints, and change its idle motion as soon as that is computed."""
        if puppet == player.character.prepared.puppet:
            return
        runner.remap(player, puppet)
        self._announce_characters()
        self._refresh_takes()
        self._jobs.start(self._jobs.loading, player.make_idle, lambda idle: runner.take_idle(player, idle.result()))

    def edit(self, player: CharacterPlayer, puppet: Puppet, shown: Callable[[CharacterPlayer], Any]) -> Deferred:
        """Load a character with another puppet; the answer is what `shown` makes of its player."""
        return self._later(self._jobs.loading, partial(player.with_puppet, puppet), shown)

    def replace(self, runner: StageRunner, player: CharacterPlayer, by: CharacterPlayer) -> None:
        """Show a character with the puppet that was loaded."""
        runner.replace_players([by if each is player else each for each in runner.stage.players])
        self._announce_characters()
        self._refresh_takes()

    def save(self, player: CharacterPlayer, result: Callable[[], Any]) -> Deferred:
        """Write a character's mapping into its puppet file; the answer is `result()`, called when it is written."""
        write = partial(player.document.save, player.character.prepared.puppet)
        return self._later(self._jobs.writing, write, lambda _: result())

    def show_frames(self, runner: StageRunner, frames: list[Frame]) -> None:
        """Offer frames to all outputs."""
        for frame in frames:
            for output in self._outputs:
                self._guarded(output.offer, frame)
            self._guarded(self._reporter.sent, runner.stage.name, frame)

    def _reload(self, deferred: Deferred | None) -> None:
        """Load now; if files are being loaded, load again afterwards, because they may have changed since."""
        if deferred is not None:
            self._waiting.append(deferred)
        self._reload_again = self.reloading
        if self.reloading:
            return
        self.reloading = True
        self._notifier.reloading()
        waiting, self._waiting = self._waiting, []
        self._jobs.start(self._jobs.loading, self._load, lambda loaded: self._take_over(loaded, waiting))

    def _load(self) -> list[LoadedStage]:
        """Load the stages of the service file again; runs in a thread."""
        settings = self._settings if self._read_settings is None else self._read_settings()
        return self._load_stages(settings, runners=list(self.runners))

    def turn(self) -> None:
        """Wait until something arrives or is due, and process it: skeletons first."""
        self._watch_sockets()
        due = [runner.due() for runner in self.runners] + [output.due() for output in self._outputs]
        kiosk = None if self.reloading else self.kiosk  # the reload would end a recording that begins now
        due += [self.playback.due(), self.count_in.due(), math.inf if kiosk is None else kiosk.due()]
        ready = dict(clock.block(min(*due, self._status_at), lambda left: self._poller.poll(math.ceil(1000 * left))))
        for runner in self.runners:
            if runner.source.fileno() in ready or runner.due() <= clock.now():
                self._guarded(self._take_in, runner)
        self._guarded(self.playback.advance)
        self._guarded(self.count_in.advance)
        if kiosk is not None:
            self._guarded(kiosk.advance, self.runners)
        for output in self._outputs:
            self._guarded(output.send_due)
        if any(each in ready for each in self._guard.sockets):
            self._guarded(self._guard.handle)
        readers: list[Output | Control] = [*self._outputs, self.control]
        for reader in readers:
            for each in reader.sockets:
                if each in ready:
                    self._guarded(reader.handle, each)
        self._guarded(self._finish_jobs)
        self._notifier.watchdog(sum(runner.events for runner in self.runners))

    def _watch_sockets(self) -> None:
        """Poll what is open now: sources that reconnect and outputs with clients open other sockets."""
        files = (runner.source.fileno() for runner in self.runners)
        outputs = (socket for output in self._outputs for socket in output.sockets)
        polled = {*self._guard.sockets, *self.control.sockets, *outputs, *files} - {None}
        for gone in self._polled - polled:
            self._poller.unregister(gone)
        for new in polled - self._polled:
            self._poller.register(new, zmq.POLLIN)
        self._polled = polled

    def _finish_jobs(self) -> None:
        """Finish jobs, and report the status when it is due."""
        for future, finish in self._jobs.take_finished():
            self._guarded(finish, future)
        self._guarded(self._looking.advance, self.runners)
        now = clock.now()
        clips = () if self.kiosk is None else tuple(each.seconds_left is None for each in self.kiosk.clips)
        counts = self.playback.changes, clips, *((self.count_in.left(each), each.recording) for each in self.runners)
        if now >= self._status_at or counts != self._reported:
            self._reported = counts
            self._status_at = max(self._status_at + STATUS_SECONDS, now)
            self._report()

    def _guarded(self, do: Callable[..., None], *arguments: object) -> None:
        """Call a function whose failure must not end the service."""
        try:
            do(*arguments)
        except Exception as error:
            _rarely.warning("internal error", why=f"{type(error).__name__}: {error}")
            log.debug("internal error", exc_info=True)

    def _take_in(self, runner: StageRunner) -> None:
        before = runner.skeletons
        if self.kiosk is not None:
            runner.watch = partial(self.kiosk.see, runner)
        frames = runner.take_in()
        self._reporter.received(runner.stage.name, runner.skeletons - before)
        self.show_frames(runner, frames)

    def _take_over(self, loaded: Future[list[LoadedStage]], waiting: list[Deferred]) -> None:
        """Continue with stages that were loaded again, or unchanged if they could not be loaded."""
        self.reloading = False
        self._notifier.ready()
        error = loaded.exception()
        if error is None:
            self._replace_runners(loaded.result())
            self.status = self._current_status()
        for deferred in waiting:
            self._answer(deferred, loaded, lambda _: {"characters": self.names})
        if error is not None:
            log.error("reload failed, characters unchanged: %s", error)
        else:
            self._announce_characters()
            if self._announcement is not None:
                self._announcement.rename(self.names)
            self._jobs.loading.submit(trim_memory)
            log.info("reloaded", extra=fields(characters=self.names))
        if self._reload_again:
            self._reload(None)

    def _replace_runners(self, loaded: list[LoadedStage]) -> None:
        """Close the stages that are no longer in the service file, and continue with those that are."""
        before, self.runners = self.runners, [stage.runner for stage in loaded]
        for runner in before:
            self._end_take(runner)
            if runner not in self.runners:
                runner.source.close()
        for stage in loaded:
            if stage.runner in before:
                stage.runner.stage.name = stage.name
                stage.runner.replace_players(stage.players)
        self.playback.reserve()
        self._refresh_takes()

    def _close_runners(self) -> None:
        for runner in self.runners:
            self.count_in.cancel(runner)
            runner.close()

    def _end_take(self, runner: StageRunner) -> None:
        """End a take whose characters change: it could not be replayed as it was."""
        self.count_in.cancel(runner)
        if runner.recording is not None:
            log.warning("the reload ends the take", extra=fields(stage=runner.stage.name, take=runner.recording))
            self.stop_recording(runner)

    def _later(self, pool: Executor, work: Callable[[], Any], result: Callable[[Any], Any]) -> Deferred:
        """Run work in a thread; the answer is what `result` makes of its result."""
        deferred = Deferred()
        self._jobs.start(pool, work, lambda done: self._answer(deferred, done, result))
        return deferred

    def _answer(self, deferred: Deferred, done: Future[Any], result: Callable[[Any], Any]) -> None:
        """Send a deferred answer: the result of the work, or the error."""
        try:
            outcome = result(done.result())
        except Exception as error:
            outcome = error
        self.dispatcher.finish(deferred, outcome)

    def _characters(self) -> list[StreamedCharacter]:
        return [player.character for _, player in self.players]

    def _announce_characters(self) -> None:
        for output in self._outputs:
            output.announce(self._characters())

    def _live_stages(self) -> dict[str, tuple[Stage, float]]:
        """Return the stages whose performers are people, by their sources; a recording calibrates as it did before."""
        live = (runner for runner in self.runners if not runner.recorded)
        return {runner.source.name: (runner.stage, runner.source.now()) for runner in live}

    def _current_status(self) -> Status:
        outputs = [each.statistics for each in self._outputs]
        clips = () if self.kiosk is None else self.kiosk.clips
        timeline = self.playback.status()
        return self._reporter.status(self.runners, self._guard.clients, outputs, self.count_in.left, timeline, clips)

    def _report(self) -> None:
        status = self.status = self._current_status()
        for output in self._outputs:
            self._guarded(output.report, status)
        if self._show is not None:
            self._show(status)
        self._notifier.status(f"{status.performing} of {len(status.characters)} characters performing")
        if status.performing and clock.now() >= self._store_at:
            self._store_at = clock.now() + STORE_SECONDS
            known = calibration_store.known_performers(self._live_stages())
            self._jobs.writing.submit(calibration_store.write, known, calibration_store.state_file())
