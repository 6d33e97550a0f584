"""The measurements of `benchmarks.character_cost`, each in a separate process that prints its result as JSON.

``python -m benchmarks.character_cost_process MEASUREMENT FOLDER [COUNT]``
"""

import gc
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from engine_bridge.character.character import load_character
from engine_bridge.export.convert import convert
from engine_bridge.inspection.benchmark import CHARACTER, LOG, main
from engine_bridge.inspection.character_cost import BLOCK_FRAMES, VERTEX_FRAMES, Playing, Work, frame_times, frame_works
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import puppet_file
from puppetline.memory import trim_memory
from solver.model.reduced_model import build

WARM_UP = "warm_up.toml"
"""Name of the puppet file of a tiny mesh, used first to load and compile everything."""

CONSTANT_LOOP_LENGTH = 5000
"""Number of integers to add in a loop of constant work; variations of its time are noise of the machine."""

FRAMES_BEFORE_MEMORY = 300
"""Number of frames that a character plays before its memory is measured."""


def frames(folder: Path, count: int) -> dict[str, float]:
    """Return times of frames, of a copy of all bytes that a frame uses, and of a loop of constant work, by turns."""
    prepared = load_prepared(folder / CHARACTER)
    touched = np.zeros(
        len(prepared.mesh.of_render) * 4 * (6 + prepared.model.isoline_coordinates.shape[1] + 6), dtype=np.uint8
    )
    copied = np.empty_like(touched)
    works = frame_works(prepared, folder / LOG) | {
        "memcpy": Work(lambda _: np.copyto(copied, touched), VERTEX_FRAMES),
        "constant": Work(lambda _: sum(range(CONSTANT_LOOP_LENGTH)), BLOCK_FRAMES),
    }
    return frame_times(works, count)


def precompute(folder: Path) -> dict[str, float | None]:
    """Time welding and the reduced model, without a cache."""
    warm_up(folder)
    puppet = puppet_file.load(folder / CHARACTER)
    character = load_character(folder / puppet.character.mesh)
    start = time.perf_counter()
    build(character.solver_mesh(), puppet.solver.parameters)
    return {"precompute_s": time.perf_counter() - start, "precompute_peak_mb": peak_mb()}


def load(folder: Path) -> dict[str, float | None]:
    """Time loading a character from the cache, and measure its memory while it plays."""
    warm_up(folder)
    before = resident_mb()
    clock = time.perf_counter
    start = clock()
    prepared = load_prepared(folder / CHARACTER)
    first = clock() - start
    playing = Playing(prepared, folder / LOG)
    for _ in range(FRAMES_BEFORE_MEMORY):
        playing.vertices(playing.controls())
    after = resident_mb()
    start = clock()
    load_prepared(folder / CHARACTER)
    return {"first_load_ms": 1000 * first, "cached_load_ms": 1000 * (clock() - start), "character_mb": after - before}


def converting(folder: Path) -> dict[str, float | None]:
    """Time a conversion to a .glb, and measure the peak memory of the process."""
    start = time.perf_counter()
    _, summary = convert(folder / LOG, folder / CHARACTER, folder / "converted.glb", Settings())
    seconds = time.perf_counter() - start
    return {"convert_s": seconds, "convert_frames": summary.frames, "peak_mb": peak_mb()}


def warm_up(folder: Path) -> None:
    """Load and compile everything, with a tiny character."""
    playing = Playing(load_prepared(folder / WARM_UP), folder / LOG)
    build(playing.prepared.mesh, playing.prepared.puppet.solver.parameters)
    for _ in range(10):
        playing.vertices(playing.controls())


def resident_mb() -> float:
    """Return the memory of this process without freed pages, in megabytes."""
    gc.collect()
    trim_memory()
    return psutil.Process().memory_info().rss / 1e6


def peak_mb() -> float | None:
    """Return the peak memory of this process, in megabytes; None where neither Linux nor macOS reports it."""
    if sys.platform == "darwin":
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    if sys.platform == "linux":  # not ru_maxrss, which starts from the value of the parent process
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        return next(int(line.split()[1]) * 1.024e-3 for line in status.splitlines() if line.startswith("VmHWM:"))
    return None


MEASUREMENTS: dict[str, Callable[..., dict[str, Any]]] = {
    "frames": frames,
    "precompute": precompute,
    "load": load,
    "convert": converting,
}


if __name__ == "__main__":
    main(MEASUREMENTS)
