"""The live service: one loop that takes skeletons in and sends characters out, until it is told to stop.

Everything happens in one thread, in the order in which it comes, and nothing waits: what is late is dropped where it
is late. Only calibrations, reloading and what has threads by nature (announcement, metrics, the status display) work
beside it.
"""

import contextlib
import gc
import ipaddress
import logging
import math
import signal
import socket
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import zmq

from engine_bridge.live import performers
from engine_bridge.live.cast import Cast
from engine_bridge.live.commands import commands
from engine_bridge.live.control import Control, Deferred
from engine_bridge.live.discovery import Announcement
from engine_bridge.live.doors import Door, doors
from engine_bridge.live.frame import Frame
from engine_bridge.live.guard import Guard
from engine_bridge.live.line import Line
from engine_bridge.live.logs import OnceASecond, fields
from engine_bridge.live.metrics import MetricsServer
from engine_bridge.live.osc_output import OscOutput, OscTarget
from engine_bridge.live.publisher import Publisher
from engine_bridge.live.role import Role
from engine_bridge.live.service_file import ServiceFile, stage_names
from engine_bridge.live.sources import RECORDED
from engine_bridge.live.stage import Stage
from engine_bridge.live.statistics import Statistics
from engine_bridge.live.systemd import Notifier
from engine_bridge.live.takes import Takes
from puppetline.errors import PuppetlineError, ServiceError

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
        self, settings: ServiceFile, folder: Path, show: Callable[[dict[str, Any]], None] | None = None
    ) -> None:
        self._settings, self._folder, self._show = settings, folder, show
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
        self._cast = Cast(settings, folder, self._calibrating)
        names = stage_names(settings)
        self.lines: list[Line] = []
        for name, table, roles in zip(names, settings.stage, self._cast.load(), strict=True):
            line = Line(table.source, Stage(name, roles, table.direction), folder)
            keep.callback(line.close)
            self.lines.append(line)
        performers.recall(self._live_stages(), performers.state_file())
        self._bind(opened)
        self.osc = OscOutput(
            [OscTarget(each.host, each.port, each.rate, each.send, each.characters) for each in settings.osc]
        )
        keep.callback(self.osc.close)
        self.takes = Takes(folder / settings.takes)
        self._statistics = Statistics()
        self._residuals: dict[str, float] = {}
        self.status = self._snapshot()
        if settings.metrics is not None:
            keep.callback(MetricsServer(lambda: self.status, settings.metrics.port).close)
        self._announcement = self._announce(opened) if settings.announce else None
        self._notifier = Notifier()
        keep.callback(self._notifier.close)
        self._reloading: Future[list[list[Role]]] | None = None
        self._waiting: list[Deferred] = []
        self._files: set[int] = set()
        self._status_at = self._keep_at = time.monotonic()
        self._stop = False

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
            self.control = Control(context, opened, commands(self))
            keep.callback(self.control.close)
        except zmq.ZMQError as error:
            where = ", ".join(f"{door.stream} and {door.control}" for door in opened)
            raise ServiceError(
                "[network]",
                found=f"that it cannot listen at {where} ({error})",
                expected="ports that nobody else has",
                fix="End the other service, or choose another port with --port.",
            ) from error
        watched = [self._guard.watch(each) for each in [*self.publisher.sockets, *self.control.sockets]]
        self._poller = zmq.Poller()
        for each in [*self.publisher.sockets, *self.control.sockets, self._guard.socket, *watched]:
            self._poller.register(each, zmq.POLLIN)

    def _announce(self, opened: list[Door]) -> Announcement:
        """Announce a door that other machines can reach, if there is one."""
        places = [endpoint.removeprefix("tcp://").rpartition(":") for endpoint in self.publisher.endpoints]
        best = max(range(len(opened)), key=lambda k: not ipaddress.ip_address(places[k][0].strip("[]")).is_loopback)
        host, _, port = places[best]
        control = self.control.endpoints[best].rpartition(":")[2]
        announcement = Announcement(host.strip("[]"), int(port), int(control), opened[best].mechanism, self._names())
        self._resources.callback(announcement.close)
        return announcement

    def run(self) -> None:
        """Serve until SIGTERM or SIGINT; SIGHUP reloads. To be called in the main thread."""
        wake, woken = socket.socketpair()
        with wake, woken, contextlib.ExitStack() as undo:
            wake.setblocking(False)
            woken.setblocking(False)
            undo.callback(signal.set_wakeup_fd, signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False))
            handlers = {"SIGTERM": self._stop_soon, "SIGINT": self._stop_soon, "SIGHUP": self._reload_soon}
            for name, handler in handlers.items():
                if hasattr(signal, name):
                    number = getattr(signal, name)
                    undo.callback(signal.signal, number, signal.signal(number, handler))
            undo.callback(sys.setswitchinterval, sys.getswitchinterval())
            sys.setswitchinterval(SWITCH)
            self._poller.register(woken, zmq.POLLIN)
            undo.callback(self._poller.unregister, woken)
            gc.collect()
            gc.freeze()  # what is loaded stays: no collection has to look at it again
            self._notifier.ready()
            log.info("serving", extra=fields(stream=self.publisher.endpoints, control=self.control.endpoints))
            while not self._stop:
                self._turn()
                with contextlib.suppress(BlockingIOError):
                    woken.recv(4096)
            self._notifier.stopping()

    def close(self) -> None:
        """End all takes and let go of everything; closing again does nothing."""
        self._resources.close()

    def reload(self) -> Deferred:
        """Load all puppets anew, beside the stream; the answer comes when they are there."""
        deferred = Deferred()
        self._waiting.append(deferred)
        if self._reloading is None:
            self._notifier.reloading()
            self._reloading = self._loading.submit(self._cast.load)
        return deferred

    def show_frames(self, line: Line, frames: list[Frame]) -> None:
        """Send frames to whoever wants them."""
        for frame in frames:
            self.publisher.publish(frame)
            self.osc.offer(frame)
            self._statistics.performed(line.stage.name, frame.character.name, frame.received)
            if "morphs" in frame.__dict__ and frame.morphs is not None:
                self._residuals[frame.character.name] = frame.morphs[1]

    def _stop_soon(self, *_signal: object) -> None:
        self._stop = True

    def _reload_soon(self, *_signal: object) -> None:
        self.reload()

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
        for handler in (self.publisher, self.control):
            for each in handler.sockets:
                if each in ready:
                    self._guarded(handler.handle, each)
        self._guarded(self.publisher.send_due)
        self._guarded(self._guard.handle)
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
        if self._reloading is not None and self._reloading.done():
            loaded, self._reloading = self._reloading, None
            self._take_over(loaded)
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

    def _take_over(self, loaded: Future[list[list[Role]]]) -> None:
        """Go on with characters that were loaded anew, or as before if they could not be."""
        self._notifier.ready()
        waiting, self._waiting = self._waiting, []
        outcome: Any
        try:
            for line, roles in zip(self.lines, loaded.result(), strict=True):
                line.stage.replace_roles(roles)
        except PuppetlineError as error:
            log.error("the characters stay as they are: %s", error)
            outcome = error
        else:
            self.publisher.announce([role.character for line in self.lines for role in line.stage.roles])
            if self._announcement is not None:
                self._announcement.update(self._names())
            log.info("loaded anew", extra=fields(characters=self._names()))
            outcome = {"characters": self._names()}
        for deferred in waiting:
            self.control.finish(deferred, outcome)

    def _names(self) -> list[str]:
        return [role.character.name for line in self.lines for role in line.stage.roles]

    def _live_stages(self) -> dict[str, tuple[Stage, float]]:
        """Return the stages whose performers are people, by their sources; a recording calibrates as it did before."""
        live = (line for line in self.lines if not line.source.name.startswith(RECORDED))
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
            known = performers.known_performers(self._live_stages())
            self._loading.submit(performers.write, known, performers.state_file())

    def _snapshot(self) -> dict[str, Any]:
        return self._statistics.snapshot(
            [stage_status(line) for line in self.lines],
            [
                {
                    "name": role.character.name,
                    "performer": role.user,
                    "state": role.state,
                    "residual": self._residuals.get(role.character.name),
                }
                for line in self.lines
                for role in line.stage.roles
            ],
            self._guard.clients,
            {"messages": self.publisher.messages, "bytes": self.publisher.bytes},
            self.osc.statistics,
        )


def stage_status(line: Line) -> dict[str, Any]:
    """Return what the status says of a stage, but for its figures."""
    now, casting, counts = line.source.now(), line.stage.casting, line.source.counts
    playing = {role.user: role for role in line.stage.roles if role.user is not None}
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
            }
            for user, presence in casting.present.items()
        ],
        "recording": line.recording,
    }
