"""Compare fields from a sample of the vertices with exact ones, over recordings.

python -m benchmarks.coarse_fields MESH… --log LOG… [--vertices COUNT]

Every mesh is subdivided until it has more than COUNT vertices, and played with the limbs and with the handles that
`puppetline new` proposes.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import igl
import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character, load_character
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import load_timeline, resting_pose
from engine_bridge.performance.rig import Rig
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.puppet.puppet import Puppet
from puppetline.errors import PuppetlineError
from solver.model import reduced_model
from solver.model.binding import Binding
from solver.model.reduced_model import ReducedModel, build
from solver.model.stretch import EdgeStretch
from solver.motion.deformer import to_file_units
from solver.motion.limbs import bones_of
from solver.surface.mesh import SolverMesh, weld

HEADER = """\
| mesh | moved by | recording | fields | seconds | handles missed by | edges p1 / p99 | distance p50 / p99 / max |
| --- | --- | --- | --- | --- | --- | --- | --- |"""

COMPARISON_FRAMES = 5
"""Number of frames between two comparisons of all vertices."""


def subdivided(character: Character, count: int) -> SolverMesh:
    vertices, faces = character.vertices, character.triangles
    while len(vertices) <= count:
        vertices, faces = igl.upsample(vertices, faces)
    return weld(vertices, faces, character.document.name)


def model_of(mesh: SolverMesh, puppet: Puppet, largest_exact: int) -> tuple[ReducedModel, float]:
    """Return a model whose fields are exact up to a number of vertices, and the time that it took in seconds."""
    usual, reduced_model.MAX_EXACT_VERTICES = reduced_model.MAX_EXACT_VERTICES, largest_exact
    try:
        start = time.process_time()
        model = build(mesh, puppet.solver.parameters, bones_of(puppet.limbs))
        return model, time.process_time() - start
    finally:
        reduced_model.MAX_EXACT_VERTICES = usual


def played(rig: Rig, log: Path) -> tuple[float, tuple[float, ...], NDArray[np.float32]]:
    """Return how far handles are missed as a share of the diagonal, percentiles of edge stretch, and some frames."""
    settings, mesh, model = Settings(), rig.mesh, rig.model
    timeline, _ = load_timeline(log, settings)
    motion = CharacterMotion(rig, resting_pose(timeline, settings))
    deformer, missed = motion.deformer, [0.0]
    if len(deformer.handles):
        rows, solve = model.rows(mesh, deformer.handles), deformer.solve

        def watched(targets: NDArray[np.float64], *more: object) -> NDArray[np.float64]:
            R = solve(targets, *more)
            missed.append(float(np.linalg.norm(rows @ R - model.to_model(targets), axis=1).max()))
            return R

        deformer.solve = watched
    binding, stretch, frames = Binding.of_solver_mesh(model, mesh), EdgeStretch(mesh), []
    for number in range(len(timeline.positions)):
        R = motion.step(timeline.frame(number)).R
        if number % COMPARISON_FRAMES == 0:
            frames.append(binding.vertices(to_file_units(R, model)))
            stretch.add(frames[-1][:, :, None])
    return max(missed), stretch.percentiles(1, 99), np.array(frames)


def rows_of(path: Path, logs: list[Path], count: int) -> Iterator[str]:
    character = load_character(path)
    mesh = subdivided(character, count)
    for moved_by in ("limbs", "handles"):
        with tempfile.TemporaryDirectory() as folder:
            puppet = new_puppet(path, Path(folder) / "puppet.toml", limbs=moved_by == "limbs").puppet
        models = {"exact": model_of(mesh, puppet, len(mesh.vertices)), "sampled": model_of(mesh, puppet, 0)}
        for log in logs:
            exact = None
            for kind, (model, seconds) in models.items():
                missed, edges, frames = played(Rig(puppet, character, mesh, model), log)
                apart = ""
                if exact is None:
                    exact = frames
                else:
                    away = 100 * np.linalg.norm(frames - exact, axis=2) / mesh.diagonal
                    apart = " / ".join(f"{np.percentile(away, share):.3f}" for share in (50, 99, 100)) + " %"
                low, high = edges
                yield (
                    f"| {path.stem}, {len(mesh.vertices):,} | {moved_by} | {log.stem} | {kind} | {seconds:.2f} "
                    f"| {100 * missed:.4f} % | {low:.3f} / {high:.3f} | {apart} |"
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path, nargs="+")
    parser.add_argument("--log", type=Path, nargs="+", required=True)
    parser.add_argument("--vertices", type=int, default=50_000, metavar="COUNT")
    options = parser.parse_args()
    print(HEADER)
    for path in options.mesh:
        try:
            for row in rows_of(path, options.log, options.vertices):
                print(row, flush=True)
        except PuppetlineError as error:
            print(f"| {path.name} | refused: {error.found} | | | | | | |", flush=True)


if __name__ == "__main__":
    main()
