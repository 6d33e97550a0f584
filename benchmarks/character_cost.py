"""Measurement of what a character costs on this machine, compared with libigl's full-resolution ARAP in the same run.

Everything is measured on one thread, in separate processes (`benchmarks.character_cost_process`), and in rounds, so
that other load on the machine affects all measurements.
"""

import subprocess
import sys
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import igl

from benchmarks.character_cost_process import WARM_UP
from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from engine_bridge.character.character import make_character
from engine_bridge.cli.progress import Reporter
from engine_bridge.inspection import benchmark
from engine_bridge.inspection.benchmark import LOG

TIMED_FRAMES = 10_000
"""Number of frames that are timed individually."""

CONVERTED_FRAMES = 1800
"""Number of frames of the recording that is converted: one minute."""

PROCESSES = 3
"""Number of processes per measurement; the result is their median."""

FIGURES: dict[str, tuple[str, str]] = {
    **{name: of for name, of in benchmark.FIGURES.items() if name != "memory_mb"},
    "precompute_peak_mb": ("MB", "peak memory of a character's first start"),
    "first_load_ms": ("ms", "a character's second start, including the first load of compiled code"),
    "character_mb": ("MB", "memory of a running character, without interpreter and libraries"),
    "peak_mb": ("MB", "peak memory of the conversion"),
    "startup_ms": ("ms", "puppetline --help"),
    "memcpy_ms": ("ms", "for comparison: a copy of all bytes that a frame uses"),
    "constant_ms": ("ms", "for comparison: a constant loop in Python"),
    "constant_p99_ms": ("ms", "… slowest of 100 such loops: noise of the machine"),
}
"""Units and meanings of the measured values by name. A value is None if it cannot be measured."""

RATIOS: dict[str, tuple[str, str, str]] = {
    **benchmark.RATIOS,
    "vertices_to_memcpy": ("vertices_ms", "memcpy_ms", "vertices / copy"),
    "p99_to_solve": ("solve_p99_ms", "solve_ms", "99th percentile / median, controls"),
    "p99_to_frame": ("p99_ms", "frame_ms", "99th percentile / median, frame"),
    "p99_to_constant": ("constant_p99_ms", "constant_ms", "99th percentile / median, a constant loop"),
}
"""Numerators, denominators and meanings of ratios of measured values by name."""

in_process = partial(benchmark.in_process, module="benchmarks.character_cost_process")
"""`benchmark.in_process` for these measurements."""


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
) -> dict[str, Any]:
    """Measure all values for a folder from `prepare`, with `rounds` processes per measurement.

    Returns
    -------
    dict
        As of `benchmark.bench`, for `benchmark.describe`.
    """
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
    figures["convert_fps"] = benchmark.quotient(figures["convert_frames"], figures["convert_s"])
    figures = {name: figures.get(name) for name in FIGURES}
    ratios = benchmark.ratios(figures, RATIOS)
    return {"machine": benchmark.machine(), "character": character, "figures": figures, "ratios": ratios}


def startup_ms() -> float:
    """Return the time that `puppetline --help` takes."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "puppetline", "--help"], stdout=subprocess.DEVNULL, check=True)
    return 1000 * (time.perf_counter() - start)
