"""Times the frames of a character, in turn with libigl's full-resolution ARAP."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import igl
import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.character.materials import drawn_normals
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import load_timeline, reference_pose
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.settings import Settings
from solver.model.binding import ShadedBinding
from solver.model.reduced_model import Controls
from solver.motion.deformer import to_file_units
from solver.surface.mesh import SolverMesh, snap

BLOCK_FRAMES = 250
"""Number of frames that are timed in a row before the next measurement takes its turn."""

VERTEX_FRAMES = 25
"""Number of frames whose vertices are timed in a row."""

ARAP_TARGETS = 60
"""Number of frames that ARAP is moved through."""

MAX_INTERLEAVED_SECONDS = 30.0
"""Time after which no further round of blocks begins, in seconds."""


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
    prepared : PreparedCharacter
    log : Path
    """

    def __init__(self, prepared: PreparedCharacter, log: Path) -> None:
        self.prepared = prepared
        settings = Settings()
        timeline, _ = load_timeline(log, settings)
        self.positions, self._confidence = timeline.positions, timeline.confidence
        self._controls = np.empty((len(prepared.model.rest_controls) // 4, 3, 4), dtype=np.float32)
        self.motion = CharacterMotion(prepared, reference_pose(prepared.puppet, timeline, settings))
        it = prepared.character
        self.binding = ShadedBinding(
            prepared.model, it.vertices, prepared.mesh.of_render, drawn_normals(it), it.triangles
        )
        self._drawn = np.empty_like(self.binding.rest), np.empty_like(self.binding.rest)
        self._next = 0

    def frame(self) -> SkeletonFrame:
        """Return the performer's next frame."""
        number, self._next = self._next, self._next + 1
        at = number % len(self.positions)
        return SkeletonFrame(number / 30, 0, self.positions[at], self._confidence[at])

    def controls(self) -> Controls:
        """Smooth, retarget and solve the next frame; all calls return the same array."""
        return to_file_units(self.motion.step(self.frame()).R, self.prepared.model, self._controls)

    def vertices(self, controls: Controls) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return positions and normals (n, 3); all calls return the same two arrays."""
        return self.binding.vertices_and_normals(controls, *self._drawn)

    def handle_path(self, count: int) -> NDArray[np.float64]:
        """Return the positions of the handles (count, h, 3) in the next frames."""
        model = self.prepared.model
        rows = model.rows(self.prepared.mesh, self.motion.deformer.handles)
        path = [rows @ self.motion.step(self.frame()).R for _ in range(count)]
        return np.array(path) * model.diagonal + model.center


def frame_works(prepared: PreparedCharacter, log: Path) -> dict[str, Work]:
    """Return the steps of a frame, and an ARAP iteration unless libigl cannot factorise the surface."""
    solved, played = Playing(prepared, log), Playing(prepared, log)
    controls = [played.controls().copy() for _ in range(VERTEX_FRAMES)]
    works = {
        "solve": Work(lambda _: solved.controls(), BLOCK_FRAMES),
        "vertices": Work(lambda number: played.vertices(controls[number]), VERTEX_FRAMES),
        "frame": Work(lambda _: played.vertices(played.controls()), BLOCK_FRAMES),
    }
    try:
        iterate = arap_iteration(prepared.mesh, played.motion.deformer.handles, played.handle_path(ARAP_TARGETS))
    except RuntimeError:
        return works
    return works | {"arap_iteration": Work(iterate, 1)}


def frame_times(works: Mapping[str, Work], frames: int) -> dict[str, float]:
    """Return the medians and the 99th percentiles of the times of works, in milliseconds."""
    times = interleaved(works, math.ceil(frames / BLOCK_FRAMES))
    return {
        **{f"{name}_ms": float(np.median(taken)) for name, taken in times.items()},
        **{f"{name}_p99_ms": float(np.percentile(taken, 99)) for name, taken in times.items()},
        "p99_ms": float(np.percentile(times["frame"], 99)),
    }


def arap_iteration(
    mesh: SolverMesh, handles: NDArray[np.float64], targets: NDArray[np.float64]
) -> Callable[[int], None]:
    """Prepare one iteration of libigl's full-resolution ARAP, with handles at the nearest vertices.

    Parameters
    ----------
    mesh : SolverMesh
    handles : (h, 3) float64
    targets : (T, h, 3) float64
        Positions of the handles in T frames, one for each iteration in turn.

    Returns
    -------
    callable
        Iterates once.

    Raises
    ------
    RuntimeError
        libigl cannot factorise the surface.
    """
    corners, blend = snap(mesh, handles)
    fixed, first = np.unique(corners[np.arange(len(corners)), blend.argmax(axis=1)], return_index=True)
    data = igl.ARAPData()
    data.max_iter = 1
    igl.arap_precomputation(mesh.vertices, mesh.faces, 3, fixed.astype(np.int32), data)
    positions, wanted = mesh.vertices, cycle(targets[:, first])

    def iterate(_: int) -> None:
        nonlocal positions
        positions = igl.arap_solve(next(wanted), data, positions)

    return iterate
