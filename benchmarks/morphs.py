"""Size and accuracy of `puppetline bake` for the example characters, also for motion that was not baked.

python -m benchmarks.morphs FOLDER

prints the table of docs/morphs.md and draws FOLDER/morphs.png: for each character the frame with the largest error, by
the solver and by weights. Each performance is omitted from one basis, and then projected on it.
"""

import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from puppetline.examples.characters import CHARACTERS
from puppetline.examples.performances import PERFORMANCES

from capture.recording import Recorder
from capture.timeline import resample
from engine_bridge.character.character import make_character
from engine_bridge.export.bake import DEFAULT_TOLERANCE, FittedMotion, bake, fit, recorded_motion, synthetic_motion
from engine_bridge.export.live_basis import REACH, LiveBasis
from engine_bridge.performance.clip import solve
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.pictures.contact_sheet import write_contact_sheet
from engine_bridge.pictures.mesh_picture import render
from engine_bridge.pictures.view import View
from solver.model.batch import BatchBinding

PUPPETS = Path(__file__).parents[1] / "examples" / "puppets"
SETTINGS = Settings(tolerance=DEFAULT_TOLERANCE)
TILE_PIXELS = (320, 320)
REPETITIONS = 2000
HEADER = """| character | vertices | targets | file, MB | baked in, s | largest error | unseen: mean | worst frame | \
worst vertex | targets of recordings | their worst frame | projection, µs |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"""


@dataclass(frozen=True)
class Unseen:
    """A performance on a basis without it: residuals, and the pose with the largest error of a vertex."""

    targets: int
    left: NDArray[np.float64]
    farthest: float
    R: NDArray[np.float32]
    nearest: NDArray[np.float32]


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    logs = {name: write_log(name, folder) for name in PERFORMANCES}
    print(HEADER)
    tiles, labels = [], []
    for name, make in CHARACTERS.items():
        made = make()
        make_character(name, made.vertices, made.faces, made.colors).document.save(folder / f"{name}.glb")
        puppet, output = folder / f"{name}.toml", folder / f"{name}.morphs.glb"
        shutil.copyfile(PUPPETS / puppet.name, puppet)
        prepared = load_prepared(puppet)
        start = time.perf_counter()
        summary = bake(puppet, output)
        seconds = time.perf_counter() - start
        others = {name: [other for other in PERFORMANCES if other != name] for name in PERFORMANCES}
        unseen = [
            project(prepared, name, synthetic_motion(prepared, rest, SETTINGS, silent)) for name, rest in others.items()
        ]
        alone = [
            project(prepared, name, recorded_motion(prepared, [logs[other] for other in rest], SETTINGS, silent))
            for name, rest in others.items()
        ]
        left = np.concatenate([one.left for one in unseen])
        worst = max(unseen, key=lambda one: one.farthest)
        took = microseconds(LiveBasis.load(output, prepared), worst.R.astype(np.float64))
        print(
            f"| {name} | {len(prepared.character.vertices):,} | {summary.targets} | {summary.bytes / 1e6:.0f} "
            f"| {seconds:.1f} | {percent(summary.error)} | {percent(left.mean())} | {percent(left.max())} "
            f"| {percent(worst.farthest)} | {min(one.targets for one in alone)}–{max(one.targets for one in alone)} "
            f"| {percent(max(one.left.max() for one in alone))} | {took:.0f} |",
            flush=True,
        )
        tiles += pictures(prepared, worst)
        labels += [f"{name}: solver", f"weights, {percent(worst.farthest)} off"]
    write_contact_sheet(tiles, labels, 2, folder / "morphs.png", "Largest errors of unseen motion")


def silent(_stage: str, _share: float) -> None: ...


def write_log(name: str, folder: Path) -> Path:
    path = folder / f"{name}.log"
    path.unlink(missing_ok=True)
    with Recorder(path) as recorder:
        for frame in PERFORMANCES[name]().frames():
            recorder.write(frame)
    return path


def project(prepared: PreparedCharacter, performance: str, motion: FittedMotion) -> Unseen:
    basis = LiveBasis(fit(prepared, motion, SETTINGS, silent).directions.astype(np.float32), REACH, prepared.model)
    timeline = resample(PERFORMANCES[performance](), SETTINGS.fps, SETTINGS.max_gap)
    frames = solve(prepared, timeline, SETTINGS).R[:]
    shown = [basis.project(R) for R in frames]
    moved = np.tensordot([each.weights for each in shown], basis.targets, axes=1).transpose(0, 2, 1)
    nearest = (prepared.model.rest_controls + moved).astype(np.float32)
    away, _ = BatchBinding.of_solver_mesh(prepared.model, prepared.mesh).largest_displacements(frames - nearest)
    left = [each.residual for each in shown]
    at = int(away.argmax())
    return Unseen(len(basis.names), np.array(left), float(away[at]) / prepared.mesh.diagonal, frames[at], nearest[at])


def microseconds(basis: LiveBasis, R: NDArray[np.float64]) -> float:
    basis.project(R)
    took = []
    for _ in range(REPETITIONS):
        start = time.perf_counter()
        basis.project(R)
        took.append(time.perf_counter() - start)
    return 1e6 * float(np.median(took))


def pictures(prepared: PreparedCharacter, worst: Unseen) -> list[NDArray[np.uint8]]:
    binding = BatchBinding(prepared.model, prepared.character.vertices, prepared.mesh.of_render)
    poses = binding.vertices(np.array([worst.R, worst.nearest])).transpose(2, 0, 1) @ prepared.puppet.character.basis.T
    view = View.around(poses[0])
    return [render(pose, prepared.character.triangles, view, TILE_PIXELS, prepared.character.colors) for pose in poses]


def percent(share: float) -> str:
    return f"{100 * share:.3f} %"


if __name__ == "__main__":
    main()
