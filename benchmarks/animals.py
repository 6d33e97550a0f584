"""Animals that a performer drives: how they stand, step and stretch.

    python -m benchmarks.animals --data FOLDER [--only NAME …] [--logs NAME …] [--pictures FOLDER] [--free]

Each character of FOLDER/mesh plays each recording with the puppet that `puppetline new` proposes. Heights and speeds
are those of the lowest vertices of each foot, in body heights, and stretch that of all edges; "their skin" is linear
blend skinning of the same motions with the weights of the file. With `--free` no foot is held, for comparison; with
`--pictures` a contact sheet of each clip is drawn.
"""

import argparse
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from capture.skeleton import JOINT_INDEX
from capture.timeline import Timeline
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import load_timeline, perform, reference_pose
from engine_bridge.performance.prepared_character import PreparedCharacter, make_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.pictures import clip_sheet
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.puppet.rig_bones import skin_shares
from puppetline.errors import PuppetlineError
from solver.anatomy.limb_chain import evenly
from solver.model.batch import BatchBinding
from solver.model.stretch import EdgeStretch
from solver.motion.limbs import bones_of, parents_first

ANIMALS = (
    *("Alpaca", "Cow", "Fox", "Frog", "Horse", "Husky", "khronos_Fox", "Parasaurolophus", "Rat", "Shark", "Snake"),
    *("Stegosaurus", "Trex", "cat_7k", "dog_10k", "dinosaur_14k", "feline", "spot_cow"),
)
LOGS = (
    *("utkinect/joints_s01_e01", "utkinect/joints_s03_e01", "utkinect/joints_s09_e01", "Ges01", "a26_s1", "P1_1_1_p19"),
    *("cmu_01_01_hops", "jumping_jacks"),
)

ON_FLOOR = 0.01
"""Height over the floor below which a foot touches it, in body heights."""

SOLE = 0.03
"""Height of the vertices of a foot over the lowest of them, in body heights."""

RAISED = 0.05
"""Height over the lowest foot above which a foot is raised at rest, in body heights: it does not count. The others
stand on their own height."""

STANDS_SECONDS, STANDS_METRES = 1.0, 0.05
"""A performer's foot stands while it stays this close to one place for at least this time, in seconds and metres."""

ARRIVAL_SECONDS = 1.0
"""Time after which a performer's stand counts, in seconds: the animal's last steps end a walk."""

Floats = NDArray[np.float64]


class Row(NamedTuple):
    """Measures of a clip, in body heights, shares and edge lengths."""

    above: float
    below: float
    few: float
    touching: float
    slide: float
    slide95: float
    acceleration: float
    steps_standing: int
    low: float
    high: float
    skin_low: float
    skin_high: float


def main() -> None:
    """Print a row per character and recording, and one over all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=list(ANIMALS))
    parser.add_argument("--logs", nargs="*", default=list(LOGS))
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--free", action="store_true")
    chosen = parser.parse_args()
    print("| character | recording | legs | above | below | below half | on floor | slide | 95 % | acceleration "
          "| steps while standing | edges p1 | p99 | their skin p1 | p99 |")  # fmt: skip
    print("| --- |" + " --- |" * 14)
    rows = []
    for mesh in sorted(path for path in (chosen.data / "mesh").rglob("*") if path.suffix in (".glb", ".obj", ".off")):
        if any(part in mesh.stem for part in chosen.only):
            rows += list(measured(mesh, chosen))
    if rows:
        table = np.array(rows)
        print("\nMedian and 95 % of all: " + ", ".join(
            f"{name} {np.nanmedian(column):.3g} / {np.nanpercentile(column, 95):.3g}"
            for name, column in zip(Row._fields, table.T, strict=True)
        ))  # fmt: skip


def measured(mesh: Path, chosen: argparse.Namespace) -> Iterator[Row]:
    """Yield the rows of a character."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            proposal = new_puppet(mesh, Path(folder) / "puppet.toml")
        except PuppetlineError as error:
            print(f"| {mesh.stem} | {error.found} |")
            return
        puppet = proposal.puppet
        if chosen.free and puppet.root is not None:
            puppet = puppet.model_copy(update={"root": puppet.root.model_copy(update={"feet": "free"})})
        prepared = make_prepared(puppet, proposal.character)
        logs = sorted(path for folder in ("logs", "bvh") for path in (chosen.data / folder).rglob("*"))
        for log in (log for log in logs if any(part in str(log) for part in chosen.logs) and "depth" not in log.stem):
            settings = Settings(form="morph")
            timeline, notes = load_timeline(log, settings)
            soles = soles_of(prepared)
            row = play(prepared, timeline, settings, soles)
            print(
                f"| {mesh.stem} | {log.stem} | {len(soles)} | {100 * row.above:.1f} | {100 * row.below:.1f} "
                f"| {100 * row.few:.1f} % | {100 * row.touching:.0f} % | {row.slide:.3f} | {row.slide95:.2f} "
                f"| {row.acceleration:.1f} | {row.steps_standing} | {row.low:.2f} | {row.high:.2f} "
                f"| {row.skin_low:.2f} | {row.skin_high:.2f} |",
                flush=True,
            )
            if chosen.pictures:
                chosen.pictures.mkdir(parents=True, exist_ok=True)
                clip = perform(prepared, timeline, settings, notes, lambda *_: None)
                clip_sheet.draw(clip, chosen.pictures / f"{mesh.stem}-{log.stem}.png", f"{mesh.stem}, {log.stem}")
            yield row


def soles_of(prepared: PreparedCharacter) -> list[NDArray[np.int64]]:
    """Return the lowest vertices of each foot: of the surface near the tip of each leg."""
    up = prepared.puppet.character.basis[1]
    vertices = prepared.mesh.vertices
    heights = vertices @ up
    size = float(np.ptp(heights))
    feet = [
        limb.points[-2:] for limb in prepared.puppet.limbs if limb.name.split()[-1] == "leg" or " leg " in limb.name
    ]
    if not feet:
        return []
    away = np.array([cKDTree(evenly(foot, 5)).query(vertices)[0] for foot in feet]).T
    soles = []
    for leg in range(len(feet)):
        near = np.flatnonzero((away.argmin(axis=1) == leg) & (away[:, leg] < 0.15 * size))
        if len(near):
            soles.append(near[heights[near] < heights[near].min() + SOLE * size])
    return soles


def play(prepared: PreparedCharacter, timeline: Timeline, settings: Settings, soles: list[NDArray[np.int64]]) -> Row:
    """Play a recording, and measure the feet."""
    motion = CharacterMotion(prepared, reference_pose(prepared.puppet, timeline, settings))
    surface, stretch, stretch_of_skin = (
        BatchBinding.of_solver_mesh(prepared.model, prepared.mesh),
        EdgeStretch(prepared.mesh),
        EdgeStretch(prepared.mesh),
    )
    shares = skin_of(prepared)
    basis, rest = prepared.puppet.character.basis, prepared.mesh.vertices
    size = float(np.ptp(rest @ basis[1]))
    steps = getattr(motion.performer, "_grounding", None)
    heights, places, bodies, swinging, lifted = [], [], [], [], []
    used = np.concatenate(soles) if soles else np.zeros(0, dtype=np.int64)
    starts = np.cumsum([0, *map(len, soles)])
    floors = np.array([(rest[sole] @ basis[1]).min() for sole in soles])
    floors[floors > floors.min(initial=np.inf) + RAISED * size] = np.nan
    trunk = _trunk(prepared)
    for number in range(len(timeline.positions)):
        pose = motion.step(timeline.frame(number))
        moved = surface.vertices(pose.R[None].astype(np.float32))
        stretch.add(moved)
        if shares is not None:
            stretch_of_skin.add(skinned(shares, rest, pose.bones).astype(np.float32)[:, :, None])
        now = (moved[used, :, 0] + pose.root) @ basis.T
        heights.append(np.array([now[a:b, 1].min() for a, b in pairwise(starts)]) - floors)
        places.append([now[a:b].mean(axis=0) for a, b in pairwise(starts)])
        body = (
            pose.bones[trunk, 3] + rig_head(prepared, trunk) @ pose.bones[trunk, :3] if prepared.puppet.limbs else 0.0
        )
        bodies.append(body + pose.root)
        swinging.append(np.array(getattr(steps, "swinging", np.zeros(len(soles), dtype=bool))))
        lifted.append(bool(getattr(steps, "lifted", False)))
    return _row(
        np.array(heights) / size,
        np.array(places) / size,
        np.array(bodies) / size,
        np.array(swinging),
        np.array(lifted),
        timeline,
        motion.performer.root_scale / size,
        (
            *stretch.percentiles(1, 99),
            *(stretch_of_skin.percentiles(1, 99) if shares is not None else (np.nan, np.nan)),
        ),
    )


def skin_of(prepared: PreparedCharacter) -> Floats | None:
    """Return the weights (n, b) that the file's skin gives to the vertices of the solver's mesh."""
    shares = skin_shares(prepared.character, prepared.puppet) if prepared.character.document.gltf.get("skins") else None
    if shares is None:
        return None
    out = np.empty((len(prepared.mesh.vertices), shares.shape[1]))
    out[prepared.mesh.of_render] = shares
    return out


def rig_head(prepared: PreparedCharacter, bone: int) -> Floats:
    """Return where a bone begins at rest."""
    return bones_of(prepared.puppet.limbs).heads[bone]


def _trunk(prepared: PreparedCharacter) -> int:
    first = 0
    for limb in parents_first(prepared.puppet.limbs):
        if limb.name == "trunk":
            return first
        first += len(limb.points) - 1
    return 0


def _row(
    heights: Floats,
    places: Floats,
    bodies: Floats,
    swinging: NDArray[np.bool_],
    lifted: NDArray[np.bool_],
    timeline: Timeline,
    scale: float,
    edges: tuple[float, ...],
) -> Row:
    rate = timeline.fps
    acceleration = np.linalg.norm(np.diff(bodies, 2, axis=0), axis=1) * rate**2
    hips = timeline.positions[:, JOINT_INDEX["hip_center"]]
    own = np.linalg.norm(np.diff(hips, 2, axis=0), axis=1) * rate**2 * scale
    ratio = float(np.percentile(acceleration, 99) / max(np.percentile(own, 99), 1e-9))
    if not heights.shape[1]:
        return Row(np.nan, np.nan, 0, np.nan, np.nan, np.nan, ratio, 0, *edges)
    lowest = np.nanmin(heights, axis=1)
    touches = np.abs(heights) < ON_FLOOR
    both = touches[1:] & touches[:-1]
    speeds = np.linalg.norm(np.diff(places[..., [0, 2]], axis=0), axis=2)[both] * rate
    stands = performer_stands(timeline)
    began = (~swinging[:-1] & swinging[1:]) & stands[1:, None]
    return Row(
        above=float(np.percentile(np.maximum(lowest, 0), 95)),
        below=float(np.percentile(np.maximum(-lowest, 0), 95)),
        few=float((touches[~lifted].sum(axis=1) < np.isfinite(heights[0]).sum() // 2).mean()),
        touching=float(touches[~lifted].any(axis=1).mean()),
        slide=float(np.median(speeds)) if len(speeds) else np.nan,
        slide95=float(np.percentile(speeds, 95)) if len(speeds) else np.nan,
        acceleration=ratio,
        steps_standing=int(began.sum()),
        low=edges[0],
        high=edges[1],
        skin_low=edges[2],
        skin_high=edges[3],
    )


def performer_stands(timeline: Timeline) -> NDArray[np.bool_]:
    """Return the frames (f,) in which both feet of the performer have stood where they are, and go on standing.

    A foot stands while it is seen within `STANDS_METRES` of its median over `STANDS_SECONDS`. The first seconds of a
    stand are left out: the body arrives, and its feet come together.
    """
    ankles = [JOINT_INDEX["ankle_left"], JOINT_INDEX["ankle_right"]]
    feet, frames = timeline.positions[:, ankles], round(STANDS_SECONDS * timeline.fps)
    known = (timeline.confidence[:, ankles] > 0).all(axis=1)
    stands = np.zeros(len(feet), dtype=bool)
    for first in range(len(feet) - frames + 1):
        part = slice(first, first + frames)
        away = np.linalg.norm(feet[part] - np.median(feet[part], axis=0), axis=2)
        if known[part].all() and away.max() < STANDS_METRES:
            stands[part] = True
    arrived = np.array([stands[max(0, frame - round(ARRIVAL_SECONDS * timeline.fps)) : frame + 1].all()
                        for frame in range(len(feet))])  # fmt: skip
    return np.asarray(stands & arrived)


def skinned(weights: Floats, rest: Floats, motions: Floats) -> Floats:
    """Return linear blend skinning (N, 3) by motions (b, 4, 3) with weights (N, b); without weights a vertex stays."""
    blended = (weights @ motions.reshape(len(motions), 12)).reshape(-1, 4, 3)
    moved: Floats = np.einsum("ni,nij->nj", rest, blended[:, :3]) + blended[:, 3]
    return moved + (1 - weights.sum(axis=1, keepdims=True)) * rest


if __name__ == "__main__":
    main()
