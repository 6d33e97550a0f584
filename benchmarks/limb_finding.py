"""Joints that are found from the shape, compared with those of the file's rig.

    python -m benchmarks.limb_finding FOLDER [--poses N] [--characters NAME ...]

FOLDER contains the rigged characters. Each row is a character in the pose of its file, or in N random poses (`posed`,
by default 10) in which its own skin follows random rotations of its limbs. `human` and `biped` are made by code that
defines their joints. Columns are distances in percent of body height: the larger one of both sides, or the 95th
percentile over the poses. A limb that is not found counts as 100. Axes are those of the file; detection of the
orientation is not measured.

Legs may have more or fewer bends in the rig than from the shape. Joints are then compared in the order, from the body
to the foot, in which they are closest; another joint of the rig is compared with the nearest point of the bones that
were found, and another joint that was found is not compared.

The people in the pose of their files were used to choose the constants of `solver.anatomy.limb_finding`, and all
animals to choose those of `solver.anatomy.standing_legs`.
"""

import argparse
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from puppetline.examples.characters import biped, human
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import Character, load_character
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.rig_limbs import rig_limbs, vertex_influences
from solver.anatomy.limb_chain import evenly
from solver.anatomy.limb_finding import find_limbs
from solver.motion.limbs import TRUNK, Bones, Limb, bones_of, parents_first
from solver.surface.mesh import SolverMesh, weld

PEOPLE = ("kaykit_Knight", "quaternius_Adventurer", "quaternius_Witch", "quaternius_George")
MAKER = "quaternius_"
ANIMALS = ("Horse", "Cow", "Alpaca", "Husky", "Fox", "Rat", "Frog", "Parasaurolophus", "Stegosaurus", "Trex")
KINDS = dict.fromkeys(PEOPLE, "people") | dict.fromkeys(("khronos_Fox", *(MAKER + name for name in ANIMALS)), "animals")
JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "hock", "ankle")
UPPER = ("arm", "front leg")
LEFT, UP, FRONT = np.eye(3)
MIRROR = np.array([-1.0, 1.0, 1.0])
NOWHERE = np.full(3, np.nan)

Truth = dict[str, NDArray[np.float64]]


def random_turn(name: str, number: int, way: NDArray[np.float64], rng: np.random.Generator) -> Rotation:
    """Return the random rotation of a bone relative to its parent.

    Upper arms point from 60° below to 45° above the horizon, and from 15° backwards to 60° forwards. Elbows bend
    forwards by up to 80°. Legs swing by 25°, spread by 15°, and knees bend by 40°; both upper bones of four legs
    swing by 15°. Heads and tails turn by 20°.
    """
    side = 1.0 if name.startswith("left") else -1.0
    if name.endswith(" arm"):
        if number == 0:
            below, front = np.radians([rng.uniform(-45, 60), rng.uniform(-15, 60)])
            aim = [side * np.cos(below) * np.cos(front), -np.sin(below), np.cos(below) * np.sin(front)]
            return Rotation.align_vectors(np.array([aim]), way[None])[0]
        axis = np.cross(way, FRONT + rng.uniform(-0.5, 0.5) * UP)
        return turn(axis, rng.uniform(0, 80)) if number == 1 else Rotation.identity()
    if name.endswith(("front leg", "hind leg")):
        return turn(LEFT, rng.uniform(-15, 15)) if number < 2 else Rotation.identity()
    if name.endswith("leg"):
        if number == 0:
            return turn(FRONT, side * rng.uniform(0, 15)) * turn(LEFT, rng.uniform(-25, 25))
        return turn(LEFT, rng.uniform(0, 40)) if number == 1 else Rotation.identity()
    if name in ("head", "tail") and number < 2:
        return turn(LEFT, rng.uniform(-20, 20)) * turn(UP, rng.uniform(-20, 20))
    return Rotation.identity()


def turn(axis: NDArray[np.float64], degrees: float) -> Rotation:
    return Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis))


def random_motions(names: list[tuple[str, int]], bones: Bones, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the motions of bones (b, 4, 3), for row vectors [x 1]."""
    turns: list[Rotation] = []
    moved = np.zeros((len(names), 4, 3))
    for bone, (name, number) in enumerate(names):
        parent, head = int(bones.parents[bone]), bones.heads[bone]
        above = turns[parent] if parent >= 0 else Rotation.identity()
        turns.append(above * random_turn(name, number, bones.tails[bone] - head, rng))
        there = head if parent < 0 else np.append(head, 1.0) @ moved[parent]
        moved[bone, :3] = turns[-1].as_matrix().T
        moved[bone, 3] = there - head @ moved[bone, :3]
    return moved


def posed(character: Character, count: int) -> Iterator[tuple[SolverMesh, Truth]]:
    """Yield the mesh and the joints of a character in random poses, which are the same every time."""
    rig, mesh, rng = rig_limbs(character), character.solver_mesh(), np.random.default_rng(1)
    assert rig is not None
    parents = {TRUNK: None, "head": "neck" if "neck" in rig.points else TRUNK}
    limbs = parents_first(
        [Limb(c.name, c.points, ((),) * len(c.points), parent=parents.get(c.name, TRUNK)) for c in rig.chains]
    )
    names = [(limb.name, number) for limb in limbs for number in range(len(limb.points) - 1)]
    bones = bones_of(limbs)
    which, share = vertex_influences(character)
    follows = rig_bones(character, limbs).of_nodes(character).argmax(axis=1)[which]
    shown = np.unique(mesh.of_render, return_index=True)[1]
    rest = np.column_stack([mesh.vertices, np.ones(len(mesh.vertices))])
    for _ in range(count):
        motions = random_motions(names, bones, rng)
        blend = np.einsum("nk,nkrc->nrc", share[shown], motions[follows[shown]])
        vertices = np.einsum("nr,nrc->nc", rest, blend)
        heads, tails = (
            np.einsum("br,brc->bc", np.column_stack([ends, np.ones(len(ends))]), motions)
            for ends in (bones.heads, bones.tails)
        )
        truth: Truth = {}
        for limb in limbs:
            first = names.index((limb.name, 0))
            truth[limb.name] = np.concatenate([heads[first : first + 1], tails[first : first + len(limb.points) - 1]])
        yield SolverMesh(vertices, mesh.faces, mesh.of_render), truth


def examples() -> Iterator[tuple[str, SolverMesh, Truth]]:
    made = human.build()
    arm = human.SCALE * np.array([(0.168, 1.372, -0.022), NOWHERE, (0.468, 0.915, 0.05)])  # one tube without an elbow
    leg = human.SCALE * np.array([(0.08, 0.90, -0.01), (0.112, 0.50, 0.012), (0.12, 0.105, -0.02)])
    truth = {"left arm": arm, "right arm": arm * MIRROR, "left leg": leg, "right leg": leg * MIRROR}
    yield "human", weld(np.asarray(made.vertices, float), np.asarray(made.faces)), truth
    made = biped.build()
    arm = np.array([biped.SHOULDER, biped.ELBOW, biped.WRIST])
    leg = np.array([biped.HIP, biped.KNEE, biped.ANKLE])
    truth = {"left arm": arm, "right arm": arm * MIRROR, "left leg": leg, "right leg": leg * MIRROR}
    yield "biped", weld(np.asarray(made.vertices, float), np.asarray(made.faces)), truth


def errors(mesh: SolverMesh, truth: Truth) -> dict[str, list[float]]:
    """Return the distances of the found joints from the true ones, by joint, in percent of body height."""
    found = find_limbs(mesh, np.eye(3)).points
    height = float(np.ptp(mesh.vertices[:, 1]))
    result: dict[str, list[float]] = {name: [] for name in JOINTS}
    for limb, points in truth.items():
        side, _, kind = limb.partition(" ")
        if side in ("left", "right") and kind.endswith(("arm", "leg")):
            names = JOINTS[:3] if kind in UPPER else JOINTS[3:] if len(points) > 4 else ("hip", "knee", "ankle")
            joints = points[: len(names)]
            away = distances(found[limb], joints) / height if limb in found else np.ones(len(names))
            for name, distance in zip(names, away, strict=True):
                if np.isfinite(distance):
                    result[name].append(100 * min(float(distance), 1.0))
    return result


def distances(found: NDArray[np.float64], joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each true joint of a limb (k, 3) is from the corresponding point of the limb that was found."""
    count = len(found) - 1  # its end is no joint
    apart = np.linalg.norm(joints[:, None] - found[None, :count], axis=2)
    true = [list(rows) for rows in combinations(range(len(joints)), min(len(joints), count))]
    own = [list(columns) for columns in combinations(range(count), min(len(joints), count))]
    rows, columns = min(
        ((rows, columns) for rows in true for columns in own), key=lambda pair: np.nansum(apart[pair[0], pair[1]])
    )
    result = np.linalg.norm(joints[:, None] - evenly(found, 200)[None], axis=2).min(axis=1)
    result[rows] = apart[rows, columns]
    return np.asarray(result)


def row(title: str, measured: list[dict[str, list[float]]]) -> list[float]:
    """Print a row of the table, and return all its distances."""
    cells = []
    for name in JOINTS:
        values = [away for one in measured for away in one[name]]
        worst = np.quantile(values, 1.0 if len(measured) == 1 else 0.95) if values else np.nan
        cells.append(f"{worst:9.1f}" if values else "        –")
    every = [away for one in measured for values in one.values() for away in values]
    print(title.ljust(32), *cells, f"{np.median(every):9.1f}", flush=True)
    return every


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--poses", type=int, default=10)
    parser.add_argument("--characters", nargs="*", default=tuple(KINDS))
    options = parser.parse_args()
    print("character".ljust(32), *(name.rjust(9) for name in JOINTS), "   median")
    totals: dict[str, list[float]] = {}
    for title, mesh, truth in examples():
        totals.setdefault("people as made", []).extend(row(title, [errors(mesh, truth)]))
    for name in options.characters:
        character = load_character(options.folder / f"{name}.glb")
        rig = rig_limbs(character)
        assert rig is not None
        kind = KINDS.get(name, "others")
        totals.setdefault(f"{kind} as made", []).extend(row(name, [errors(character.solver_mesh(), rig.points)]))
        measured = [errors(mesh, truth) for mesh, truth in posed(character, options.poses)]
        if measured:
            totals.setdefault(f"{kind} posed", []).extend(row(f"{name} posed", measured))
    for pose, away in totals.items():
        print(f"{pose}, {len(away)} joints: median {np.median(away):.1f} %, 95 % {np.quantile(away, 0.95):.1f} %")


if __name__ == "__main__":
    main()
