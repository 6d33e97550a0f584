"""Tails, wings and necks that would pass through the floor are lifted until they lie on it.

A limb that turns with the performer's body knows nothing of the floor: a long tail swings down when the body rears or
turns. Each of its bones is lifted about its head by the least angle with which the surface around its tail is not below
the floor, or not lower than at rest if it is below the floor there. The next bone keeps its own direction, so a long
limb lies along the floor.
"""

import math
from collections.abc import Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.model.vectors import cross, dot, in_axes, length, minus, plus, row_of, unit
from solver.motion import quaternions as quat
from solver.motion.limbs import TRUNK, Limb, bone_ranges
from solver.motion.two_bones import carry_along, moved, place

OUTER_HALF = 0.5
"""Place along a bone, as a share of its length, from which the bone lifts its surface. The surface before it is lifted
by the bone before, since a turn about a head hardly lifts what is near it."""

REST_WEIGHT = 0.25
"""Weight of the axis about which a bone is lifted at rest, carried along, beside that of its direction now: one that
hangs straight down has no other."""

MAX_LIFT = math.radians(80)
"""Largest angle by which a bone is lifted, in radians."""


class _Plan(NamedTuple):
    """Constants of the bones that are kept over the floor, in the order of the bones."""

    bones: NDArray[np.int64]  # (k,)
    starts: NDArray[np.int64]  # (k + 1,): where each bone's points begin
    points: NDArray[np.float64]  # (p, 3): of their surfaces, at rest
    heights: NDArray[np.float64]  # (p,): least height of each point
    heads: NDArray[np.float64]  # (b, 3)
    tails: NDArray[np.float64]  # (b, 3)
    parents: NDArray[np.int64]  # (b,)
    axes: NDArray[np.float64]  # (b, 3): about which each bone is lifted at rest
    up: NDArray[np.float64]  # (3,)


class Floor:
    """Keeps limbs that turn with the body, and do not stand, over the floor.

    Parameters
    ----------
    limbs : sequence of Limb
    bones : Bones
        Of these limbs.
    vertices : (n, 3) float64
        The character at rest, whose lowest vertex is on the floor.
    owner : (n,) int64
        Bone of each vertex; −1 for none.
    basis : (3, 3) float64
        Rows: the mesh file's directions of the character's left, up and forward.
    """

    def __init__(
        self,
        limbs: Sequence[Limb],
        bones: Bones,
        vertices: NDArray[np.float64],
        owner: NDArray[np.int64],
        basis: NDArray[np.float64],
    ) -> None:
        ranges, up = bone_ranges(limbs), np.ascontiguousarray(basis[1])
        kept = [limb for limb in limbs if limb.follow == "turn" and not limb.stands and limb.name != TRUNK]
        numbers = sorted(bone for limb in kept for bone in ranges[limb.name])
        lifts = np.full(len(owner), -1)
        for limb in kept:
            for before, bone in pairwise((-1, *ranges[limb.name])):
                own, way = owner == bone, bones.tails[bone] - bones.heads[bone]
                outer = (vertices - bones.heads[bone]) @ way >= OUTER_HALF * (way @ way)
                lifts[own] = np.where(outer[own], bone, before)
        points = [np.vstack([_outermost(vertices[lifts == bone]), bones.tails[bone]]) for bone in numbers]
        together = np.concatenate(points) if points else np.zeros((0, 3))
        self._plan = _Plan(
            bones=np.array(numbers, dtype=np.int64),
            starts=np.cumsum([0, *map(len, points)]),
            points=together,
            heights=np.minimum(together @ up, (vertices @ up).min()),
            heads=np.ascontiguousarray(bones.heads),
            tails=np.ascontiguousarray(bones.tails),
            parents=bones.parents,
            axes=_lifting_axes(bones.tails - bones.heads, basis),
            up=up,
        )

    def step(self, motions: NDArray[np.float64], root: NDArray[np.float64]) -> None:
        """Lift the limbs of one frame.

        Parameters
        ----------
        motions : (b, 4, 3) float64
            Motions without the root's; written to.
        root : (3,) float64
            Translation of the whole character.
        """
        if len(self._plan.bones):
            _step(self._plan, motions, root)


def _outermost(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the outermost of points (n, 3) in 26 directions."""
    directions = np.array([each for each in product((-1, 0, 1), repeat=3) if any(each)])
    return points[np.unique((points @ directions.T).argmax(axis=0))] if len(points) else points


def _lifting_axes(ways: NDArray[np.float64], basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the level unit vectors (b, 3) about which bones at rest (b, 3) turn upwards.

    An upright bone has no such axis. It turns about the body's left side, so that its tail rises behind the body.
    """
    axes = np.cross(ways, basis[1])
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    level = lengths > 1e-6 * np.linalg.norm(ways, axis=1, keepdims=True)
    chosen: NDArray[np.float64] = np.where(level, axes / np.where(level, lengths, 1), basis[0])
    return chosen


@compiled(waits=False)
def _step(plan, motions, root):
    """Update the motions of a frame."""
    changed, before = np.zeros(len(motions), dtype=np.bool_), motions.copy()
    level = dot(root, plan.up)
    for k in range(len(plan.bones)):
        bone = plan.bones[k]
        parent, head = plan.parents[bone], row_of(plan.heads, bone)
        lifted = parent >= 0 and changed[parent]
        there = moved(motions[parent], head) if lifted else moved(motions[bone], head)
        turn = quat.of_rows(motions[bone])
        if lifted:
            place(motions[bone], turn, head, there)
            changed[bone] = True
        axis = _axis(plan, motions[bone], bone)
        angle = 0.0
        for point in range(plan.starts[k], plan.starts[k + 1]):
            way = minus(moved(motions[bone], row_of(plan.points, point)), there)
            needed = plan.heights[point] - level - dot(there, plan.up)
            angle = max(angle, _lift(dot(way, plan.up), dot(cross(axis, way), plan.up), needed))
        if angle > 0:
            place(motions[bone], quat.product(quat.about(axis, min(angle, MAX_LIFT)), turn), head, there)
            changed[bone] = True
    carry_along(motions, before, plan.parents, changed)


@compiled(inner=True)
def _axis(plan, T, bone):
    """Return the level unit vector about which a bone is lifted."""
    way = minus(moved(T, row_of(plan.tails, bone)), moved(T, row_of(plan.heads, bone)))
    at_rest = in_axes(row_of(plan.axes, bone), T)
    axis = plus(cross(way, plan.up), at_rest, REST_WEIGHT * length(way))
    return unit(plus(axis, plan.up, -dot(axis, plan.up)))


@compiled(inner=True)
def _lift(high, beside, needed):
    """Return the least angle by which a point is turned to be `needed` high, or as high as a turn lifts it.

    Turned by an angle, its height over the axis is high · cos + beside · sin.
    """
    radius = math.sqrt(high * high + beside * beside)
    if high >= needed or radius == 0:
        return 0.0
    return math.asin(min(needed / radius, 1.0)) - math.atan2(high, beside)
