"""Limbs: chains of bones inside a character that follow chains of a performer's joints."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.model.bones import Bones

Follow = Literal["direction", "turn"]

TRUNK = "trunk"
"""Name of the limb whose roll follows the performer's hips and shoulders; the default parent of other limbs."""


@dataclass(frozen=True, eq=False)
class Limb:
    """A chain of bones inside a character that follows a chain of the performer's joints.

    Attributes
    ----------
    name : str
        `TRUNK` for the limb whose roll follows hips and shoulders.
    points : (k, 3) float64
        Root to tip, mesh file's coordinates; k ≥ 2, so k − 1 bones.
    joints : (k,) of tuple of int
        The performer's joints, a tuple for each point, whose joints are averaged.
    follow : {"direction", "turn"}
    gain : float
        Factor of the angle by which each bone turns from rest relative to its parent.
    parent : str or None
        Name of the parent limb.
    stands : bool
        Whether the limb is a leg that stands on the floor and steps (`solver.motion.steps`).
    delay : float
        Time, in seconds, by which the limb's tip follows the bone that carries it (`solver.motion.late_limbs`).
    """

    name: str
    points: NDArray[np.float64]
    joints: tuple[tuple[int, ...], ...]
    follow: Follow = "direction"
    gain: float = 1.0
    parent: str | None = None
    stands: bool = False
    delay: float = 0.0


@dataclass(frozen=True, eq=False)
class Performer:
    """The performer's joints from which the sides of the body follow.

    Attributes
    ----------
    hips, shoulders : (int, int)
        The left and the right joint.
    opposite : (j,) int64
        Each joint's counterpart on the other side.
    """

    hips: tuple[int, int]
    shoulders: tuple[int, int]
    opposite: NDArray[np.int64]


def parents_first(limbs: Sequence[Limb]) -> list[Limb]:
    """Sort limbs so that each comes after its parent.

    Raises
    ------
    ValueError
        A parent is missing, or there is a cycle of parents.
    """
    ordered: list[Limb] = []
    waiting = list(limbs)
    while waiting:
        placed = {limb.name for limb in ordered}
        ready = [limb for limb in waiting if limb.parent is None or limb.parent in placed]
        if not ready:
            raise ValueError(
                f"found limbs without a root: {[limb.name for limb in waiting]}; expected no cycle of parents"
            )
        ordered += ready
        waiting = [limb for limb in waiting if limb not in ready]
    return ordered


def bone_ranges(limbs: Sequence[Limb]) -> dict[str, range]:
    """Return the numbers of each limb's bones by its name, in the order of `parents_first`."""
    ranges: dict[str, range] = {}
    end = 0
    for limb in parents_first(limbs):
        ranges[limb.name] = range(end, end := end + len(limb.points) - 1)
    return ranges


def bones_of(limbs: Sequence[Limb], up: ArrayLike = (0.0, 1.0, 0.0)) -> Bones:
    """Return the bones of limbs, in the order of `parents_first`, each limb from root to tip.

    The parent of a limb's first bone is the bone of the parent limb nearest to the limb's first point.

    Parameters
    ----------
    limbs : sequence of Limb
    up : (3,) float64, optional
        Unit vector away from the ground, for the soles of feet.

    Returns
    -------
    Bones
    """
    heads: list[NDArray[np.float64]] = []
    tails: list[NDArray[np.float64]] = []
    parents: list[int] = []
    numbers: list[int] = []
    feet: list[int] = []
    bases = {limb.parent for limb in limbs} & {limb.name for limb in limbs if limb.parent is None}
    first: dict[str, int] = {}
    count: dict[str, int] = {}
    for number, limb in enumerate(parents_first(limbs)):
        first[limb.name], count[limb.name] = len(heads), len(limb.points) - 1
        on = -1
        if limb.parent is not None:
            start = first[limb.parent]
            candidates = range(start, start + count[limb.parent])
            on = min(candidates, key=lambda bone: distance_from_segment(limb.points[0], heads[bone], tails[bone]))
        for head, tail in zip(limb.points[:-1], limb.points[1:], strict=True):
            parents.append(on)
            numbers.append(-1 if limb.name in bases else number)
            on = len(heads)
            heads.append(head)
            tails.append(tail)
        if limb.stands and len(limb.points) > 2:
            feet.append(on)
    return Bones(
        np.array(heads, dtype=np.float64).reshape(-1, 3),
        np.array(tails, dtype=np.float64).reshape(-1, 3),
        np.array(parents, dtype=np.int64),
        np.array(numbers, dtype=np.int64),
        np.array(feet, dtype=np.int64),
        np.asarray(up, dtype=np.float64),
    )


def distance_from_segment(point: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]) -> float:
    """Return the distance of a point from a segment."""
    along = end - start
    share = min(max(float((point - start) @ along) / max(float(along @ along), 1e-300), 0.0), 1.0)
    return float(np.linalg.norm(point - start - share * along))
