"""The measurements of `benchmarks.performance`, each in a separate process as in `benchmarks.character_cost`."""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import igl
import numpy as np
from numpy.typing import NDArray

from benchmarks import character_cost_process
from benchmarks.avx2 import Avx2Blend, MissingError
from engine_bridge.character.character import load_character
from engine_bridge.inspection.benchmark import CHARACTER, LOG, main
from engine_bridge.inspection.character_cost import Playing, Work, arap_iteration, interleaved
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import SolverTable
from solver.model import coarse_fields, reduced_model
from solver.model.binding import Binding
from solver.model.reduced_model import build
from solver.motion.deformer import Deformer, to_file_units
from solver.motion.limbs import bones_of
from solver.surface.mesh import weld

MODULE = "benchmarks.processes"
"""Module that `benchmarks.character_cost.in_process` starts."""

MAX_ARAP_VERTICES = 260_000
"""Number of vertices of the largest mesh that is measured with full-resolution ARAP."""

ITERATIONS = (1, 2, 4, 8, 16)

CONVERGED_ITERATIONS = 60
"""Iterations per frame after which vertices no longer move."""

SAMPLED_VERTICES = 4000
"""Number of vertices, spread over the mesh, at which the error is measured."""


def yardstick(folder: Path) -> dict[str, Any]:
    """Time positions and normals in turn with the loop in C, after a check that both agree."""
    playing = Playing(load_prepared(folder / CHARACTER), folder / LOG)
    try:
        avx2 = Avx2Blend(folder, playing.prepared.model, playing.binding)
    except MissingError as reason:
        return {"missing": str(reason)}
    controls = [playing.controls().copy() for _ in range(60)]
    positions, normals = playing.vertices(controls[-1])
    avx2(controls[-1])
    np.testing.assert_allclose(avx2.positions, positions, rtol=0, atol=1e-5 * playing.prepared.mesh.diagonal)
    np.testing.assert_allclose(avx2.normals, normals, rtol=0, atol=1e-5)
    times = interleaved(
        {
            "vertices": Work(lambda number: playing.vertices(controls[number]), 20),
            "avx2": Work(lambda number: avx2(controls[number]), 20),
        },
        50,
    )
    return medians(times)


def point(folder: Path) -> dict[str, float]:
    """Time the steps of a frame on a mesh of any size."""
    prepared = load_prepared(folder / CHARACTER)
    playing = Playing(prepared, folder / LOG)
    controls = playing.controls().copy()
    todo = {"solve": Work(lambda _: playing.controls(), 250), "vertices": Work(lambda _: playing.vertices(controls), 5)}
    if len(prepared.mesh.vertices) <= MAX_ARAP_VERTICES:
        path = playing.handle_path(60)
        todo["arap_iteration"] = Work(arap_iteration(prepared.mesh, playing.motion.deformer.handles, path), 1)
    return {"vertices": len(prepared.mesh.of_render), **medians(interleaved(todo, 12))}


def cold(folder: Path, exact: int) -> dict[str, Any]:
    """Measure the preparation of a character from its file, without caches, with exact or with the usual fields."""
    character_cost_process.warm_up(folder)
    puppet = puppet_file.load(folder / CHARACTER)
    bones = bones_of(puppet.limbs)
    # compiles what only large surfaces need
    reduced_model.MAX_EXACT_VERTICES = 0
    small = load_prepared(folder / character_cost_process.WARM_UP)
    fine = weld(*igl.upsample(small.mesh.vertices, small.mesh.faces, 2))  # with vertices inside cells
    build(fine, small.puppet.solver.parameters)
    reduced_model.MAX_EXACT_VERTICES = sys.maxsize if exact else coarse_fields.MAX_EXACT_VERTICES
    start = time.perf_counter()
    character = load_character(folder / puppet.character.mesh)
    read = time.perf_counter() - start
    mesh = character.solver_mesh()
    build(mesh, puppet.solver.parameters, bones)
    return {
        "vertices": len(mesh.vertices),
        "read_s": read,
        "cold_s": time.perf_counter() - start,
        "cold_peak_mb": character_cost_process.peak_mb(),
    }


def table1_row(folder: Path) -> dict[str, Any]:
    """Measure a row of the paper's Table 1, with one iteration per frame."""
    character_cost_process.warm_up(folder)
    prepared = load_prepared(folder / CHARACTER)
    handles = prepared.puppet.handle_positions
    found: dict[str, Any] = {"vertices": len(prepared.mesh.of_render), "handles": len(handles)}
    start = time.perf_counter()
    again = load_prepared(folder / CHARACTER)
    Deformer(again.model, again.mesh, handles)
    found["reuse_s"] = time.perf_counter() - start
    start = time.perf_counter()
    mesh = prepared.character.solver_mesh()
    Deformer(build(mesh), mesh, handles)
    found["precompute_s"] = time.perf_counter() - start
    playing = Playing(with_iterations(prepared, 1), folder / LOG)
    path, solve = playing.handle_path(60), playing.motion.deformer.solve
    controls = playing.controls()
    todo = {
        "iteration": Work(lambda number: solve(path[number]), 60),
        "vertices": Work(lambda _: playing.vertices(controls), 10),
    }
    retargeting = Playing(prepared, folder / LOG)
    still = retargeting.motion.step(retargeting.frame()).R
    retargeting.motion.deformer.solve = lambda *_: still  # leaves filter and retargeting
    todo["input"] = Work(lambda _: retargeting.motion.step(retargeting.frame()), 60)
    return found | medians(interleaved(todo, 40))


def with_iterations(prepared: PreparedCharacter, iterations: int) -> PreparedCharacter:
    """Return a character with another number of iterations per frame, and a rotation per isoline."""
    solver = SolverTable(**{**prepared.puppet.solver.model_dump(), "rotations": "covariance", "iterations": iterations})
    puppet = prepared.puppet.model_copy(update={"solver": solver})
    return PreparedCharacter(puppet, prepared.character, prepared.mesh, prepared.model)


def convergence(folder: Path) -> dict[str, Any]:
    """Measure the distance of vertices from the converged result, each frame starting from the previous one.

    Returns
    -------
    dict
        For each number of iterations the largest distance and the 99th percentile, in percent of the diagonal.
    """
    prepared = load_prepared(folder / CHARACTER)
    binding = Binding.of_solver_mesh(prepared.model, prepared.mesh)
    sample = np.linspace(0, len(prepared.mesh.vertices) - 1, min(SAMPLED_VERTICES, len(prepared.mesh.vertices))).astype(
        int
    )
    binding = binding.only(sample)
    targets = list(handle_targets(prepared, folder / LOG))

    def positions(iterations: int) -> NDArray[np.float32]:
        handles = prepared.puppet.handle_positions
        deformer = Deformer(prepared.model, prepared.mesh, handles, iterations=iterations, mode="covariance")
        solved = [to_file_units(deformer.solve(wanted), prepared.model) for wanted in targets]
        return np.array([binding.vertices(controls) for controls in solved])

    settled = positions(CONVERGED_ITERATIONS)
    errors = [100 * np.linalg.norm(positions(n) - settled, axis=2) / prepared.mesh.diagonal for n in ITERATIONS]
    return {
        "iterations": ITERATIONS,
        "max": [float(error.max()) for error in errors],
        "p99": [float(np.percentile(error, 99)) for error in errors],
    }


def handle_targets(prepared: PreparedCharacter, log: Path) -> Iterator[NDArray[np.float64]]:
    """Yield the targets of the handles (h, 3) for each frame of a recording."""
    playing = Playing(prepared, log)
    solve, given = playing.motion.deformer.solve, []

    def watched(targets: NDArray[np.float64], *more: Any) -> NDArray[np.float64]:
        given.append(targets.copy())
        return solve(targets, *more)

    playing.motion.deformer.solve = watched
    for _ in range(len(playing.positions)):
        playing.motion.step(playing.frame())
        yield given.pop()


def medians(times: dict[str, NDArray[np.float64]]) -> dict[str, float]:
    return {f"{name}_ms": float(np.median(taken)) for name, taken in times.items()}


if __name__ == "__main__":
    main({"yardstick": yardstick, "point": point, "cold": cold, "table1_row": table1_row, "convergence": convergence})
