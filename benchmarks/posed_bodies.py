"""Characters with skeletons in random poses: examples for `benchmarks.part_fitting`.

The limbs that `puppetline new` reads from a file's skeleton are turned and resized, and the character follows them by
its own skin. Some are made plump, as toys are, whose limbs touch the body, and some hold or wear things.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.limb_finding import turn
from benchmarks.things import things
from engine_bridge.character.character import CharacterMesh, load_character
from engine_bridge.puppet.limb_nodes import node_labels
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.rig_limbs import rig_limbs
from engine_bridge.puppet.skin_joints import vertex_influences
from solver.anatomy.limb_chain import evenly
from solver.anatomy.orientation import spread
from solver.anatomy.part_network import PARTS
from solver.anatomy.solid import Solid, fill
from solver.anatomy.voted_limbs import MIRROR
from solver.motion.limbs import TRUNK, Bones, Limb, bones_of, parents_first
from solver.surface.mesh import SolverMesh

SAMPLES = 10_000
"""Number of surface points of which the nearest one says which limb a cell belongs to."""

REST_SHARE, ALIKE_SHARE, PLUMP_SHARE = 0.25, 0.6, 0.25
"""Shares of bodies in their file's pose, of those whose left and right limbs move alike, and of plump ones."""

LEFT, UP, FRONT = np.eye(3)

Points = NDArray[np.float64]
Example = tuple[Points, Points, NDArray[np.int64], list[tuple[int, Points]]]
"""Cells, depths, limb of each cell, part and joints of each limb."""


def part_of(limb: str) -> int:
    """Return the number of the part that a limb belongs to; ears and jaw belong to the head."""
    words = limb.split()
    own = next((word for word in words if word in PARTS), "head")
    return PARTS.index(own)


def four(limb: str, points: Points) -> Points:
    """Return four joints of a limb; hocks are left out."""
    if limb.endswith("arm") or "leg" in limb.split():
        return points[[0, 1, -2, -1]] if len(points) > 3 else evenly(points, 4)
    return evenly(points, 4)


def posed(path: Path, count: int) -> Iterator[Example]:
    """Yield a character in its pose and then in random ones, which are the same every time; its axes are its own."""
    character = load_character(path)
    rig = rig_limbs(character)
    if rig is None or not rig.limbs.chains:
        return
    body = rig.bodies[0][1]
    basis = np.array([np.cross(body.up, body.front), body.up, body.front])
    chains = [chain for chain in rig.limbs.chains if chain.name != "jaw" and not chain.name.endswith("ear")]
    neck = "neck" if any(chain.name == "neck" for chain in chains) else TRUNK
    parents = {TRUNK: None, "head": neck}
    limbs = parents_first(
        [Limb(c.name, c.points, ((),) * len(c.points), parent=parents.get(c.name, TRUNK)) for c in chains]
    )
    numbers = {label: number for number, label in enumerate(node_labels(character.document))}
    nodes = {chain.name: [numbers[label] for label in chain.nodes] for chain in chains if chain.nodes}
    shares = _shares(character, limbs, nodes)
    mesh, rng = character.solver_mesh(), np.random.default_rng(zlib.crc32(path.name.encode()))
    for number in range(count):
        yield _example(mesh, limbs, shares, basis, rng if number else None)


def _shares(character: CharacterMesh, limbs: Sequence[Limb], nodes: dict[str, list[int]]) -> Points:
    """Return the share (n, b) of each bone in the motion of each vertex; what follows none follows the first."""
    which, share = vertex_influences(character)
    own = rig_bones(character, limbs, nodes).of_nodes(character).argmax(axis=1)[which]
    found = np.zeros((len(which), len(bones_of(list(limbs)))))
    for column in range(which.shape[1]):
        np.add.at(found, (np.arange(len(which)), own[:, column]), share[:, column])
    mesh = character.solver_mesh()
    shown = found[cKDTree(character.vertices).query(mesh.vertices)[1]]  # some solver vertices move no render vertex
    shown[shown.sum(axis=1) == 0, 0] = 1.0
    return np.asarray(shown / shown.sum(axis=1, keepdims=True))


def _example(
    mesh: SolverMesh, limbs: Sequence[Limb], shares: Points, basis: Points, rng: np.random.Generator | None
) -> Example:
    bones = bones_of(list(limbs))
    names = [(limb.name, number) for limb in limbs for number in range(len(limb.points) - 1)]
    heads, tails = bones.heads @ basis.T, bones.tails @ basis.T
    motions = _motions(names, replace(bones, heads=heads, tails=tails), rng)
    stretch = np.ones(3) if rng is None else np.exp(rng.normal(0, [0.12, 0.1, 0.12]))
    vertices = np.column_stack([mesh.vertices @ basis.T, np.ones(len(mesh.vertices))])
    vertices = np.einsum("nr,nb,brc->nc", vertices, shares, motions, optimize=True) * stretch
    parts = []
    for limb in limbs:
        first = names.index((limb.name, 0))
        ends = [np.append(heads[first], 1) @ motions[first]]
        ends += [np.append(tails[bone], 1) @ motions[bone] for bone in range(first, first + len(limb.points) - 1)]
        parts.append((part_of(limb.name), four(limb.name, np.array(ends) * stretch)))
    faces, limb_of_face = mesh.faces, _limb_of_faces(mesh, limbs, shares, names)
    components = mesh.components
    for limb, corners, triangles in () if rng is None else things(parts, rng):
        components = np.append(components, np.full(len(corners), components.max() + 1, components.dtype))
        faces = np.concatenate([faces, triangles + len(vertices)])
        vertices = np.concatenate([vertices, corners])
        limb_of_face = np.append(limb_of_face, np.full(len(triangles), limb))
    solid = fill(vertices, faces, components)
    if rng is not None and rng.random() < PLUMP_SHARE:
        solid = _plump(solid, rng.uniform(0.006, 0.03) * float(np.ptp(vertices, axis=0).max()))
    points, face = spread(vertices[faces], SAMPLES)
    return solid.centers, solid.depth, limb_of_face[face[cKDTree(points).query(solid.centers)[1]]], parts


def _limb_of_faces(
    mesh: SolverMesh, limbs: Sequence[Limb], shares: Points, names: Sequence[tuple[str, int]]
) -> NDArray[np.int64]:
    """Return the number of the limb whose bone moves each triangle most."""
    of_bone = np.array([[limb.name for limb in limbs].index(name) for name, _ in names])
    return np.asarray(of_bone[shares[mesh.faces].mean(axis=1).argmax(axis=1)])


def _plump(solid: Solid, by: float) -> Solid:
    """Return a solid that has grown in all directions."""
    low, more = solid.centers.min(axis=0), int(np.ceil(by / solid.size)) + 1
    cells = np.rint((solid.centers - low) / solid.size).astype(int) + more
    grid = np.zeros(cells.max(axis=0) + more + 1, dtype=bool)
    grid[tuple(cells.T)] = True
    inside = ndimage.binary_fill_holes(ndimage.distance_transform_edt(~grid) * solid.size < by)
    depth = (ndimage.distance_transform_edt(inside) - 0.5) * solid.size
    return Solid(solid.size, low + (np.argwhere(inside) - more) * solid.size, depth[inside])


def _motions(names: Sequence[tuple[str, int]], bones: Bones, rng: np.random.Generator | None) -> Points:
    """Return the motions of bones (b, 4, 3), for row vectors [x 1]; none without a generator."""
    moved, turns = np.zeros((len(names), 4, 3)), list[Rotation]()
    pose = None if rng is None or rng.random() < REST_SHARE else _Pose(rng, {name for name, _ in names})
    sizes = {} if rng is None else _sizes({_pair_of(name) for name, _ in names}, rng)
    for bone, (name, number) in enumerate(names):
        parent, start = int(bones.parents[bone]), bones.heads[bone]
        own = pose.turn(name, number, bones.tails[bone] - start) if pose else Rotation.identity()
        turns.append((turns[parent] if parent >= 0 else Rotation.identity()) * own)
        there = start if parent < 0 else np.append(start, 1.0) @ moved[parent]
        moved[bone, :3] = turns[-1].as_matrix().T * sizes.get(_pair_of(name), 1.0)
        moved[bone, 3] = there - start @ moved[bone, :3]
    return moved


def _pair_of(limb: str) -> str:
    """Return a limb's name without its side."""
    return limb.removeprefix("left ").removeprefix("right ")


def _sizes(pairs: set[str], rng: np.random.Generator) -> dict[str, float]:
    """Return random factors on the sizes of limbs, the same on both sides; the trunk keeps its own."""
    factors = np.exp(np.clip(rng.normal(0, 0.22, len(pairs)), -0.5, 0.5)) ** (rng.random(len(pairs)) < 0.7)
    return dict(zip(sorted(pairs), factors.tolist(), strict=True)) | {TRUNK: 1.0}


class _Pose:
    """Random turns of limbs; those of both sides are often alike."""

    def __init__(self, rng: np.random.Generator, limbs: set[str]) -> None:
        alike, seeds = rng.random() < ALIKE_SHARE, dict[str, int]()
        for limb in sorted(limbs):
            seeds[limb] = seeds.setdefault(_pair_of(limb), int(rng.integers(1 << 30)))
            if not alike:
                seeds[limb] = int(rng.integers(1 << 30))
        self._own = {limb: np.random.default_rng(seeds[limb]) for limb in limbs}
        self._upright = "left leg" in limbs
        self._sits = bool(rng.random() < 0.1)

    def turn(self, limb: str, number: int, way: Points) -> Rotation:
        """Return the turn of a limb's bone relative to the one before; the left and right ones are mirror images."""
        if not way.any():
            return Rotation.identity()
        image = np.diag(MIRROR if limb.startswith("right ") else np.ones(3))
        own = self._left(PARTS[part_of(limb)], number, image @ way, self._own[limb])
        return Rotation.from_matrix(image @ own.as_matrix() @ image)

    def _left(self, part: str, number: int, way: Points, rng: np.random.Generator) -> Rotation:
        if part == "arm":
            return self._arm(number, way, rng)
        if part == "leg":
            return self._leg(number, rng)
        if part == "wing" and number == 0:
            if rng.random() < 0.35:  # folded
                return turn(UP, rng.uniform(20, 80)) * turn(FRONT, rng.uniform(-60, 60))
            return turn(FRONT, rng.uniform(-40, 45)) * turn(UP, rng.uniform(-25, 30))
        spread = {"trunk": (8, 6, 5), "head": (14, 12, 0), "tail": (18, 18, 0), "wing": (9, 9, 9)}[part]
        angles = rng.normal(0, spread)
        return turn(LEFT, angles[0]) * turn(UP, angles[1]) * turn(FRONT, angles[2])

    def _arm(self, number: int, way: Points, rng: np.random.Generator) -> Rotation:
        if number == 0:
            ranges = [((50, 88), (-30, 60)), ((-15, 40), (-15, 30)), ((-70, 80), (-40, 95)), None]
            chosen = ranges[rng.choice(4, p=[0.4, 0.2, 0.25, 0.15])]
            if chosen is None:
                return Rotation.identity()
            below, ahead = (np.radians(rng.uniform(*each)) for each in chosen)
            aim = np.array([np.cos(below) * np.cos(ahead), -np.sin(below), np.cos(below) * np.sin(ahead)])
            return Rotation.align_vectors(aim[None], way[None] / np.linalg.norm(way))[0]
        if number == 1 and rng.random() < 0.6:
            towards = np.array([rng.uniform(-1, 0.3), rng.uniform(-0.5, 1), rng.uniform(0.2, 1)])
            return turn(np.cross(way, towards), rng.uniform(0, 110))
        return turn(rng.normal(size=3), rng.normal(0, 15))

    def _leg(self, number: int, rng: np.random.Generator) -> Rotation:
        if not self._upright:
            swing = rng.uniform(-22, 22) if number == 0 else rng.normal(0, 12)
            return turn(LEFT, swing) * turn(FRONT, rng.uniform(-6, 10) if number == 0 else 0.0)
        if number == 0 and self._sits:
            return turn(-LEFT, rng.uniform(60, 100)) * turn(UP, rng.uniform(0, 25))
        if number == 0:
            return turn(FRONT, rng.uniform(-3, 14)) * turn(LEFT, rng.uniform(-30, 30))
        if number == 1:
            return turn(LEFT, rng.uniform(60, 100) if self._sits else rng.uniform(0, 50) * (rng.random() < 0.5))
        return turn(LEFT, rng.normal(0, 6))
