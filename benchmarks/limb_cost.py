"""Cost of limbs: controls of a frame and pre-computation, compared with an ARAP iteration in the same run.

python -m benchmarks.limb_cost MESH LOG

MESH is a mesh without a skin, such as the Armadillo. Its limbs are those that `puppetline new` proposes.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from engine_bridge.character.character import load_character
from engine_bridge.inspection.character_cost import Work, arap_iteration, interleaved
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import load_timeline, resting_pose
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet
from solver.model.reduced_model import build

ROUNDS = 12
"""Number of rounds in which the functions are timed in turn."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("mesh", type=Path)
    parser.add_argument("log", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        puppet = Path(folder) / "puppet.toml"
        puppet.write_text(puppet_file.dumps(new_puppet(options.mesh, puppet).puppet))
        prepared = load_prepared(puppet)
    timeline, _ = load_timeline(options.log, Settings())
    motion = CharacterMotion(prepared, resting_pose(timeline, Settings()))
    aims = [motion.performer.step(frame) for frame in map(timeline.frame, range(len(timeline.positions)))]
    R = np.empty_like(prepared.model.rest_controls)
    last = prepared.model.bones.terminal
    ends = prepared.model.bones.tails[last]
    homogeneous = np.column_stack([ends, np.ones(len(ends))])
    targets = np.array([np.einsum("bx,bxk->bk", homogeneous, aim.bones[last]) for aim in aims])

    def solve(number: int) -> None:
        aim = aims[number % len(aims)]
        motion.deformer.solve(aim.targets, aim.bones, R)

    mesh = load_character(options.mesh).solver_mesh()
    times = interleaved({"solve": Work(solve, 250), "arap": Work(arap_iteration(mesh, ends, targets), 1)}, ROUNDS)
    start = time.perf_counter()
    build(mesh, prepared.puppet.solver.parameters, prepared.model.bones)
    seconds = time.perf_counter() - start
    solved, arap = np.median(times["solve"]), np.median(times["arap"])
    print(
        f"{len(prepared.model.bones)} bones, {prepared.model.cluster.max() + 1} clusters, {len(mesh.vertices)} vertices"
    )
    print(f"controls of a frame: {solved:.3f} ms, {arap / solved:.0f} times below an ARAP iteration ({arap:.1f} ms)")
    print(f"pre-computation with bones: {seconds:.2f} s")


if __name__ == "__main__":
    main()
