"""Kill each process of a kiosk in turn with SIGKILL, and measure how long its screen stands still, and what is lost.

python -m benchmarks.kiosk_kills PUPPET [--kills 50] [--json FILE]

The service plays a recording of a visitor who records again and again, and Chromium shows the screen. The killed
processes are the service, its page, the process that makes a film, Chromium, and all of them at once, as in a container
whose power fails. The script starts the service and Chromium again, as systemd does (packaging/systemd); the service
starts the rest.

- The time is that from the kill to the first frame of the character that the screen draws after it has connected again.
- A clip is lost if there is a take with frames, but in the end no film.
- An orphan is a process of the kiosk that lives on 10 s after its parent was killed.
"""

import argparse
import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import psutil

from benchmarks.live_peers import free_tcp_ports
from benchmarks.visitor import write_visitor
from engine_bridge.service.kiosk.clip import FOLDER

KINDS = ("service", "page", "film", "screen", "all")
"""What is killed in turn."""

RESTART_SECONDS = 0.2
"""Time after which the service is started again, as in the systemd unit, in seconds."""

STEADY_SECONDS = 3.0
"""Time for which the screen moves before the next kill, in seconds."""

STAND_SECONDS = 15.0
"""Time after a kill in which the screen notices that its connection has ended, in seconds."""

ORPHAN_SECONDS = 10.0
"""Time that a process has to end after its parent, in seconds."""

FILM_SECONDS = 300.0
"""Time after which the next film counts as lost, in seconds."""

GIVE_UP_SECONDS = 120.0
"""Time after which a screen counts as dead, and for which a film's process is waited for, in seconds."""

SETTINGS = """
announce = false
[network]
port = {port}
[kiosk]
count_in = 1
minutes = 1440.0
phone_port = 0
size = [160, 90]
[[stage]]
source = "replay:visitor.log?loop"
calibrate = "at_once"
[[stage.character]]
name = "character"
puppet = "{puppet}"
"""


class Kiosk:
    """A kiosk in a folder: the service and Chromium."""

    def __init__(self, folder: Path, puppet: Path) -> None:
        self.folder, self.visitors = folder, folder / "takes" / FOLDER
        port, self._page, self._debugger = free_tcp_ports(), free_tcp_ports(), free_tcp_ports()
        write_visitor(folder / "visitor.log", dance=1.0, away=1.0)
        (folder / "kiosk.toml").write_text(SETTINGS.format(port=port, puppet=puppet.resolve()))
        own = {"XDG_STATE_HOME": str(folder), "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
        self._environment = os.environ | own  # bytecode is written, as in an installation
        self.start_service()
        self._address = self._screen_address()
        self.start_screen()

    def start_service(self) -> None:
        """Start the service with its page."""
        command = [sys.executable, "-m", "puppetline", "serve", "--config", "kiosk.toml", "--studio", str(self._page)]
        with (self.folder / "output").open("a") as out, (self.folder / "log").open("a") as log:
            self.service = subprocess.Popen(command, cwd=self.folder, stdout=out, stderr=log, env=self._environment)

    def start_screen(self) -> None:
        """Start Chromium."""
        options = ["--headless=new", "--no-sandbox", "--window-size=320,180", "--use-angle=swiftshader"]
        options += ["--enable-unsafe-swiftshader", f"--user-data-dir={self.folder / 'profile'}"]
        command = ["chromium", *options, f"--remote-debugging-port={self._debugger}", self._address]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.screen = subprocess.Popen(command, **quiet)

    def find(self, kind: str) -> list[psutil.Process]:
        """Return the processes of a kind that there are now."""
        service, screen = psutil.Process(self.service.pid), psutil.Process(self.screen.pid)
        if kind == "all":
            return [each for one in (service, screen) for each in (one, *one.children(recursive=True))]
        if kind in ("service", "screen"):
            return [service if kind == "service" else screen]
        word = {"page": "studio", "film": "film"}[kind]
        return [each for each in service.children() if word in each.cmdline()][:1]

    async def shown(self, http: aiohttp.ClientSession) -> list[int] | None:
        """Return the numbers of the frames that the screen shows; None while it shows none."""
        try:
            async with asyncio.timeout(5), http.get(f"http://127.0.0.1:{self._debugger}/json") as reply:
                page = next(each for each in await reply.json() if each["type"] == "page")
            async with asyncio.timeout(5), http.ws_connect(page["webSocketDebuggerUrl"]) as socket:
                await socket.send_json(
                    {"id": 1, "method": "Runtime.evaluate", "params": {"expression": SHOWN, "returnByValue": True}}
                )
                value = json.loads((await socket.receive_json())["result"]["result"]["value"])
            return None if not value or None in value else value
        except (aiohttp.ClientError, TimeoutError, StopIteration, KeyError, OSError):
            return None

    def recorded(self) -> set[str]:
        """Return the codes of the takes with frames that there are."""
        takes = self.visitors.glob("*.log") if self.visitors.is_dir() else []
        return {path.stem for path in takes if path.read_bytes().count(b'"user"') > 2}

    def films(self) -> set[str]:
        """Return the codes of the films that there are."""
        return {path.stem for path in self.visitors.glob("*.mp4") if not path.name.startswith(".")}

    async def has_one_of(self, codes: set[str]) -> bool:
        """Return whether one of some films is there."""
        return bool(codes & self.films())

    def _screen_address(self) -> str:
        while not (found := re.search(r"http://\S+/kiosk#key=\S+", (self.folder / "output").read_text())):
            time.sleep(0.05)
        return found[0]

    def close(self) -> None:
        """End the processes."""
        for process in (self.screen, self.service):
            process.terminate()
            process.wait()


SHOWN = "JSON.stringify(window.screenShows?.state() === 'connected' ? screenShows.characters.shown : null)"
"""JavaScript: the numbers of the frames that are shown."""


async def until(condition: Callable[[], Awaitable[Any]], seconds: float = GIVE_UP_SECONDS) -> bool:
    """Wait until something is true; return whether it was in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if await condition():
            return True
        await asyncio.sleep(0.05)
    return False


async def kill(kiosk: Kiosk, kind: str, http: aiohttp.ClientSession) -> tuple[float | None, int]:
    """Kill a process; return the seconds until the screen moves again, and the number of orphans."""

    async def found() -> bool:
        return bool(kiosk.find(kind))

    if not await until(found):
        raise SystemExit(f"there was no process to kill: {kind}")
    before = await kiosk.shown(http)
    killed_ones = kiosk.find(kind)
    children = [child for each in killed_ones for child in each.children(recursive=True)]
    for each in killed_ones:
        with suppress(psutil.NoSuchProcess):  # a child ends with its parent
            each.kill()
    killed = time.monotonic()
    if kind in ("service", "all"):
        kiosk.service.wait()
        await asyncio.sleep(RESTART_SECONDS)
        kiosk.start_service()
    if kind in ("screen", "all"):
        kiosk.screen.wait()
        kiosk.start_screen()

    async def stands() -> bool:
        return await kiosk.shown(http) is None

    async def moves() -> bool:
        shown = await kiosk.shown(http)
        return shown is not None and shown != before

    stood = kind == "film" or await until(stands, STAND_SECONDS)
    seconds = time.monotonic() - killed if await until(moves) else None
    if not stood:
        print(f"the screen did not notice that the {kind} was killed", flush=True)
    await asyncio.sleep(max(STEADY_SECONDS, killed + ORPHAN_SECONDS * bool(children) - time.monotonic()))
    return seconds, sum(each.is_running() for each in children)


async def measure(kiosk: Kiosk, kills: int) -> dict[str, Any]:
    """Kill processes in turn, and return what was found."""
    seconds, orphans, recorded = defaultdict(list), 0, set[str]()
    async with aiohttp.ClientSession() as http:
        started = await until(lambda: kiosk.shown(http), 300)
        if not started:
            raise SystemExit((kiosk.folder / "log").read_text())
        for number, kind in enumerate(islice(cycle(KINDS), kills), 1):
            recorded |= kiosk.recorded()
            stood, left = await kill(kiosk, kind, http)
            recorded |= kiosk.recorded()
            orphans += left
            seconds[kind].append(stood)
            print(f"{number:3d} {kind:8s} {'dead' if stood is None else f'{stood:.1f} s'}, {left} orphans", flush=True)

        lost = recorded - kiosk.films()
        while lost and await until(partial(kiosk.has_one_of, lost), FILM_SECONDS):
            lost -= kiosk.films()
    return {"seconds": dict(seconds), "clips": len(recorded), "lost": sorted(lost), "orphans": orphans}


def table(found: dict[str, Any]) -> list[str]:
    """Return the result as lines of a table."""
    lines = ["| killed | times | median s | longest s | dead |", "| --- | --- | --- | --- | --- |"]
    for kind, all_of_it in found["seconds"].items():
        known = [each for each in all_of_it if each is not None]
        dead = len(all_of_it) - len(known)
        lines.append(f"| {kind} | {len(all_of_it)} | {np.median(known):.1f} | {max(known):.1f} | {dead} |")
    return [*lines, f"clips: {found['clips']}, lost: {len(found['lost'])}, orphans: {found['orphans']}"]


def main() -> None:
    """Run the measurement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("puppet", type=Path)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        kiosk = Kiosk(Path(folder), arguments.puppet)
        try:
            found = asyncio.run(measure(kiosk, arguments.kills))
        finally:
            kiosk.close()
        print("\n".join(table(found)))
        print((Path(folder) / "log").read_text()[-3000:], file=sys.stderr)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(found))


if __name__ == "__main__":
    main()
