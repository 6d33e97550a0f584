"""Measurement of what a character costs on this machine, compared with libigl's full-resolution ARAP in the same run.

Everything is measured in one process with one thread, and iterations of ARAP between frames, so that other load on the
machine affects both. `benchmarks.performance` measures more, in several processes.
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import igl
import numpy as np
import psutil
from numpy.typing import NDArray

from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from capture.sources.demo import performances
from engine_bridge.character.character import load_character, make_character
from engine_bridge.character.examples import example_character
from engine_bridge.character.materials import drawn_normals
from engine_bridge.export.convert import convert
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import load_timeline, reference_pose
from engine_bridge.performance.rig import Rig, load_rig
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet
from puppetline.errors import PuppetlineError
from puppetline.interrupts import OWN_GROUP
from solver.model.binding import ShadedBinding
from solver.model.reduced_model import build
from solver.motion.deformer import to_file_units
from solver.surface.mesh import SolverMesh, snap

CHARACTER, LOG = "character.toml", "performance.log"
"""Names of the puppet file and the recording that are measured."""

EXAMPLE_CHARACTER, EXAMPLE_VERTICES = "biped", 43_243
"""The character that is measured by default, and its number of vertices, which is that of the Armadillo mesh."""

TIMED_FRAMES, CONVERTED_FRAMES, WARM_UP_FRAMES = 5000, 1800, 50
"""Numbers of frames that are timed, that are converted, and that are played before."""

ARAP_FRAMES = 50
"""Number of frames from one iteration of ARAP to the next."""

THREAD_VARIABLES = (
    *("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
    *("NUMBA_NUM_THREADS", "IGL_NUM_THREADS"),
)
"""Environment variables that limit each library to a number of threads."""

CACHE_VARIABLES = "XDG_CACHE_HOME", "WIN_PD_OVERRIDE_LOCAL_APPDATA"
"""Environment variables of platformdirs, on Linux and on Windows, that determine the folder of the cache."""

FIGURES = {
    "solve_ms": ("ms", "a frame, controls only: filter, retarget, 4 iterations"),
    "solve_p99_ms": ("ms", "… slowest of 100 such frames"),
    "vertices_ms": ("ms", "positions and normals of a frame"),
    "frame_ms": ("ms", "a frame, controls and vertices"),
    "p99_ms": ("ms", "… slowest of 100 such frames"),
    "precompute_s": ("s", "a character's first start: welding and the reduced model"),
    "cached_load_ms": ("ms", "its second start, from the cache"),
    "convert_s": ("s", "conversion of a one-minute recording to a .glb"),
    "convert_fps": ("1/s", "… frames per second"),
    "memory_mb": ("MB", "memory of the process after all this"),
    "arap_iteration_ms": ("ms", "for comparison: an iteration of libigl's full-resolution ARAP"),
}
"""Units and meanings of the measured values by name; that of ARAP is None where libigl cannot factorise a surface."""

RATIOS = {
    "arap_to_solve": ("solve_ms", "ARAP iteration / controls"),
    "arap_to_vertices": ("vertices_ms", "ARAP iteration / vertices"),
    "arap_to_frame": ("frame_ms", "ARAP iteration / frame"),
}
"""Denominators and meanings of ratios of the time of an iteration of ARAP."""


def bench(
    mesh: Path | None = None, *, progress: Callable[[str, float], None] = lambda _step, _share: None
) -> dict[str, Any]:
    """Measure a character in a process of its own.

    Parameters
    ----------
    mesh : Path, optional
        Any character file; by default an example with `EXAMPLE_VERTICES` vertices.
    progress : callable, optional

    Returns
    -------
    dict
        "machine", "character", "figures" by the names of `FIGURES`, and "ratios" by those of `RATIOS`.

    Raises
    ------
    PuppetlineError
        The mesh cannot be used.
    """
    with tempfile.TemporaryDirectory() as folder:
        progress("Preparing", 0.0)
        character = prepare(Path(folder), mesh, CONVERTED_FRAMES)
        progress("Measuring", 0.2)
        own = dict.fromkeys(THREAD_VARIABLES, "1") | dict.fromkeys(CACHE_VARIABLES, folder)
        command = [sys.executable, "-m", __name__, folder, str(TIMED_FRAMES)]
        # Ctrl-C stops only this process, which then stops the other
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True, env=os.environ | own, **OWN_GROUP)  # noqa: S603
        found = json.loads(done.stdout)
    if "error" in found:
        raise PuppetlineError(**found["error"])
    iteration = found["arap_iteration_ms"]
    ratios = {name: iteration and iteration / found[of] for name, (of, _) in RATIOS.items()}
    return {"machine": machine(), "character": character, "figures": found, "ratios": ratios}


def prepare(folder: Path, mesh: Path | None, frames: int) -> dict[str, Any]:
    """Write a puppet file and a recording of `frames` frames to a folder; return the character's name and size.

    The handles and the joints that move them are those that `puppetline new` proposes.

    Raises
    ------
    PuppetlineError
        The mesh cannot be used.
    """
    if mesh is None:
        mesh = folder / f"{EXAMPLE_CHARACTER}.glb"
        made = example_character(EXAMPLE_CHARACTER)
        v, f, *_ = igl.decimate(made.vertices, made.faces, 2 * EXAMPLE_VERTICES - 4)
        make_character(EXAMPLE_CHARACTER, v, f).document.save(mesh)
    character = load_character(mesh)
    propose(mesh.resolve(), folder / CHARACTER)
    with Recorder(folder / LOG) as recorder:
        for frame in islice(performance(), frames):
            recorder.write(frame)
    return {"name": mesh.name, "vertices": len(character.vertices), "triangles": len(character.triangles)}


def propose(mesh: Path, output: Path) -> None:
    """Write a puppet file with handles for a mesh."""
    proposed = new_puppet(mesh, mesh.with_suffix(output.suffix), limbs=False).puppet
    table = proposed.character.model_copy(update={"mesh": str(mesh)})
    puppet_file.dump(proposed.model_copy(update={"character": table}), output)


def performance() -> Iterator[SkeletonFrame]:
    """Return the frames of all example performances in an endless loop, 30 per second."""
    clips = cycle([make() for make in performances().values()])
    poses = ((place, known) for clip in clips for place, known in zip(clip.positions, clip.confidence, strict=True))
    for number, (positions, confidence) in enumerate(poses):
        yield SkeletonFrame(number / 30, 1, positions, confidence)


def arap_iteration(
    mesh: SolverMesh, handles: NDArray[np.float64], targets: NDArray[np.float64]
) -> Callable[[int], None]:
    """Prepare one iteration of libigl's full-resolution ARAP, with handles at the nearest vertices.

    Parameters
    ----------
    mesh : SolverMesh
    handles : (h, 3) float64
    targets : (T, h, 3) float64
        Positions of the handles in T frames.

    Returns
    -------
    callable
        Iterates once, towards the targets of the frame with the given number.
    """
    corners, blend = snap(mesh, handles)
    fixed, first = np.unique(corners[np.arange(len(corners)), blend.argmax(axis=1)], return_index=True)
    data = igl.ARAPData()
    data.max_iter = 1
    igl.arap_precomputation(mesh.vertices, mesh.faces, 3, fixed.astype(np.int32), data)
    state = [mesh.vertices]

    def iterate(number: int) -> None:
        state[0] = igl.arap_solve(targets[number % len(targets)][first], data, state[0])

    return iterate


def measure(folder: Path, frames: int) -> dict[str, float | None]:
    """Return the values of `FIGURES` for the character in a folder from `prepare`."""
    clock, found = time.perf_counter, dict[str, float | None]()
    rig = load_rig(folder / CHARACTER)  # compiles and caches
    start = clock()
    load_rig(folder / CHARACTER)
    loaded = clock()
    build(rig.character.solver_mesh(), rig.puppet.solver.parameters)
    found |= {"cached_load_ms": 1000 * (loaded - start), "precompute_s": clock() - loaded}

    solve, vertices, arap = time_frames(rig, folder / LOG, frames)
    start = clock()
    _, summary = convert(folder / LOG, folder / CHARACTER, folder / "converted.glb", Settings())
    seconds = clock() - start
    found |= {"convert_s": seconds, "convert_fps": summary.frames / seconds}
    found["memory_mb"] = psutil.Process().memory_info().rss / 1e6
    found["arap_iteration_ms"] = float(np.median(arap)) if len(arap) else None
    for name, values in {"solve": solve, "vertices": vertices, "frame": solve + vertices}.items():
        found[f"{name}_ms"] = float(np.median(values))
    found["solve_p99_ms"], found["p99_ms"] = (float(np.percentile(each, 99)) for each in (solve, solve + vertices))
    return {name: found[name] for name in FIGURES}


def time_frames(
    rig: Rig, log: Path, frames: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Play a recording in a loop, and iterate ARAP in between.

    Returns
    -------
    solve, vertices : (frames,) float64
        Milliseconds of each frame.
    arap : (k,) float64
        Milliseconds of each iteration; none where libigl cannot factorise the surface.
    """
    clock, settings, character = time.perf_counter, Settings(), rig.character
    timeline, _ = load_timeline(log, settings)
    playing = CharacterMotion(rig, reference_pose(rig.puppet, timeline, settings))
    rows = rig.model.rows(rig.mesh, playing.deformer.handles)
    targets = [rows @ playing.step(timeline.frame(number)).R for number in range(WARM_UP_FRAMES)]
    try:
        path = np.array(targets) * rig.model.diagonal + rig.model.center
        iterate = arap_iteration(rig.mesh, playing.deformer.handles, path)
    except RuntimeError:  # libigl cannot factorise every surface
        iterate = None
    binding = ShadedBinding(
        rig.model, character.vertices, rig.mesh.of_render, drawn_normals(character), character.triangles
    )
    times, arap = np.empty((frames, 3)), []
    binding.vertices_and_normals(to_file_units(rig.model.rest_controls, rig.model))  # compiles
    for number in range(frames):
        at = number % len(timeline.positions)
        time_of_frame = (WARM_UP_FRAMES + number) / timeline.fps
        frame = SkeletonFrame(time_of_frame, 0, timeline.positions[at], timeline.confidence[at])
        start = clock()
        controls = to_file_units(playing.step(frame).R, rig.model)
        solved = clock()
        binding.vertices_and_normals(controls)
        times[number] = start, solved, clock()
        if iterate is not None and number % ARAP_FRAMES == 0:
            start = clock()
            iterate(number)
            arap.append(clock() - start)
    solve, vertices = 1000 * np.diff(times, axis=1).T
    return solve, vertices, 1000 * np.array(arap)


def machine() -> dict[str, Any]:
    """Describe this machine and the versions of the libraries that affect speed."""
    return {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("puppetline", "numpy", "scipy", "numba", "libigl")},
        "threads": 1,
    }


def describe(report: dict[str, Any]) -> str:
    """Return a report as text: the character and the machine, then one value per line."""
    character, system = report["character"], report["machine"]
    heading = [
        f"{character['name']}: {character['vertices']:,} vertices, {character['triangles']:,} triangles",
        f"{system['processor']}, {system['cores']} cores, of which one is used; {system['system']}; "
        f"Python {system['python']}, NumPy {system['numpy']}, Numba {system['numba']}, libigl {system['libigl']}",
        "",
    ]
    values = [(name, report["figures"][name], *of) for name, of in FIGURES.items()]
    values += [(name, report["ratios"][name], "×", meaning) for name, (_, meaning) in RATIOS.items()]
    return "\n".join(
        heading + [f"{name:20}{number(value):>8} {unit:4} {meaning}" for name, value, unit, meaning in values]
    )


def number(value: float | None) -> str:
    """Return a value with three significant digits, or a dash if it cannot be measured here."""
    if value is None:
        return "–"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:#.3g}".rstrip(".")


def main() -> None:
    """Print the values of a folder, or the error, as JSON."""
    try:
        found: dict[str, Any] = measure(Path(sys.argv[1]), int(sys.argv[2]))
    except PuppetlineError as error:
        found = {"error": error.parts}
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
