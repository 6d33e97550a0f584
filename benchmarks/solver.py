"""Time a frame beside one iteration of libigl's full-resolution ARAP on the same mesh, in one run.

python -m benchmarks.solver [MESH]
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import igl
import numpy as np
from puppetline.examples.characters import CHARACTERS

from engine_bridge.gltf.character import load_character, make_character
from solver.binding import Binding
from solver.deformer import Deformer
from solver.extremities import extremities, surface_graph
from solver.mesh import SolverMesh
from solver.reduced_model import build

REPEATS = 50
SHIFT = 0.05
"""How far the handles move to and fro, as a fraction of the diagonal."""


def median_ms(work: Callable[[int], object], repeats: int = REPEATS) -> float:
    """Return the median of the wall-clock milliseconds of work(0), work(1), …"""
    work(0)
    times = []
    for repeat in range(repeats):
        start = time.perf_counter()
        work(repeat)
        times.append(time.perf_counter() - start)
    return 1000 * float(np.median(times))


def arap_iteration_ms(mesh: SolverMesh, corners: np.ndarray, moved: Callable[[int], np.ndarray]) -> float:
    data = igl.ARAPData()
    data.max_iter = 1
    igl.arap_precomputation(mesh.vertices, mesh.faces, 3, corners.astype(np.int32), data)
    state = [mesh.vertices]

    def iterate(repeat: int) -> None:
        state[0] = igl.arap_solve(moved(repeat), data, state[0])

    return median_ms(iterate, 10)


def main() -> None:
    if len(sys.argv) > 1:
        mesh = load_character(Path(sys.argv[1])).solver_mesh()
    else:
        made = CHARACTERS["biped"]()
        mesh = make_character("biped", made.vertices, made.faces).solver_mesh()
    start = time.perf_counter()
    model = build(mesh)
    precompute = time.perf_counter() - start
    corners = extremities(mesh, surface_graph(mesh)).vertices[:6]
    rest = mesh.vertices[corners]

    def moved(repeat: int) -> np.ndarray:
        return rest + SHIFT * mesh.diagonal * np.sin(0.2 * repeat + np.arange(len(rest)))[:, None]

    binding = Binding.of_solver_mesh(model, mesh)
    deformers = {count: Deformer(model, mesh, rest, iterations=count) for count in (1, 4)}
    controls = deformers[4].step(rest)
    rows = {
        "controls, 1 iteration": median_ms(lambda repeat: deformers[1].step(moved(repeat))),
        "controls, 4 iterations": median_ms(lambda repeat: deformers[4].step(moved(repeat))),
        "vertices": median_ms(lambda _: binding.vertices(controls)),
        "one ARAP iteration of libigl": arap_iteration_ms(mesh, corners, moved),
    }
    arap = rows["one ARAP iteration of libigl"]
    print(f"{len(mesh.vertices):,} vertices, {len(corners)} handles; pre-computation {precompute:.2f} s\n")
    print("| what | ms, median | ARAP iteration / this |\n| --- | --- | --- |")
    for name, value in rows.items():
        print(f"| {name} | {value:.3f} | {arap / value:.1f} |")


if __name__ == "__main__":
    main()
