"""The measurements of `benchmarks.character_cost`, each in a separate process that prints its result as JSON.

``python -m benchmarks.character_cost_process MEASUREMENT FOLDER [COUNT]``
"""

import gc
import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.character.character import load_character
from engine_bridge.character.materials import drawn_normals
from engine_bridge.cli.benchmark import arap_iteration
from engine_bridge.export.convert import convert
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import load_timeline, reference_pose
from engine_bridge.performance.rig import Rig, load_rig
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import puppet_file
from puppetline.errors import PuppetlineError
from puppetline.memory import trim_memory
from solver.model.binding import ShadedBinding
from solver.model.reduced_model import Controls, build
from solver.motion.deformer import to_file_units

CHARACTER, WARM_UP = "character.toml", "warm_up.toml"
"""Names of puppet files: the one to measure, and one of a tiny mesh, used first to load and compile everything."""

LOG = "performance.log"
"""Name of the recording."""

BLOCK_FRAMES = 250
"""Number of frames that are timed in a row before the next measurement takes its turn."""

CONSTANT_LOOP_LENGTH = 5000
"""Number of integers to add in a loop of constant work; variations of its time are noise of the machine."""

MAX_INTERLEAVED_SECONDS = 30.0
"""Time after which no further round of blocks begins, in seconds."""

FRAMES_BEFORE_MEMORY = 300
"""Number of frames that a character plays before its memory is measured."""


@dataclass(frozen=True)
class Work:
    """A function to time: each round calls `call(0)`, `call(1)`, … `call(block - 1)`."""

    call: Callable[[int], object]
    block: int


def interleaved(works: Mapping[str, Work], rounds: int) -> dict[str, NDArray[np.float64]]:
    """Time several functions in turn, so that other load on the machine affects all of them.

    Returns
    -------
    dict of (calls,) float64
        Milliseconds of each call. Rounds that would begin after `MAX_INTERLEAVED_SECONDS` are omitted.
    """
    times: dict[str, list[NDArray[np.float64]]] = {name: [] for name in works}
    clock = time.perf_counter
    begun = clock()
    for number in range(-1, rounds):
        if number > 0 and clock() - begun > MAX_INTERLEAVED_SECONDS:
            break
        for name, work in works.items():
            block = work.block if number >= 0 else min(work.block, 10)  # round −1 warms up
            ends = np.empty(block + 1)
            ends[0] = clock()
            for i in range(block):
                work.call(i)
                ends[i + 1] = clock()
            if number >= 0:
                times[name].append(1000 * np.diff(ends))
    return {name: np.concatenate(blocks) for name, blocks in times.items()}


class Playing:
    """A character that plays a recording in a loop.

    Parameters
    ----------
    rig : Rig
    log : Path
    """

    def __init__(self, rig: Rig, log: Path) -> None:
        self.rig = rig
        settings = Settings()
        timeline, _ = load_timeline(log, settings)
        self.positions, self._confidence = timeline.positions, timeline.confidence
        self._controls = np.empty((len(rig.model.rest_controls) // 4, 3, 4), dtype=np.float32)
        self.motion = CharacterMotion(rig, reference_pose(rig.puppet, timeline, settings))
        it = rig.character
        self.binding = ShadedBinding(rig.model, it.vertices, rig.mesh.of_render, drawn_normals(it), it.triangles)
        self._drawn = np.empty_like(self.binding.rest), np.empty_like(self.binding.rest)
        self._next = 0

    def frame(self) -> SkeletonFrame:
        """Return the performer's next frame."""
        number, self._next = self._next, self._next + 1
        at = number % len(self.positions)
        return SkeletonFrame(number / 30, 0, self.positions[at], self._confidence[at])

    def controls(self) -> Controls:
        """Smooth, retarget and solve the next frame; all calls return the same array."""
        return to_file_units(self.motion.step(self.frame()).R, self.rig.model, self._controls)

    def vertices(self, controls: Controls) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return positions and normals (n, 3); all calls return the same two arrays."""
        return self.binding.vertices_and_normals(controls, *self._drawn)


def handle_path(playing: Playing, count: int) -> NDArray[np.float64]:
    """Return the positions of the handles (count, h, 3) in the next frames."""
    model, handles = playing.rig.model, playing.motion.deformer.handles
    rows = model.rows(playing.rig.mesh, handles)
    path = [rows @ playing.motion.step(playing.frame()).R for _ in range(count)]
    return np.array(path) * model.diagonal + model.center


def works(folder: Path) -> tuple[Playing, dict[str, Work]]:
    """Return the steps of a frame, and for comparison an ARAP iteration and a copy of all bytes that a frame uses."""
    rig = load_rig(folder / CHARACTER)
    solved, played = Playing(rig, folder / LOG), Playing(rig, folder / LOG)
    count = len(rig.mesh.of_render)
    controls = [played.controls().copy() for _ in range(25)]
    touched = np.zeros(count * 4 * (6 + rig.model.isoline_coordinates.shape[1] + 6), dtype=np.uint8)
    copied = np.empty_like(touched)
    made = {
        "solve": Work(lambda _: solved.controls(), BLOCK_FRAMES),
        "vertices": Work(lambda number: played.vertices(controls[number]), len(controls)),
        "frame": Work(lambda _: played.vertices(played.controls()), BLOCK_FRAMES),
        "memcpy": Work(lambda _: np.copyto(copied, touched), 25),
        "constant": Work(lambda _: sum(range(CONSTANT_LOOP_LENGTH)), BLOCK_FRAMES),
    }
    try:
        handles = played.motion.deformer.handles
        made["arap_iteration"] = Work(arap_iteration(rig.mesh, handles, handle_path(played, 60)), 1)
    except RuntimeError:  # libigl cannot factorise every surface
        pass
    return played, made


def frames(folder: Path, count: int) -> dict[str, float]:
    """Return medians and 99th percentiles of the times of frames, in milliseconds."""
    played, todo = works(folder)
    times = interleaved(todo, math.ceil(count / BLOCK_FRAMES))
    return {
        **{f"{name}_ms": float(np.median(taken)) for name, taken in times.items()},
        "p99_ms": float(np.percentile(times["frame"], 99)),
        "solve_p99_ms": float(np.percentile(times["solve"], 99)),
        "constant_p99_ms": float(np.percentile(times["constant"], 99)),
        "frames": len(times["frame"]),
        "handles": len(played.motion.deformer.handles),
    }


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
    rig = load_rig(folder / CHARACTER)
    first = clock() - start
    playing = Playing(rig, folder / LOG)
    for _ in range(FRAMES_BEFORE_MEMORY):
        playing.vertices(playing.controls())
    after = resident_mb()
    start = clock()
    load_rig(folder / CHARACTER)
    return {"first_load_ms": 1000 * first, "cached_load_ms": 1000 * (clock() - start), "character_mb": after - before}


def converting(folder: Path) -> dict[str, float | None]:
    """Time a conversion to a .glb, and measure the peak memory of the process."""
    start = time.perf_counter()
    _, summary = convert(folder / LOG, folder / CHARACTER, folder / "converted.glb", Settings())
    seconds = time.perf_counter() - start
    return {"convert_s": seconds, "convert_frames": summary.frames, "peak_mb": peak_mb()}


def warm_up(folder: Path) -> None:
    """Load and compile everything, with a tiny character."""
    playing = Playing(load_rig(folder / WARM_UP), folder / LOG)
    build(playing.rig.mesh, playing.rig.puppet.solver.parameters)
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


def main(measurements: Mapping[str, Callable[..., dict[str, Any]]]) -> None:
    """Run the measurement that the command line names, and print its result."""
    name, folder, *count = sys.argv[1:]
    try:
        result = measurements[name](Path(folder), *map(int, count))
    except PuppetlineError as error:
        result = {"error": error.parts}
    sys.stdout.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main(MEASUREMENTS)
