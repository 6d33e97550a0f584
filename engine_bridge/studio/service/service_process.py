"""The service that the studio starts: a child process, which is restarted if it ends, and its service file."""

import asyncio
import contextlib
import json
import logging
import sys
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from engine_bridge.studio.messages.state import ServiceState
from puppetline.child_process import bound_to_parent
from puppetline.interrupts import END, OWN_GROUP

START_SECONDS = 600.0
"""Maximum time from the start of the service until it serves, in seconds. The first start on a machine compiles."""

STOP_SECONDS = 10.0
"""Maximum time that the service may take to end, in seconds."""

ABOUT_COMPILED = 40
"""Approximate number of functions that the first start on a machine compiles, for the progress on the page."""

RETRY_SECONDS = 0.5, 1.0, 2.0, 5.0
"""Time before a restart of the service, in seconds: after its first, second, … failure in a row."""

STEADY_SECONDS = 30.0
"""Run time of the service after which its earlier failures no longer count, in seconds."""

MAX_LINES = 200
"""Number of log lines of the service that are kept, for the reason of its end."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Reached:
    """A running service: addresses of its control socket and its stream, and its token.

    The stream's address is ``ws://…`` for a service of the studio, and ``tcp://…`` (ZeroMQ) for one that it has joined.
    """

    control: str
    stream: str
    token: str | None


class ServiceProcess:
    """Keeps the service of a service file running.

    Parameters
    ----------
    file : Path
        Service file; written by `write`.
    token : str
        Token in the file that the service file names.
    changed : callable
        Called when `state` or `reached` has changed.

    Attributes
    ----------
    state : ServiceState
    reached : Reached or None
    """

    def __init__(self, file: Path, token: str, changed: Callable[[], None]) -> None:
        self.state = ServiceState()
        self.reached: Reached | None = None
        self._file, self._token, self._changed = file, token, changed
        self._wanted = False
        self._process: asyncio.subprocess.Process | None = None
        self._ready: asyncio.subprocess.Process | None = None
        self._keeper: asyncio.Task[None] | None = None
        self._serving = asyncio.Event()

    async def get_ready(self) -> None:
        """Start a process that loads its modules, which takes longer than to load a character, until `start`."""
        if self._ready is None and not self._wanted:
            self._ready = await self._spawn()

    async def start(self) -> None:
        """Start the service, and wait until it serves or has failed, at most `START_SECONDS`."""
        self._wanted = True
        if self._keeper is None or self._keeper.done():
            self._keeper = asyncio.create_task(self._keep())
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(START_SECONDS):
                await self._serving.wait()

    async def stop(self) -> None:
        """End the service."""
        self._wanted = False
        _end(self._process)
        ready, self._ready = self._ready, None
        if ready is not None:
            _end(ready)
            await ready.wait()
        keeper = self._keeper  # another call may stop it meanwhile
        if keeper is not None:
            await asyncio.wait([keeper], timeout=STOP_SECONDS)
            if not keeper.done():
                if self._process is not None:
                    self._process.kill()
                await asyncio.wait([keeper])
        self._keeper = None

    def write(self, stages: list[dict[str, Any]]) -> None:
        """Write the service file."""
        values = {
            "announce": False,
            "takes": "takes",
            "network": {"port": 0, "token_file": "token"},
            "websocket": {"port": 0},
            "stage": stages,
        }
        beside = self._file.with_suffix(".new")
        beside.write_text(tomlkit.dumps(values), encoding="utf-8")
        beside.replace(self._file)

    async def _keep(self) -> None:
        failures = 0
        while self._wanted:
            self._set(running=False, starting=True, text="")
            started = asyncio.get_running_loop().time()
            lines = await self._run()
            self.reached = None
            if not self._wanted:
                break
            failures = 1 if asyncio.get_running_loop().time() - started > STEADY_SECONDS else failures + 1
            problem = _reason(lines)
            log.warning("the service has ended: %s", problem)
            self._set(running=False, starting=True, restarts=self.state.restarts + 1, problem=problem, address="")
            self._serving.set()  # `start` returns, and its caller sees the problem
            await asyncio.sleep(RETRY_SECONDS[min(failures, len(RETRY_SECONDS)) - 1])
        self._serving.clear()
        self._set(running=False, starting=False, address="")

    async def _run(self) -> deque[str]:
        """Run the service to its end; return its last lines."""
        self._serving.clear()
        self._process = process = self._ready or await self._spawn()
        self._ready = None
        lines: deque[str] = deque(maxlen=MAX_LINES)
        assert process.stderr is not None  # noqa: S101 - pipes were asked for
        assert process.stdin is not None  # noqa: S101
        process.stdin.write(b"\n")
        try:
            async for line in _lines(process.stderr):
                lines.append(line)
                self._read(line)
        finally:
            if process.returncode is None:
                await process.wait()
        return lines

    async def _spawn(self) -> asyncio.subprocess.Process:
        """Start a process that waits for a line before it reads the service file."""
        command = ["-P", "-m", "puppetline", "serve", "--wait", "--config", str(self._file), "--log-format", "json"]
        return await asyncio.create_subprocess_exec(
            sys.executable,
            *command,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            **OWN_GROUP,  # Ctrl-C goes to the studio, which then ends the service
            **bound_to_parent(),
        )

    def _read(self, line: str) -> None:
        record = _record(line)
        if record.get("event") == "serving":
            found = record["fields"]
            stream = next((each for each in found["stream"] if each.startswith("ws")), "")
            self.reached = Reached(found["control"][0], stream, self._token)
            self._set(running=True, starting=False, address=found["control"][0], problem="", text="")
            self._serving.set()
        elif str(record.get("event")).startswith("compiling") and self.state.starting:
            count = record["fields"]["functions"]
            self._set(text=f"It compiles functions, once on this machine: {count} so far, of about {ABOUT_COMPILED}.")
        elif record.get("level") in ("WARNING", "ERROR", "warning", "error"):
            log.warning("service: %s", record.get("event"), extra={"fields": record.get("fields", {})})

    def _set(self, **values: Any) -> None:
        self.state = self.state.model_copy(update=values)
        self._changed()


def _end(process: asyncio.subprocess.Process | None) -> None:
    if process is not None and process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(END)


async def _lines(stream: asyncio.StreamReader) -> Any:
    """Yield lines of text; a line that is too long is skipped."""
    while True:
        try:
            line = await stream.readline()
        except ValueError:
            continue
        if not line:
            return
        yield line.decode(errors="replace").rstrip()


def _record(line: str) -> dict[str, Any]:
    try:
        record = json.loads(line)
    except ValueError:
        return {}
    return record if isinstance(record, dict) else {}


def _reason(lines: deque[str]) -> str:
    """Return why the service has ended, from its last lines."""
    for line in reversed(lines):
        if line.startswith("puppetline: "):
            return line.removeprefix("puppetline: ")
    for line in reversed(lines):
        record = _record(line)
        if str(record.get("level", "")).lower() == "error":
            return str(record["event"])
    return "It ended without a message."
