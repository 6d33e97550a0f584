"""Measurement of what a character costs on this machine, compared with libigl's full-resolution ARAP in the same run.

Everything is measured in a process with one thread, by turns, so that other load on the machine affects all of it.
`benchmarks.performance` measures more, in several processes.
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import igl
import numpy as np
import psutil

from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from capture.sources.demo import performances
from engine_bridge.character.character import load_character, make_character
from engine_bridge.character.examples import example_character
from engine_bridge.export.convert import convert
from engine_bridge.inspection.character_cost import frame_times, frame_works
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet
from puppetline.errors import PuppetlineError
from puppetline.interrupts import OWN_GROUP
from solver.model.reduced_model import build

CHARACTER, LOG = "character.toml", "performance.log"
"""Names of the puppet file and the recording that are measured."""

EXAMPLE_CHARACTER, EXAMPLE_VERTICES = "biped", 43_243
"""The character that is measured by default, and its number of vertices, which is that of the Armadillo mesh."""

TIMED_FRAMES, CONVERTED_FRAMES = 5000, 1800
"""Numbers of frames that are timed, and that are converted: one minute."""

ONE_THREAD = dict.fromkeys(
    (
        *("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
        *("NUMBA_NUM_THREADS", "IGL_NUM_THREADS"),
    ),
    "1",
)
"""Environment variables that limit each library to one thread."""

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
    "arap_to_solve": ("arap_iteration_ms", "solve_ms", "ARAP iteration / controls"),
    "arap_to_vertices": ("arap_iteration_ms", "vertices_ms", "ARAP iteration / vertices"),
    "arap_to_frame": ("arap_iteration_ms", "frame_ms", "ARAP iteration / frame"),
}
"""Numerators, denominators and meanings of ratios of measured values by name."""

Value = float | None
"""A measured value; None if it cannot be measured."""


def ratios(figures: Mapping[str, Value], of: Mapping[str, tuple[str, str, str]] = RATIOS) -> dict[str, Value]:
    """Return ratios of measured values by name; None where a value is missing."""
    return {name: quotient(figures[a], figures[b]) for name, (a, b, _) in of.items()}


def quotient(a: Value, b: Value) -> Value:
    """Return a quotient; None where a value is missing."""
    return None if a is None or b is None else a / b


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
        figures = in_process(Path(folder), "bench", TIMED_FRAMES)
    return {"machine": machine(), "character": character, "figures": figures, "ratios": ratios(figures)}


def in_process(folder: Path, measurement: str, *count: int, module: str = __name__) -> dict[str, Any]:
    """Run a measurement in a separate process with one thread and a cache in the folder, and return its result.

    Parameters
    ----------
    folder : Path
        From `prepare`.
    measurement : str
        Name of a measurement that the module gives `main`.
    count : int
        Its further arguments.
    module : str, optional

    Raises
    ------
    PuppetlineError
        The error of the other process.
    """
    own = ONE_THREAD | dict.fromkeys(CACHE_VARIABLES, str(folder.resolve() / "cache"))
    command = [sys.executable, "-m", module, measurement, str(folder), *map(str, count)]
    # Ctrl-C stops only this process, which then stops the other
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, env=os.environ | own, **OWN_GROUP)  # noqa: S603
    found: dict[str, Any] = json.loads(done.stdout)
    if "error" in found:
        raise PuppetlineError(**found["error"])
    return found


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


def measure(folder: Path, frames: int) -> dict[str, Value]:
    """Return the values of `FIGURES` for the character in a folder from `prepare`."""
    clock = time.perf_counter
    prepared = load_prepared(folder / CHARACTER)  # compiles and caches
    start = clock()
    load_prepared(folder / CHARACTER)
    loaded = clock()
    build(prepared.character.solver_mesh(), prepared.puppet.solver.parameters)
    built = clock()
    found: dict[str, Value] = {"cached_load_ms": 1000 * (loaded - start), "precompute_s": built - loaded}
    found |= frame_times(frame_works(prepared, folder / LOG), frames)
    start = clock()
    _, summary = convert(folder / LOG, folder / CHARACTER, folder / "converted.glb", Settings())
    seconds = clock() - start
    found |= {"convert_s": seconds, "convert_fps": summary.frames / seconds}
    found["memory_mb"] = psutil.Process().memory_info().rss / 1e6
    return {name: found.get(name) for name in FIGURES}


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
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603
    return platform.processor() or platform.machine()


def describe(
    report: Mapping[str, Any],
    figures: Mapping[str, tuple[str, str]] = FIGURES,
    ratios: Mapping[str, tuple[str, str, str]] = RATIOS,
) -> str:
    """Return a report as text: the character and the machine, then one value per line."""
    character, system = report["character"], report["machine"]
    heading = [
        f"{character['name']}: {character['vertices']:,} vertices, {character['triangles']:,} triangles",
        f"{system['processor']}, {system['cores']} cores, of which one is used; {system['system']}; "
        f"Python {system['python']}, NumPy {system['numpy']} ({system['blas']}), Numba {system['numba']}, "
        f"libigl {system['libigl']}",
        "",
    ]
    values = [(name, report["figures"][name], *of) for name, of in figures.items()]
    values += [(name, report["ratios"][name], "×", meaning) for name, (_, _, meaning) in ratios.items()]
    return "\n".join(
        heading + [f"{name:20}{number(value):>8} {unit:4} {meaning}" for name, value, unit, meaning in values]
    )


def number(value: float | None) -> str:
    """Return a value with three significant digits, or a dash if it cannot be measured here."""
    if value is None:
        return "–"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:#.3g}".rstrip(".")


def main(measurements: Mapping[str, Callable[..., Mapping[str, Any]]]) -> None:
    """Run the measurement that the command line names, and print its result or its error as JSON."""
    name, folder, *count = sys.argv[1:]
    try:
        found = measurements[name](Path(folder), *map(int, count))
    except PuppetlineError as error:
        found = {"error": error.parts}
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main({"bench": measure})
