"""Programs, libraries and data that are not part of the project, and the tests that need them.

A test requests them as fixtures. Where they are not here, such tests are left out, and one line says how many they are
and what to install; with ``PUPPETLINE_TEST_REQUIRE=data,node`` they fail instead. ``--skipped`` runs what the last run
left out.
"""

import importlib
import importlib.util
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, NoReturn

import pytest

ROOT = Path(__file__).parent.parent
PEERS = ROOT / "tests" / "peers"

OPENNI_HEADERS = Path("/usr/include/openni2")

SKIPPED = "puppetline/skipped"
"""Key in pytest's cache of the ids of the tests and files that the last run has skipped or left out."""


def loads(library: Path) -> bool:
    """Return whether a shared library loads, in another process, because this one would keep it."""
    command = [sys.executable, "-S", "-c", "import ctypes, sys; ctypes.CDLL(sys.argv[1])", library]
    return subprocess.run(command, stderr=subprocess.DEVNULL, check=False).returncode == 0


def _installed(pattern: str) -> Path | None:
    """Return a shared library of Debian's packages that loads."""
    return next(filter(loads, Path("/usr/lib").glob(f"*/{pattern}")), None)


def _godot() -> str | None:
    return shutil.which(os.environ.get("GODOT", "godot"))


def _vulkan() -> Path | None:
    """Return Mesa's driver for the processor, if Godot was built with Vulkan."""
    driver = min(Path("/usr/share/vulkan/icd.d").glob("lvp_icd.*.json"), default=None)
    if driver is None or (godot := _godot()) is None:
        return None
    command = [godot, "--headless", "--rendering-driver", "unknown"]  # it prints the drivers that it has
    printed = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    return driver if "'vulkan'" in printed else None


def _node() -> str | None:
    return shutil.which("node") if (PEERS / "node_modules").is_dir() else None


def _mono() -> tuple[str, str] | None:
    compiler, program = shutil.which("mcs"), shutil.which("mono")
    return (compiler, program) if compiler and program else None


def _browser() -> str | None:
    program = shutil.which("chromium") or shutil.which("google-chrome")
    return program if importlib.util.find_spec("playwright") else None


def _data() -> Path | None:
    folder = os.environ.get("PUPPETLINE_TEST_DATA")
    return Path(folder) if folder and Path(folder).is_dir() else None


@cache
def load_players() -> ModuleType:
    """Return the module benchmarks/players.py, which plays a .glb in other programs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        return importlib.import_module("benchmarks.players")


def _openni() -> Path | None:
    there = importlib.util.find_spec("openni") and shutil.which("g++") and OPENNI_HEADERS.is_dir()
    return _installed("libOpenNI2.so.0") if there else None


def _freenect() -> Path | None:
    there = shutil.which("gcc") and Path("/usr/include/libfreenect.h").exists()
    return _installed("libfreenect.so.0.5") if there and _installed("fakenect/libfreenect.so.0.5") else None


def _realsense() -> bool:
    from capture.sensors.realsense import load_realsense
    from puppetline.errors import SourceError

    try:
        return bool(load_realsense("librealsense"))
    except SourceError:
        return False


class Outside(NamedTuple):
    """What tests may need: its name, what to do to have it, and a function that returns it, or nothing true."""

    name: str
    fix: str
    find: Callable[[], Any]


OUTSIDE = {
    "assimp": Outside("assimp 5.1 or 5.2", "Debian 12: libassimp5", lambda: load_players().commands()["assimp"]),
    "blender": Outside("Blender's module", "make peers", lambda: load_players().commands()["Blender"]),
    "browser": Outside("Chromium and Playwright", "Debian: chromium; make peers", _browser),
    "camera": Outside("OpenCV and MediaPipe", "make test-camera", lambda: importlib.util.find_spec("mediapipe")),
    "data": Outside("real recordings and meshes", "set PUPPETLINE_TEST_DATA to their folder", _data),
    "freenect": Outside("libfreenect", "Debian: gcc libfreenect0.5 libfreenect-dev", _freenect),
    "godot": Outside("Godot 4.3 or newer", "put `godot` on PATH, or set GODOT to its path", _godot),
    "mono": Outside("Mono and its compiler", "Debian: mono-mcs mono-runtime", _mono),
    "node": Outside("node and tests/peers/node_modules", "make peers", _node),
    "openni": Outside("OpenNI2", "Debian: g++ libopenni2-0 libopenni2-dev", _openni),
    "realsense": Outside("librealsense", "Debian: libusb-1.0-0", _realsense),
    "vulkan": Outside("Godot with Vulkan on the processor", "Debian: mesa-vulkan-drivers", _vulkan),
    "xvfb": Outside("a screen in memory", "Debian: xvfb", lambda: shutil.which("xvfb-run")),
}
"""By the name in `PUPPETLINE_TEST_REQUIRE`."""

PLAYERS = {"Blender": "blender", "three.js": "node", "Babylon.js": "node", "Godot": "godot", "assimp": "assimp"}
"""What the parameters of tests with the fixture `player` need."""

FIXTURES = {key: key for key in ("browser", "camera", "freenect", "godot", "mono", "node", "vulkan")}
FIXTURES |= {"openni_folder": "openni", "real_data": "data", "screen": "xvfb", "virtual_realsense": "realsense"}
"""The part of `OUTSIDE` for which each fixture stands."""

REQUIRED = set(filter(None, os.environ.get("PUPPETLINE_TEST_REQUIRE", "").split(",")))
"""Parts of `OUTSIDE` that must be here: tests fail without them instead of being left out."""

if REQUIRED - OUTSIDE.keys():
    raise pytest.UsageError(
        f"PUPPETLINE_TEST_REQUIRE={','.join(sorted(REQUIRED))}: expected a comma-separated part of {sorted(OUTSIDE)}"
    )


@cache
def find(key: str) -> Any:
    """Return a part of `OUTSIDE`; nothing true if it is not here."""
    return OUTSIDE[key].find()


def missing(key: str, reason: str) -> NoReturn:
    """Skip the test; fail it if a part of `OUTSIDE` is in `REQUIRED`."""
    if key in REQUIRED:
        pytest.fail(f"{reason}, but PUPPETLINE_TEST_REQUIRE requires {key}", pytrace=False)
    pytest.skip(reason)


def found(key: str) -> Any:
    """Return a part of `OUTSIDE`; skip the test, or fail it, if it is not here."""
    return find(key) or missing(key, f"{OUTSIDE[key].name}: not here ({OUTSIDE[key].fix})")


def needs(item: pytest.Item) -> set[str]:
    """Return the parts of `OUTSIDE` that a test requests."""
    fixtures = set(item.fixturenames)
    played = item.callspec.params.values() if "player" in fixtures and hasattr(item, "callspec") else ()
    return {FIXTURES[name] for name in fixtures & FIXTURES.keys()} | {
        PLAYERS[each] for each in played if each in [*PLAYERS]
    }


class LeftOut:
    """Leaves out the tests that need what is not here; says and stores which were left out or skipped.

    The processes that run tests collect them too. They tell the one that started them what they have left out.
    """

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._skipped: set[str] = set()
        self._left_out: dict[str, str] = {}  # a part of `OUTSIDE` for each id

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self._config.option.skipped:
            ids = set(self._config.cache.get(SKIPPED, []))
            items[:] = [item for item in items if not ids.isdisjoint((item.nodeid, item.nodeid.partition("::")[0]))]
        for item in items:
            lacks = [key for key in sorted(needs(item) - REQUIRED) if not find(key)]
            if lacks:
                self._left_out[item.nodeid] = lacks[0]
        self._config.hook.pytest_deselected(items=[item for item in items if item.nodeid in self._left_out])
        items[:] = [item for item in items if item.nodeid not in self._left_out]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.skipped:
            self._skipped.add(report.nodeid)

    pytest_collectreport = pytest_runtest_logreport

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        self._left_out |= getattr(node, "workeroutput", {}).get("left_out", {})

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        if hasattr(self._config, "workeroutput"):
            self._config.workeroutput["left_out"] = self._left_out
            return
        if hasattr(self._config, "cache"):
            self._config.cache.set(SKIPPED, sorted(self._skipped | self._left_out.keys()))
        if exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED and (self._config.option.skipped or self._left_out):
            session.exitstatus = pytest.ExitCode.OK

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        for key, count in Counter(self._left_out.values()).most_common():
            name, fix, _ = OUTSIDE[key]
            terminalreporter.line(f"LEFT OUT [{count}] {name}: not here ({fix})")
