"""The live service: one loop that takes skeletons in and sends characters out, until it is told to stop.

Everything happens in one thread, in the order in which it comes, and nothing waits: what is late is dropped where it
is late. Calibrations, reloading, disks and what has threads by nature (logs, announcement, metrics, the status display)
work beside it.
"""

import contextlib
import ctypes
import ipaddress
import logging
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import zmq

from capture.sensor_tilt import Level
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.puppet_document import PuppetDocument
from engine_bridge.service import calibration_store
from engine_bridge.service.character_loader import Cast
from engine_bridge.service.character_player import Role
from engine_bridge.service.control.control_socket import Command, Control, Deferred
from engine_bridge.service.discovery import Announcement
from engine_bridge.service.monitoring.logs import OnceASecond, fields
from engine_bridge.service.monitoring.statistics import Statistics
from engine_bridge.service.monitoring.systemd import Notifier
from engine_bridge.service.outputs.osc import OscOutput, OscTarget
from engine_bridge.service.outputs.zeromq import Publisher
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.security.endpoints import Door, doors
from engine_bridge.service.security.guard import Guard
from engine_bridge.service.service_file import ServiceFile, stage_names
from engine_bridge.service.signals import Signals
from engine_bridge.service.stage import Stage
from engine_bridge.service.stage_runner import Line
from engine_bridge.service.takes import Takes
from puppetline.errors import ServiceError

STATUS_INTERVAL = 1.0
"""Seconds from one status to the next."""

KEEP_INTERVAL = 5.0
"""Seconds after which calibrations are written to disk again while somebody performs."""

SWITCH = 0.0005
"""Seconds that a thread beside the loop may hold it up: Python's own default is ten times that."""

log = logging.getLogger(__name__)
_rarely = OnceASecond(log)


class Service:
    """Everything that `puppetline serve` runs.

    Parameters
    ----------
    settings : ServiceFile
    folder : Path
        What the files of the settings are relative to.
    commands : callable
        Binds to this service what clients may ask of it, see `engine_bridge.service.commands.commands`.
    show : callable, optional
        Told each status.

    Attributes
    ----------
    lines : list of Line
    publisher : Publisher
    control : Control
    takes : Takes
    status : dict
        The latest.

    Raises
    ------
    PuppetlineError
        Whatever is wrong with the settings, the files or the ports.
    """

    def __init__(
        self,
        settings: ServiceFile,
        folder: Path,
        commands: Callable[["Service"], Mapping[str, Command]],
        show: Callable[[dict[str, Any]], None] | None = None,
    ) -> None:
        self._settings, self._folder, self._commands, self._show = settings, folder, commands, show
        self._resources = contextlib.ExitStack()
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        settings, folder, keep = self._settings, self._folder, self._resources
        opened = doors(settings.network, folder)  # before the work: nothing else is as likely to be refused
        self._calibrating = ThreadPoolExecutor(2, "calibration")
        self._loading = ThreadPoolExecutor(1, "loading")
        keep.callback(self._calibrating.shutdown, wait=False, cancel_futures=True)
        keep.callback(self._loading.shutdown, wait=False, cancel_futures=True)
        self._writing = ThreadPoolExecutor(1, "writing")
        keep.callback(self._writing.shutdown)
        self._cast = Cast(settings, folder, self._calibrating)
        names = stage_names(settings)
        self.lines: list[Line] = []
        for name, table, roles in zip(names, settings.stage, self._cast.load(), strict=True):
            line = Line(table.source, Stage(name, roles, table.direction), folder)
            keep.callback(line.close)
            self.lines.append(line)
        calibration_store.recall(self._live_stages(), calibration_store.state_file())
        self._bind(opened)
        self.osc = OscOutput(
            [OscTarget(each.host, each.port, each.rate, each.send, each.characters) for each in settings.osc]
        )
        keep.callback(self.osc.close)
        self.takes = Takes(folder / settings.takes)
        self._statistics = Statistics()
        self._residuals: dict[str, float] = {}
        self._limited: Counter[str] = Counter()
        self.status = self._snapshot()
        if settings.metrics is not None:
            from engine_bridge.service.monitoring.metrics import MetricsServer  # few want it, and it takes a while

            keep.callback(MetricsServer(lambda: self.status, settings.metrics.port).close)
        if settings.announce:
            self._announce(opened)
        self._notifier = Notifier()
        keep.callback(self._notifier.close)
        self._jobs: list[tuple[Future[Any], Callable[[Future[Any]], None]]] = []
        self._reloading = self._reload_again = False
        self._waiting: list[Deferred] = []
        self._files: set[int] = set()
        self._status_at = self._keep_at = time.monotonic()

    def _bind(self, opened: list[Door]) -> None:
        settings, keep = self._settings, self._resources
        context: zmq.Context[Any] = zmq.Context()
        keep.callback(context.term)
        try:
            self._guard = Guard(context, opened, settings.network.max_clients)
            keep.callback(self._guard.close)
            self.publisher = Publisher(
                context, opened, [role.character for line in self.lines for role in line.stage.roles]
            )
            keep.callback(self.publisher.close)
            self._guard.gone = self.publisher.forget
            self.control = Control(context, opened, self._commands(self))
            keep.callback(self.control.close)
        except zmq.ZMQError as error:
            where = ", ".join(f"{door.stream} and {door.control}" for door in opened)
            raise ServiceError(
                "[network]",
                found=f"that it cannot listen at {where} ({error})",
                expected="ports that nobody else has",
                fix="End the other service, or choose another port with --port.",
            ) from error
        served = [*self.publisher.sockets, *self.control.sockets]
        self._gates = [self._guard.socket, *(self._guard.watch(each) for each in served)]
        self._poller = zmq.Poller()
        for each in [*served, *self._gates]:
            self._poller.register(each, zmq.POLLIN)

    def _announce(self, opened: list[Door]) -> None:
        """Announce a door that other machines can reach, if there is one."""
        places = [endpoint.removeprefix("tcp://").rpartition(":") for endpoint in self.publisher.endpoints]
        best = max(range(len(opened)), key=lambda k: not ipaddress.ip_address(places[k][0].strip("[]")).is_loopback)
        host, _, port = places[best]
        control = self.control.endpoints[best].rpartition(":")[2]
        announcement = Announcement(host.strip("[]"), int(port), int(control), opened[best].mechanism, self._names())
        self._resources.callback(announcement.close)

    def run(self, signals: Signals) -> None:
        """Serve until somebody says stop."""
        with contextlib.ExitStack() as undo:
            undo.callback(sys.setswitchinterval, sys.getswitchinterval())
            sys.setswitchinterval(SWITCH)
            self._poller.register(signals, zmq.POLLIN)
            undo.callback(self._poller.unregister, signals)
            self._notifier.ready()
            log.info("serving", extra=fields(stream=self.publisher.endpoints, control=self.control.endpoints))
            while not signals.stop:
                self._turn()
                if signals.take_reload():
                    self._reload(None)
            self._notifier.stopping()

    def close(self) -> None:
        """End all takes and let go of everything; closing again does nothing."""
        self._resources.close()

    def reload(self) -> Deferred:
        """Load all puppets anew, beside the stream; the answer comes when they are there."""
        deferred = Deferred()
        self._reload(deferred)
        return deferred

    def stop_recording(self, line: Line) -> Deferred | None:
        """End a take; the answer comes when all of it is on the disk. None if there is no take."""
        recorder = line.stop_recording()
        if recorder is None:
            return None
        deferred = Deferred()

        def answer(closed: Future[None]) -> None:
            facts = {"stage": line.stage.name, "take": recorder.path.stem}
            self._answer(deferred, closed, lambda _: facts | {"bytes": recorder.path.stat().st_size})

        self._jobs.append((self._writing.submit(recorder.close), answer))
        return deferred

    def document(self, role: Role) -> PuppetDocument:
        """Return the file that a character's puppet was loaded from."""
        return self._cast.document(role)

    def remap(self, line: Line, role: Role, puppet: Puppet) -> None:
        """Have other joints move a character's handles, at once, and what it does by itself as soon as it is there."""
        if puppet == role.character.rig.puppet:
            return
        line.remap(role, puppet)
        self.publisher.redescribe(role.character)
        self._jobs.append((self._loading.submit(role.make_idle), lambda made: line.take_idle(role, made.result())))

    def save(self, role: Role, result: Callable[[], Any]) -> Deferred:
        """Write a character's mapping into its puppet file; the answer, made then, comes when it is there."""
        deferred = Deferred()
        saving = self._writing.submit(self.document(role).save, role.character.rig.puppet)
        self._jobs.append((saving, lambda saved: self._answer(deferred, saved, lambda _: result())))
        return deferred

    def show_frames(self, line: Line, frames: list[Frame]) -> None:
        """Send frames to whoever wants them."""
        for frame in frames:
            self._guarded(self._show_frame, line, frame)

    def _show_frame(self, line: Line, frame: Frame) -> None:
        self.publisher.publish(frame)
        self.osc.offer(frame)
        self._statistics.performed(line.stage.name, frame.character.name, frame.received)
        if "morphs" in frame.__dict__ and frame.morphs is not None:
            self._residuals[frame.character.name] = frame.morphs.residual
            self._limited[frame.character.name] += frame.morphs.limited

    def _reload(self, deferred: Deferred | None) -> None:
        """Load now, or again when what is being loaded is there: files may have changed since."""
        if deferred is not None:
            self._waiting.append(deferred)
        self._reload_again = self._reloading
        if self._reloading:
            return
        self._reloading = True
        self._notifier.reloading()
        waiting, self._waiting = self._waiting, []
        self._jobs.append((self._loading.submit(self._cast.load), lambda loaded: self._take_over(loaded, waiting)))

    def _turn(self) -> None:
        """Wait until something comes or is due, and do it: skeletons first."""
        self._watch_sources()
        due = min(line.due() for line in self.lines)
        due = min(due, self.osc.due(), self.publisher.due(), self._status_at)
        ready = dict(self._poller.poll(math.ceil(1000 * max(0.0, due - time.monotonic()))))
        for line in self.lines:
            if line.source.fileno() in ready or line.due() <= time.monotonic():
                self._guarded(self._take_in, line)
        self._guarded(self.osc.send_due)
        if any(each in ready for each in self._gates):
            self._guarded(self._guard.handle)
        for handler in (self.publisher, self.control):
            for each in handler.sockets:
                if each in ready:
                    self._guarded(handler.handle, each)
        self._guarded(self.publisher.send_due)
        self._guarded(self._look_after)
        self._notifier.watchdog(sum(line.events for line in self.lines))

    def _watch_sources(self) -> None:
        """Poll the sources as they are now: one that was opened anew has another file."""
        files = {number for line in self.lines if (number := line.source.fileno()) is not None}
        for number in self._files - files:
            self._poller.unregister(number)
        for number in files - self._files:
            self._poller.register(number, zmq.POLLIN)
        self._files = files

    def _look_after(self) -> None:
        """Do what is done now and then."""
        done = [job for job in self._jobs if job[0].done()]
        self._jobs = [job for job in self._jobs if job not in done]
        for future, finish in done:
            self._guarded(finish, future)
        now = time.monotonic()
        if now >= self._status_at:
            self._status_at = max(self._status_at + STATUS_INTERVAL, now)
            self._report()

    def _guarded(self, do: Callable[..., None], *arguments: object) -> None:
        """Do something whose failure must not end the service."""
        try:
            do(*arguments)
        except Exception as error:
            _rarely.warning("a fault in the service", why=f"{type(error).__name__}: {error}")
            log.debug("a fault in the service", exc_info=True)

    def _take_in(self, line: Line) -> None:
        before = line.skeletons
        frames = line.take_in()
        for _ in range(line.skeletons - before):
            self._statistics.taken(line.stage.name)
        self.show_frames(line, frames)

    def _take_over(self, loaded: Future[list[list[Role]]], waiting: list[Deferred]) -> None:
        """Go on with characters that were loaded anew, or as before if they could not be."""
        self._reloading = False
        self._notifier.ready()
        for deferred in waiting:
            self._answer(deferred, loaded, lambda _: {"characters": self._names()})
        error = loaded.exception()
        if error is not None:
            log.error("the characters stay as they are: %s", error)
        else:
            for line, roles in zip(self.lines, loaded.result(), strict=True):
                self._end_take(line)
                line.replace_roles(roles)
            self.publisher.announce([role.character for line in self.lines for role in line.stage.roles])
            self._loading.submit(_give_back_memory)
            log.info("loaded anew", extra=fields(characters=self._names()))
        if self._reload_again:
            self._reload(None)

    def _end_take(self, line: Line) -> None:
        """End a take whose characters change: it could not play as it was."""
        if line.recording is not None:
            log.warning("the take ends with the reload", extra=fields(stage=line.stage.name, take=line.recording))
            self.stop_recording(line)

    def _answer(self, deferred: Deferred, done: Future[Any], result: Callable[[Any], Any]) -> None:
        """Give the answer that was put off: what became of the work, or why nothing did."""
        error = done.exception()
        self.control.finish(deferred, result(done.result()) if error is None else error)

    def _names(self) -> list[str]:
        return [role.character.name for line in self.lines for role in line.stage.roles]

    def _live_stages(self) -> dict[str, tuple[Stage, float]]:
        """Return the stages whose performers are people, by their sources; a recording calibrates as it did before."""
        live = (line for line in self.lines if not line.recorded)
        return {line.source.name: (line.stage, line.source.now()) for line in live}

    def _report(self) -> None:
        self.status = self._snapshot()
        self.publisher.publish_json("service/status", self.status)
        if self._show is not None:
            self._show(self.status)
        playing = sum(character["state"] == "performing" for character in self.status["characters"])
        self._notifier.status(f"{playing} of {len(self.status['characters'])} characters performing")
        if playing and time.monotonic() >= self._keep_at:
            self._keep_at = time.monotonic() + KEEP_INTERVAL
            known = calibration_store.known_performers(self._live_stages())
            self._writing.submit(calibration_store.write, known, calibration_store.state_file())

    def _snapshot(self) -> dict[str, Any]:
        return self._statistics.snapshot(
            [stage_status(line) for line in self.lines],
            [
                {
                    "name": role.character.name,
                    "performer": role.user,
                    "state": role.state,
                    "residual": self._residuals.get(role.character.name),
                    "limited": self._limited[role.character.name],
                }
                for line in self.lines
                for role in line.stage.roles
            ],
            self._guard.clients,
            {"messages": self.publisher.messages, "bytes": self.publisher.bytes},
            self.osc.statistics,
        )


def _give_back_memory() -> None:
    """Let the system have what the characters of before took: glibc keeps it, hundreds of megabytes of it."""
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none
        if trim is not None:
            trim(0)


def stage_status(line: Line) -> dict[str, Any]:
    """Return what the status says of a stage, but for its figures."""
    now, casting, counts = line.source.now(), line.stage.casting, line.source.counts
    playing = {role.user: role for role in line.stage.roles if role.user is not None}
    level = next((role.level for role in line.stage.roles if role.level != Level()), Level())
    return {
        "name": line.stage.name,
        "source": line.source.name,
        "dropped": counts.dropped,
        "refused": dict(counts.refused),
        "faults": line.faults,
        "users": [
            {
                "user": user,
                "state": playing[user].state if user in playing else "waiting",
                "character": playing[user].character.name if user in playing else None,
                "seen": round(max(0.0, now - presence.seen), 3),
                "distance": round(presence.distance, 2),
                **_measures(playing.get(user)),
            }
            for user, presence in casting.present.items()
        ],
        "sensor": {name: round(value, 2) for name, value in asdict(level).items()},
        "recording": line.recording,
    }


def _measures(role: Role | None) -> dict[str, float | None]:
    """Return what the status says of the body of whoever plays a role, None until they are calibrated."""
    calibration = None if role is None else role.calibration
    if calibration is None:
        return {"height": None, "reach": None}
    return {"height": round(calibration.height, 2), "reach": round(calibration.reach, 2)}
