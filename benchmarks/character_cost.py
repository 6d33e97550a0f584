"""Measurement of what a character costs on this machine, compared with libigl's full-resolution ARAP in the same run.

Everything is measured on one thread, in separate processes (`benchmarks.character_cost_process`), and in rounds, so
that other load on the machine affects all measurements.
"""

import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

import igl
import numpy as np

from benchmarks.character_cost_process import LOG, WARM_UP
from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from engine_bridge.character.character import make_character
from engine_bridge.cli import benchmark
from engine_bridge.cli.benchmark import CACHE_VARIABLES, THREAD_VARIABLES, number
from engine_bridge.cli.progress import Reporter
from puppetline.errors import PuppetlineError
from puppetline.interrupts import OWN_GROUP

TIMED_FRAMES = 10_000
"""Number of frames that are timed individually."""

CONVERTED_FRAMES = 1800
"""Number of frames of the recording that is converted: one minute."""

PROCESSES = 3
"""Number of processes per measurement; the result is their median."""

ONE_THREAD = dict.fromkeys(THREAD_VARIABLES, "1")
"""Environment variables that limit each library to one thread."""

FIGURES: dict[str, tuple[str, str]] = {
    "solve_ms": ("ms", "a frame, controls only: filter, retarget, 4 iterations"),
    "solve_p99_ms": ("ms", "… slowest of 100 such frames"),
    "vertices_ms": ("ms", "positions and normals of a frame"),
    "frame_ms": ("ms", "a frame, controls and vertices"),
    "p99_ms": ("ms", "… slowest of 100 such frames"),
    "precompute_s": ("s", "a character's first start: welding and the reduced model"),
    "precompute_peak_mb": ("MB", "… peak memory of that process"),
    "cached_load_ms": ("ms", "its second start, from the cache, after imports"),
    "first_load_ms": ("ms", "… including the first load of compiled code"),
    "character_mb": ("MB", "memory of a running character, without interpreter and libraries"),
    "convert_s": ("s", "conversion of a one-minute recording to a .glb"),
    "convert_fps": ("1/s", "… frames per second"),
    "peak_mb": ("MB", "… peak memory of that process"),
    "startup_ms": ("ms", "puppetline --help"),
    "arap_iteration_ms": ("ms", "for comparison: an iteration of libigl's full-resolution ARAP"),
    "memcpy_ms": ("ms", "for comparison: a copy of all bytes that a frame uses"),
    "constant_ms": ("ms", "for comparison: a constant loop in Python"),
    "constant_p99_ms": ("ms", "… slowest of 100 such loops: noise of the machine"),
}
"""Units and meanings of the measured values by name. A value is None if it cannot be measured."""

RATIOS: dict[str, tuple[str, str, str]] = {
    "arap_to_solve": ("arap_iteration_ms", "solve_ms", "ARAP iteration / controls"),
    "arap_to_vertices": ("arap_iteration_ms", "vertices_ms", "ARAP iteration / vertices"),
    "arap_to_frame": ("arap_iteration_ms", "frame_ms", "ARAP iteration / frame"),
    "vertices_to_memcpy": ("vertices_ms", "memcpy_ms", "vertices / copy"),
    "p99_to_solve": ("solve_p99_ms", "solve_ms", "99th percentile / median, controls"),
    "p99_to_frame": ("p99_ms", "frame_ms", "99th percentile / median, frame"),
    "p99_to_constant": ("constant_p99_ms", "constant_ms", "99th percentile / median, a constant loop"),
}
"""Numerators, denominators and meanings of ratios of measured values by name."""


@dataclass(frozen=True)
class Report:
    """Result of all measurements.

    Attributes
    ----------
    machine : dict
        Processor, system and versions.
    character : dict
        Name and size of the character.
    figures : dict of float or None
        Medians, by the names of `FIGURES`.
    ratios : dict of float or None
        By the names of `RATIOS`.
    """

    machine: dict[str, Any]
    character: dict[str, Any]
    figures: dict[str, float | None]
    ratios: dict[str, float | None]


def ratios(figures: dict[str, float | None]) -> dict[str, float | None]:
    """Return ratios by the names of `RATIOS`; None where a value is missing."""
    return {name: _quotient(figures[a], figures[b]) for name, (a, b, _) in RATIOS.items()}


def _quotient(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a / b


def prepare(folder: Path, mesh: Path | None, frames: int) -> dict[str, Any]:
    """Write the files that the measurements need to a folder, and return the character's name and size.

    The puppet file and the recording are those of `puppetline bench`. A tiny character is there to compile everything.

    Raises
    ------
    PuppetlineError
        The mesh cannot be used.
    """
    character = benchmark.prepare(folder, mesh, frames)
    ball, faces = igl.upsample(*igl.icosahedron(), 3)
    make_character("warm up", ball * [1.0, 2.0, 0.7], faces).document.save(folder / "warm_up.glb")
    benchmark.propose((folder / "warm_up.glb").resolve(), folder / WARM_UP)
    return character


def write_log(folder: Path, frames: Iterable[SkeletonFrame]) -> None:
    """Write the recording of a folder; an existing one is replaced."""
    (folder / LOG).unlink(missing_ok=True)  # a recorder would append to it
    with Recorder(folder / LOG) as recorder:
        for frame in frames:
            recorder.write(frame)


def measure(
    folder: Path,
    character: dict[str, Any],
    frames: int,
    rounds: int,
    *,
    progress: Reporter = lambda _stage, _share: None,
) -> Report:
    """Measure all values for a folder from `prepare`, with `rounds` processes per measurement."""
    figures = in_process(folder, "frames", frames)
    results: list[dict[str, float | None]] = []
    for done in range(rounds):
        progress("Measuring", (1 + done) / (1 + rounds))
        results += [in_process(folder, name) for name in ("precompute", "load", "convert")]
        results += [{"startup_ms": startup_ms()} for _ in range(2)]
    for name in {name for result in results for name in result}:
        values = [result[name] for result in results if name in result]
        known = [value for value in values if value is not None]
        figures[name] = median(known) if known else None
    figures["convert_fps"] = _quotient(figures["convert_frames"], figures["convert_s"])
    character = {**character, "handles": figures["handles"], "frames": figures["frames"]}
    figures = {name: figures.get(name) for name in FIGURES}
    return Report(machine(), character, figures, ratios(figures))


def in_process(
    folder: Path, measurement: str, *count: int, module: str = "benchmarks.character_cost_process"
) -> dict[str, Any]:
    """Run a measurement in a separate process with one thread and a cache in the folder, and return its result.

    Raises
    ------
    PuppetlineError
        The error of the other process.
    """
    command = [sys.executable, "-m", module, measurement, str(folder), *map(str, count)]
    done = subprocess.run(
        command,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        env=os.environ | ONE_THREAD | dict.fromkeys(CACHE_VARIABLES, str(folder.resolve() / "cache")),
        **OWN_GROUP,  # Ctrl-C stops only this process, which then stops the other
    )
    result: dict[str, Any] = json.loads(done.stdout)
    if "error" in result:
        raise PuppetlineError(**result["error"])
    return result


def startup_ms() -> float:
    """Return the time that `puppetline --help` takes."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "puppetline", "--help"], stdout=subprocess.DEVNULL, check=True)
    return 1000 * (time.perf_counter() - start)


def machine() -> dict[str, Any]:
    """Describe this machine and the versions of the libraries that affect speed."""
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("puppetline", "numpy", "scipy", "numba", "libigl")},
        "blas": f"{blas['name']} {blas['version']}",
        "threads": 1,
    }


def _processor() -> str:
    if sys.platform == "linux":
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        if named:
            return named[0]
    if sys.platform == "darwin":
        command = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    return platform.processor() or platform.machine()


def describe(report: Report) -> str:
    """Return a report as text: the character and the machine, then one value per line, then ratios."""
    character, system = report.character, report.machine
    figures = [(name, report.figures[name], *of) for name, of in FIGURES.items()]
    ratios = [(name, report.ratios[name], "×", meaning) for name, (_, _, meaning) in RATIOS.items()]
    heading = [
        f"{character['name']}: {character['vertices']:,} vertices, {character['triangles']:,} triangles, "
        f"{character['handles']} handles; medians, {character['frames']:,} frames",
        f"{system['processor']}, {system['cores']} cores, of which one is used; {system['system']}; "
        f"Python {system['python']}, NumPy {system['numpy']} ({system['blas']}), Numba {system['numba']}, "
        f"libigl {system['libigl']}",
        "",
    ]
    values = [f"{name:20}{number(value):>8} {unit:4} {meaning}" for name, value, unit, meaning in figures + ratios]
    return "\n".join(heading + values)
