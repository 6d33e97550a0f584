"""Limbs and joints that are found, compared with those of files' rigs.

    python -m benchmarks.limb_finding ends FOLDER [--only NAME ...]
    python -m benchmarks.limb_finding joints FOLDER [--poses N] [--characters NAME ...]

`ends` measures those characters of `bodies.jsonl` that FOLDER contains. Each is `file` in it and `path` in a public
repository. Their makers' joints, or a person who looked at them, say where each limb ends and how the body stands. The
finder sees the file, the file without the names of its joints, or its surface alone. A limb is found if an end of its
class is within 15 % of the largest extent. Makers are in five folds, so that a finder can be fitted on the others.

Ends are what a person would draw: hands at the tips of fingers without what they hold, also if no joint is called a
hand; paws, not ankles; a head at its crown or nose, not at its antlers; flippers with joints are wings. A
fish's head is no limb if its joint carries the tail: it cannot turn without the body.

`joints` compares joints that are found from the shape. Each row is a character of FOLDER in the pose of its file, or in
N random poses (`posed`, by default 10) in which its own skin follows random rotations of its limbs. `human` and `biped`
are made by code that defines their joints. Columns are distances in percent of body height: the larger one of both
sides, or the 95th percentile over the poses. A limb that is not found counts as 100. Axes are those of the file;
detection of the orientation is not measured.

Legs may have more or fewer bends in the rig than from the shape. Joints are then compared in the order, from the body
to the foot, in which they are closest; another joint of the rig is compared with the nearest point of the bones that
were found, and another joint that was found is not compared.
"""

import argparse
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from puppetline.examples.characters import biped, human
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import CharacterMesh, load_character, make_character
from engine_bridge.puppet.axes_proposal import propose_axes
from engine_bridge.puppet.limb_proposal import limb_tables
from engine_bridge.puppet.proposal import PLACEHOLDER_HANDLES, fitting, limbs_of
from engine_bridge.puppet.puppet import Direction
from engine_bridge.puppet.puppet_file import check
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.rig_limbs import rig_limbs
from engine_bridge.puppet.skin_joints import vertex_influences
from puppetline.errors import PuppetlineError
from solver.anatomy.limb_chain import Limbs, evenly
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


def posed(character: CharacterMesh, count: int) -> Iterator[tuple[SolverMesh, Truth]]:
    """Yield the mesh and the joints of a character in random poses, which are the same every time."""
    rig, mesh, rng = rig_limbs(character), character.solver_mesh(), np.random.default_rng(1)
    assert rig is not None
    parents = {TRUNK: None, "head": "neck" if "neck" in rig.limbs.points else TRUNK}
    limbs = parents_first(
        [Limb(c.name, c.points, ((),) * len(c.points), parent=parents.get(c.name, TRUNK)) for c in rig.limbs.chains]
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


BODIES = Path(__file__).with_name("bodies.jsonl")
CLASSES = ("head", "arm", "leg", "tail", "wing")
MAX_AWAY_SHARE = 0.15
"""Maximum distance between the end of a limb and the end that was found, as a share of the largest extent."""

FOLDS = 5
PROBABILITIES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Limits of the ranges of stated probabilities."""


@dataclass(frozen=True)
class Answer:
    """What a finder says of a character, and the probability that it states for up and front."""

    limbs: Limbs
    up: Direction
    front: Direction
    probability: float


Finder = Callable[[CharacterMesh], Answer]


def find(character: CharacterMesh) -> Answer:
    """Return the answer of `puppetline new`."""
    surface = character.solver_mesh()
    axes = propose_axes(character, surface, specified=bool(character.joints))
    values = {"character": {"mesh": "a.glb", **axes.values}, "root": {}, "retarget": {}}
    standing = check(values | {"handle": PLACEHOLDER_HANDLES}, "the proposal").character
    limbs = limbs_of(axes.rig, surface, standing)
    tables = [limb.model_dump(exclude_none=True) for limb in limb_tables(limbs, standing)]
    kept = {table["name"] for table in fitting(values, tables, surface)[0]} if tables else set()
    found = Limbs(tuple(chain for chain in limbs.chains if chain.name in kept))
    return Answer(found, axes.orientation.up, axes.orientation.front, axes.orientation.confidence)


def unnamed(character: CharacterMesh) -> CharacterMesh:
    """Return a character whose nodes have no names."""
    document = character.document.copy()
    for node in document.gltf["nodes"]:
        node.pop("name", None)
    document.gltf.pop("extensions", None)
    return replace(character, document=document)


def bare(character: CharacterMesh) -> CharacterMesh:
    """Return the surface of a character, without its skin."""
    return make_character("bare", character.vertices, character.triangles)


VIEWS: dict[str, Callable[[CharacterMesh], CharacterMesh]] = {
    "file": lambda character: character,
    "unnamed": unnamed,
    "shape": bare,
}


@dataclass
class Score:
    """Counts of what was found."""

    limbs: Counter[str] = field(default_factory=Counter)
    found: Counter[str] = field(default_factory=Counter)
    proposed: int = 0
    stands: list[tuple[float, bool, bool]] = field(default_factory=list)
    """Stated probability of up and front, and whether each of them is right."""
    right: list[bool] = field(default_factory=list)
    """Whether all limbs were found, and no false one, and up and front are right."""

    def add(self, other: "Score") -> None:
        self.limbs += other.limbs
        self.found += other.found
        self.proposed += other.proposed
        self.stands += other.stands
        self.right += other.right


def score(body: dict[str, Any], character: CharacterMesh, answer: Answer | None) -> Score:
    """Compare an answer, or that no limbs were found, with a row of the list."""
    size = MAX_AWAY_SHARE * float(np.ptp(character.vertices, axis=0).max())
    chains = answer.limbs.chains if answer else ()
    result = Score(proposed=sum(class_of(chain.name) is not None for chain in chains))
    for name in CLASSES:
        true = np.array([end[1:] for end in body["ends"] if class_of(end[0]) == name]).reshape(-1, 3)
        own = np.array([chain.points[-1] for chain in chains if class_of(chain.name) == name]).reshape(-1, 3)
        near = np.linalg.norm(true[:, None] - own[None], axis=2) < size
        result.limbs[name] += len(true)
        result.found[name] += int(near[linear_sum_assignment(near, maximize=True)].sum())
    up, front = (answer is not None and getattr(answer, axis) == body[axis] for axis in ("up", "front"))
    complete = result.found.total() == result.limbs.total() == result.proposed
    result.stands.append((answer.probability if answer else 0.0, up, front))
    result.right.append(bool(complete and up and front))
    return result


def class_of(name: str) -> str | None:
    """Return the class of a limb, such as "leg" for "left leg 2"; None for a trunk, neck, ear or jaw."""
    return next((word for word in name.split() if word in CLASSES), None)


def folds(makers: Iterable[str]) -> dict[str, int]:
    """Return the fold of each maker: the makers with most characters first, each into the smallest fold."""
    sizes, found = [0] * FOLDS, dict[str, int]()
    for maker, count in sorted(Counter(makers).items(), key=lambda each: (-each[1], each[0])):
        found[maker] = sizes.index(min(sizes))
        sizes[found[maker]] += count
    return found


def bodies(folder: Path, only: Iterable[str] = ()) -> Iterator[tuple[dict[str, Any], CharacterMesh]]:
    """Yield the rows of the list whose files are in a folder, with their characters."""
    for line in BODIES.read_text(encoding="utf-8").splitlines():
        body = json.loads(line)
        path = folder / body["file"]
        if path.exists() and (not only or any(part in body["file"] for part in only)):
            if hashlib.sha256(path.read_bytes()).hexdigest() != body["sha256"]:
                raise SystemExit(f"{path} is another version than the one in {BODIES.name}")
            yield body, load_character(path)


def measure_ends(folder: Path, only: Iterable[str], finder: Finder = find) -> None:
    """Print each character that a finder finds wrong, and what it finds by view, fold and kind."""
    rows: list[tuple[str, str, str, Score]] = []
    for body, character in bodies(folder, only):
        for view, change in VIEWS.items():
            try:
                answer = finder(change(character))
            except PuppetlineError:
                answer = None
            one = score(body, character, answer)
            rows.append((view, body["maker"], body["kind"], one))
            if not one.right[0]:
                found = f"{dict(+one.found)} of {dict(+one.limbs)}, {one.proposed} proposed"
                stands = f"{answer.up} {answer.front}" if answer else "-"
                print(f"{view:8} {body['file']}: {stands}, {found}", flush=True)
    fold = folds(maker for view, maker, *_ in rows if view == "file")
    for view in VIEWS:
        print(f"\n{view:20}    number limbs false whole    up front")
        groups: dict[str, list[Score]] = {}
        for own, maker, kind, one in rows:
            for name in (f"fold {fold[maker]}", kind, maker, "all") if own == view else ():
                groups.setdefault(name, []).append(one)
        for name in sorted(groups.keys() - fold.keys()):
            print_total(name, groups[name])
        right = [np.mean([one.right[0] for one in groups[maker]]) for maker in fold]
        print(f"whole characters, mean over {len(fold)} makers: {100 * np.mean(right):.0f} %")
        print_calibration(np.array([stand for one in groups["all"] for stand in one.stands]))


def print_calibration(stands: NDArray[np.float64]) -> None:
    """Print how many characters stand as an answer says, by the probability that it states."""
    for low, high in pairwise(PROBABILITIES):
        inside = stands[(stands[:, 0] > low) & (stands[:, 0] <= high)]
        if len(inside):
            right = 100 * inside[:, 1:].all(axis=1).mean()
            print(f"stated {100 * low:.0f} to {100 * high:.0f} %: {right:.0f} % of {len(inside)} are right")


def print_total(title: str, scores: list[Score]) -> None:
    """Print the shares of limbs, whole characters and axes that are right, in a group of characters."""
    total = Score()
    for one in scores:
        total.add(one)
    limbs, found = total.limbs.total(), total.found.total()
    false, axes = 1 - found / max(total.proposed, 1), np.mean(total.stands, axis=0)[1:]
    shares = [found / limbs, false, np.mean(total.right), *axes]
    print(title.ljust(20), f"{len(scores):10d}", *(f"{100 * share:4.0f}%" for share in shares))


def measure_joints(folder: Path, names: Iterable[str], poses: int) -> None:
    """Print the distances of joints that are found from the shape."""
    print("character".ljust(32), *(name.rjust(9) for name in JOINTS), "   median")
    totals: dict[str, list[float]] = {}
    for title, mesh, truth in examples():
        totals.setdefault("people as made", []).extend(row(title, [errors(mesh, truth)]))
    for name in names:
        character = load_character(folder / f"{name}.glb")
        rig = rig_limbs(character)
        assert rig is not None
        kind = KINDS.get(name, "others")
        totals.setdefault(f"{kind} as made", []).extend(row(name, [errors(character.solver_mesh(), rig.limbs.points)]))
        measured = [errors(mesh, truth) for mesh, truth in posed(character, poses)]
        if measured:
            totals.setdefault(f"{kind} posed", []).extend(row(f"{name} posed", measured))
    for pose, away in totals.items():
        print(f"{pose}, {len(away)} joints: median {np.median(away):.1f} %, 95 % {np.quantile(away, 0.95):.1f} %")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("ends", "joints"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", default=())
    parser.add_argument("--poses", type=int, default=10)
    parser.add_argument("--characters", nargs="*", default=tuple(KINDS))
    options = parser.parse_args()
    if options.what == "ends":
        measure_ends(options.folder, options.only)
    else:
        measure_joints(options.folder, options.characters, options.poses)


if __name__ == "__main__":
    main()
