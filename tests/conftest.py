"""The order in which tests run, and what they share."""

import fcntl
import gc
import importlib
import json
import os
import pickle
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from types import ModuleType
from typing import Any

import hypothesis
import numpy as np
import pytest
from numpy.typing import NDArray

from puppetline.clock import use

from .clock import GivenClock
from .commands import Commands
from .durations import BY_FILE, Durations
from .outside import PEERS, PLAYERS, ROOT, LeftOut, found, load_players
from .outside import missing as missing

# how long an example takes, and how many are made in a second, tells how busy the machine is
WITHOUT_CLOCK = hypothesis.settings(deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.register_profile("others each time", WITHOUT_CLOCK)
hypothesis.settings.register_profile("the same each time", WITHOUT_CLOCK, derandomize=True, database=None)

COMPILING = {
    "limbs": tuple(f"tests/solver/motion/test_{name}.py" for name in ("arms", "feet", "limb_motion", "steps")),
    "surfaces": ("tests/solver",),
}
"""Tests that use nearly all compiled loops, in two groups with different ones.

One worker runs each group first, so that no loop is compiled twice; a test is in the first group that it fits.
"""

INDEPENDENT = ("tests/capture", "tests/examples", "tests/test_")
"""Tests that do not use the solver; other workers run them while its loops are compiled."""

SLOW_SECONDS = 5.0
"""What a test marked `slow` is taken for in a file that has not run here yet."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--skipped", action="store_true", help="run only the tests that the last run skipped or left out")
    parser.addoption("--exhaustive", action="store_true", help="run also the tests that need hours or luck")
    parser.addoption("--durations-json", metavar="FILE", help="write the seconds of each test; list the slowest files")


def pytest_collection_finish(session: pytest.Session) -> None:
    """Search for garbage less often, and not among the tests: compiling takes a sixth less time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)


def pytest_configure(config: pytest.Config) -> None:
    # what examples find by luck, `make test-all` finds
    hypothesis.settings.load_profile("others each time" if config.option.exhaustive else "the same each time")
    config.pluginmanager.register(LeftOut(config))
    if not hasattr(config, "workerinput"):  # those report to the process that started them
        config.pluginmanager.register(Durations(config))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Start with the tests that compile; files that took long precede others, so that all workers end together."""
    if not config.option.exhaustive:
        config.hook.pytest_deselected(items=[item for item in items if item.get_closest_marker("exhaustive")])
        items[:] = [item for item in items if not item.get_closest_marker("exhaustive")]
    slow = Counter(item.nodeid.partition("::")[0] for item in items if item.get_closest_marker("slow"))
    seconds = config.cache.get(BY_FILE, {}) if hasattr(config, "cache") else {}
    compiles = any(_compiling(item.nodeid) for item in items)

    def turn(item: pytest.Item) -> tuple[int, float]:
        file = item.nodeid.partition("::")[0]
        if _compiling(file):
            return 0, 0
        if compiles and file.startswith(INDEPENDENT):
            return 1, 0
        return 2, -seconds.get(file, SLOW_SECONDS * slow[file])

    items.sort(key=turn)


def _compiling(nodeid: str) -> str | None:
    """Return the group of `COMPILING` that a test is in."""
    return next((group for group, files in COMPILING.items() if nodeid.startswith(files)), None)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each worker a whole file at a time, in the order of collection; a group of `COMPILING` is like one file."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return _compiling(nodeid) or super()._split_scope(nodeid)

    config.option.loadscopereorder = False
    return Scheduling(config, log)


@pytest.fixture
def until_end() -> Iterator[Callable[[Any], Any]]:
    """Return a function that returns what it is given, and closes it at the end of the test."""
    with ExitStack() as stack:
        yield lambda opened: stack.enter_context(closing(opened))


@pytest.fixture
def given_clock() -> Iterator[GivenClock]:
    """Give this process a clock that stands until something waits or the test advances it."""
    given = GivenClock()
    with use(given):
        yield given


@pytest.fixture(scope="session", autouse=True)
def _disks_are_not_waited_for() -> Iterator[None]:
    """Results of tests need not outlive a power cut."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def _no_process_has_a_low_priority() -> Iterator[None]:
    """Tests wait for processes to which a busy machine would give no time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "setpriority", lambda *_: None)
        yield


@pytest.fixture(scope="session")
def commands() -> Iterator[Commands]:
    """Start commands as processes, without loading Python and its libraries for each of them."""
    started = Commands()
    yield started
    started.close()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of real logs and meshes, which are not part of the project."""
    return found("data")


@pytest.fixture(scope="session")
def real_logs(real_data: Path) -> Path:
    return real_data / "logs"


@pytest.fixture(scope="session")
def camera() -> None:
    """Leave out tests of OpenCV and MediaPipe where they are not installed."""
    found("camera")


@pytest.fixture(scope="session")
def rendered_body() -> ModuleType:
    """Return the module benchmarks/rendered_body.py, which renders a performer whose joints are known."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        return importlib.import_module("benchmarks.rendered_body")


@pytest.fixture(scope="session")
def players() -> ModuleType:
    """Return the module benchmarks/players.py, which plays a .glb in other programs."""
    return load_players()


@pytest.fixture(scope="session")
def player(players: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Callable[..., Any]]:
    """Return a function that plays a .glb's first animation in a program at n evenly spaced times, ends included."""
    commands, folder = players.commands(), tmp_path_factory.mktemp("shown")

    def of(program: str) -> Callable[..., Any]:
        found(PLAYERS[program])
        return lambda path, n, *more: players.play(commands[program], path, n, folder / "shown", *more)

    return of


@pytest.fixture(scope="session")
def mono() -> tuple[str, str]:
    """Return the paths of Mono's compiler and of Mono."""
    return found("mono")


class Node:
    """Runs scripts of tests/peers, which keep what they have loaded; a new process starts after `MAX_SCRIPTS`."""

    MAX_SCRIPTS = 50
    """Maximum number of scripts that a process runs: it keeps their memory."""

    def __init__(self, program: str) -> None:
        self._program, self._count = program, 0
        self._process: subprocess.Popen[str] | None = None

    def run(self, script: str, *arguments: str | Path) -> str:
        """Run a script with arguments and return what it prints."""
        if self._process is None or self._count == self.MAX_SCRIPTS:
            self.close()
            command = [self._program, PEERS / "resident.mjs"]
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._count += 1
        print(json.dumps({"script": script, "arguments": [*map(str, arguments)]}), file=self._process.stdin, flush=True)
        answer = json.loads(self._process.stdout.readline())
        if answer["error"] is not None:
            pytest.fail(f"{script} {' '.join(map(str, arguments))}:\n{answer['error']}")
        return answer["output"]

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.communicate()
        self._process, self._count = None, 0


@pytest.fixture(scope="session")
def node() -> Iterator[Callable[..., str]]:
    """Run a script of tests/peers with arguments and return what it prints."""
    running = Node(found("node"))
    yield running.run
    running.close()


@pytest.fixture(scope="session")
def godot() -> str:
    """Return the path of Godot 4: the environment variable GODOT, or the one on PATH."""
    return found("godot")


@pytest.fixture(scope="session")
def screen() -> Callable[..., list[str]]:
    """Return a function that returns the beginning of a command which runs on a screen of its own, of some size."""
    program = found("xvfb")
    return lambda size="1280x720": [program, "-a", "-s", f"-screen 0 {size}x24"]


@pytest.fixture(scope="session")
def vulkan() -> Iterator[None]:
    """Let Godot draw with Vulkan on the processor."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VK_ICD_FILENAMES", str(found("vulkan")))
        yield


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Start Chromium, with a renderer that needs no graphics card; return Playwright's browser.

    Playwright's event loop runs until it is closed, and other tests cannot run theirs meanwhile.
    """
    program = found("browser")
    from playwright.sync_api import sync_playwright

    quiet = ("quic", "background-networking", "component-update", "sync")
    arguments = ["--no-sandbox", "--no-first-run", *(f"--disable-{name}" for name in quiet)]
    software = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing"]
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=program, args=[*arguments, *software])
        yield running
        running.close()


@pytest.fixture(scope="session")
def multicast() -> None:
    """Skip the test if this machine has no multicast on loopback."""
    from zeroconf import Zeroconf

    try:
        Zeroconf(["127.0.0.1"]).close()
    except OSError:
        pytest.skip("no multicast on loopback")


@pytest.fixture(scope="session")
def of_all_workers(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """Return a folder that all workers of this run share."""
    own = tmp_path_factory.getbasetemp()
    return own if worker_id == "master" else own.parent


@pytest.fixture(scope="session")
def made_once(of_all_workers: Path) -> Callable[[str, Callable[[Path], object]], Path]:
    """Return a folder by its name; the first worker that needs it has a function fill it, and the others wait."""

    def get(name: str, fill: Callable[[Path], object]) -> Path:
        folder, unfinished = of_all_workers / name, of_all_workers / f"{name}.unfinished"
        with (of_all_workers / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not folder.exists():
                shutil.rmtree(unfinished, ignore_errors=True)
                unfinished.mkdir()
                fill(unfinished)
                unfinished.rename(folder)
        return folder

    return get


@pytest.fixture(scope="session", autouse=True)
def example_character(made_once: Callable[[str, Callable[[Path], object]], Path]) -> Iterator[Callable[[str], Any]]:
    """Return an example character by its name; whatever needs one in this process gets it from here.

    It is made once for all workers, since that takes seconds.
    """
    from puppetline.examples.characters import CHARACTERS

    makers = dict(CHARACTERS)

    def make(name: str) -> Any:
        stored = made_once(
            f"character_{name}", lambda folder: (folder / name).write_bytes(pickle.dumps(makers[name]()))
        )
        return pickle.loads((stored / name).read_bytes())

    with pytest.MonkeyPatch.context() as patch:
        for name, maker in makers.items():
            patch.setitem(CHARACTERS, name, wraps(maker)(partial(make, name)))
        yield make


@pytest.fixture(scope="session")
def validate(node: Callable[..., str]) -> Callable[[Path], dict[str, Any]]:
    """Return the Khronos validator's report on a glTF file: counts of errors, warnings, infos, hints; messages."""
    return lambda path: json.loads(node("validate.mjs", path))[str(path)]


@pytest.fixture(scope="session")
def assert_valid_gltf(validate: Callable[[Path], dict[str, Any]]) -> Callable[[Path], None]:
    """Fail with the Khronos validator's messages if it reports an error or a warning in a glTF file."""

    def check(path: Path) -> None:
        report = validate(path)
        if report["errors"] or report["warnings"]:
            pytest.fail("\n".join(f"{m['code']} {m['pointer']}: {m['message']}" for m in report["messages"]))

    return check


@dataclass(frozen=True)
class PlayedMesh:
    """A primitive as three.js deforms it: (n, V, 3) world positions and unit normals; None if it has no normals."""

    part: tuple[int, int]
    """The node and the primitive of the file."""
    positions: NDArray[np.float32]
    normals: NDArray[np.float32] | None


@dataclass(frozen=True)
class Played:
    """The (n,) times of an animation in seconds, and the meshes in the order of the scene."""

    times: NDArray[np.float64]
    meshes: list[PlayedMesh]


@pytest.fixture
def play(node: Callable[..., str], tmp_path: Path) -> Callable[[Path, int], Played]:
    """Play a .glb's first animation in three.js at n evenly spaced times, the start and the end included."""

    def run(path: Path, n: int) -> Played:
        node("play.mjs", path, str(n), tmp_path / "played")
        scene = json.loads((tmp_path / "played.json").read_text(encoding="utf-8"))
        floats = np.fromfile(tmp_path / "played.bin", dtype="<f4")

        def block(start: int, count: int) -> NDArray[np.float32]:
            return floats[start : start + n * count * 3].reshape(n, count, 3)

        return Played(
            np.array(scene["times"]),
            [
                PlayedMesh(
                    (mesh["node"], mesh["primitive"]),
                    block(mesh["positions"], mesh["count"]),
                    None if mesh["normals"] is None else block(mesh["normals"], mesh["count"]),
                )
                for mesh in scene["meshes"]
            ],
        )

    return run


@pytest.fixture(scope="session")
def interpreted() -> Callable[[str], ModuleType]:
    """Return a function that loads a module whose compiled functions are plain Python functions.

    Tests of single functions with numbers computed by hand need no machine code; that machine code does the same is
    seen wherever the functions are used.
    """

    from puppetline import compiled as compiled_module  # it loads Numba, which reads the folder of compiled code

    def plain(function: Callable[..., Any] | None = None, **_options: Any) -> Any:
        return function or (lambda each: each)

    def load(name: str) -> ModuleType:
        room = name.partition(".")[0]
        compiled = {each: sys.modules.pop(each) for each in list(sys.modules) if each.partition(".")[0] == room}
        try:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(compiled_module, "compiled", plain)
                return importlib.import_module(name)
        finally:
            for each in [each for each in sys.modules if each.partition(".")[0] == room]:
                del sys.modules[each]
            sys.modules.update(compiled)

    return load
