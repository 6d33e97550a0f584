"""Pre-computed constants of the motion of limbs, from a character's bones and a performer at rest."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.model.bones import Bones
from solver.model.vectors import perpendicular, unit
from solver.motion.limbs import TRUNK, Limb, Performer

BENT_SINES = 0.25, 0.6
"""Sines of the angle at elbow or knee above which its plane counts, and counts fully."""

SWING, SIDES, HINGE = 0, 1, 2
"""References of a bone's roll: the least rotation from rest, the sides of the body, the plane of elbow or knee."""


class Plan(NamedTuple):
    """Constants of the motion of limbs. Row 0 is the performer's torso, row i + 1 the character's bone i."""

    joints: NDArray[np.int64]  # (p, m): the joints of each point, padded with −1
    ends: NDArray[np.int64]  # (b + 1, 2): the points of each bone
    aims: NDArray[np.float64]  # (b + 1, 3): direction at rest; zero if unknown
    chords: NDArray[np.float64]  # (b + 1, 3): the same if the trunk's inner joints do not count
    sides: NDArray[np.float64]  # (b + 1, 3): direction that is compared with the roll's reference, at rest
    roll: NDArray[np.int64]  # (b + 1,): SWING, SIDES or HINGE
    hips: NDArray[np.float64]  # (b + 1,): weight of the hips in the sides of the body; the rest is the shoulders'
    base: NDArray[np.int64]  # (b + 1,): row to which each bone's rotation is relative, −1 for none
    shown_base: NDArray[np.int64]  # (b + 1,): the character's row to which it is applied
    gain: NDArray[np.float64]  # (b + 1,)
    oriented: NDArray[np.int64]  # (b + 1,): joint whose orientation determines the roll, −1 for none
    pitch: NDArray[np.float64]  # (b + 1,): angle in radians by which a foot's direction is raised
    foot: NDArray[np.bool_]  # (b + 1,): whether it is the foot of a leg
    trunk: NDArray[np.int64]  # (q,): points of the trunk, empty without a trunk
    trunk_rows: NDArray[np.int64]  # (q − 1,): its bones
    pairs: NDArray[np.int64]  # (2, 2): hips and shoulders, left and right
    opposite: NDArray[np.int64]  # (j,)
    heads: NDArray[np.float64]  # (b, 3): mesh file's coordinates
    parents: NDArray[np.int64]  # (b,)
    basis: NDArray[np.float64]  # (3, 3)
    turns: bool


class _Place(NamedTuple):
    """A limb's rows of the plan, and its points."""

    limb: Limb
    rows: NDArray[np.int64]
    points: NDArray[np.int64]


def plan_of(
    limbs: Sequence[Limb],
    bones: Bones,
    performer: Performer,
    rest: NDArray[np.float64],
    basis: NDArray[np.float64],
    turns: bool,
) -> Plan:
    """Compute the constants of the motion of limbs.

    Parameters
    ----------
    limbs : sequence of Limb
        In the order of `limbs.parents_first`.
    bones : Bones
        Of these limbs.
    performer : Performer
    rest : (j, 3) float64
    basis : (3, 3) float64
    turns : bool
    """
    places = _places(limbs)
    trunk = next((place for place in places if place.limb.name == TRUNK), None)
    count = len(bones.parents) + 1
    aims = _aims(places, bones, performer, rest, basis)
    chords, sides = aims.copy(), np.zeros((count, 3))
    roll, hips = np.full(count, SWING, dtype=np.int64), np.full(count, 0.5)
    sides[0], roll[0] = [1, 0, 0], SIDES
    if trunk is not None:
        rows = trunk.rows
        chords[rows] = aims[rows].sum(axis=0)
        roll[rows], hips[rows] = SIDES, np.linspace(1, 0, len(rows)) if len(rows) > 1 else 0.5
        own = trunk.limb.follow == "direction"
        across = _sides_at_rest(limbs, performer, basis) if own else _sides(rest, performer)
        sides[rows] = hips[rows, None] * across[0] + (1 - hips[rows, None]) * across[1]
    for row, forward in _hinges(places, performer):
        roll[row], sides[row] = HINGE, _hinge(aims[row], aims[row + 1], forward)
    aims = _units(aims)
    for swinging in np.flatnonzero(roll == SWING):
        sides[swinging] = perpendicular(tuple(aims[swinging]))
    base, shown_base = _bases(places, bones)
    none = np.zeros(0, dtype=np.int64)
    return Plan(
        joints=_joints(limbs),
        ends=np.array([(0, 0), *(pair for place in places for pair in pairwise(place.points))], dtype=np.int64),
        aims=aims,
        chords=_units(chords),
        sides=_units(sides),
        roll=roll,
        hips=hips,
        base=base,
        shown_base=shown_base,
        gain=np.array([1.0, *(place.limb.gain for place in places for _ in place.rows)]),
        oriented=np.array([-1, *(_oriented(place.limb, k) for place in places for k in range(len(place.rows)))]),
        pitch=_pitches(places, aims, performer, rest),
        foot=np.isin(np.arange(count), [place.rows[k] for place, k in _feet(places, performer)]),
        trunk=none if trunk is None else trunk.points,
        trunk_rows=none if trunk is None else trunk.rows,
        pairs=np.array([performer.hips, performer.shoulders], dtype=np.int64),
        opposite=np.ascontiguousarray(performer.opposite, dtype=np.int64),
        heads=np.ascontiguousarray(bones.heads),
        parents=bones.parents,
        basis=basis,
        turns=turns and trunk is not None,
    )


def _places(limbs: Sequence[Limb]) -> list[_Place]:
    """Return each limb's rows and points, one limb after another."""
    places, row, point = [], 1, 0
    for limb in limbs:
        k = len(limb.points)
        places.append(_Place(limb, np.arange(row, row + k - 1), np.arange(point, point + k)))
        row, point = row + k - 1, point + k
    return places


def _joints(limbs: Sequence[Limb]) -> NDArray[np.int64]:
    """Return the joints of each point (p, m), padded with −1."""
    chains = [joints for limb in limbs for joints in limb.joints]
    out = np.full((len(chains), max(map(len, chains), default=1)), -1, dtype=np.int64)
    for row, chain in zip(out, chains, strict=True):
        row[: len(chain)] = chain
    return out


def _aims(
    places: Sequence[_Place], bones: Bones, performer: Performer, rest: NDArray[np.float64], basis: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the directions (b + 1, 3) that are turned to those of the performer's bones; NaN if unknown.

    These are the character's bones at rest, or the performer's for a limb that follows by "turn": in character axes for
    a trunk, relative to the torso for other limbs.
    """
    torso = _torso(rest, performer)
    aims = np.vstack([[0.0, 1.0, 0.0], (bones.tails - bones.heads) @ basis.T])
    for limb, rows, _ in places:
        if limb.follow == "turn":
            where = np.array([rest[list(joints)].mean(axis=0) for joints in limb.joints])
            aims[rows] = np.diff(where, axis=0) @ (np.eye(3) if limb.name == TRUNK else torso)
    return aims


def _hinges(places: Sequence[_Place], performer: Performer) -> Iterator[tuple[int, float]]:
    """Iterate over upper arms and thighs: their rows, and 1 for arms, which bend forwards, or −1 for legs."""
    forward = dict.fromkeys([(joint,) for joint in performer.shoulders], 1.0)
    forward |= dict.fromkeys([(joint,) for joint in performer.hips], -1.0)
    for limb, rows, _ in places:
        if limb.follow == "direction":
            for row, joints in zip(rows[:-1], limb.joints, strict=False):
                if joints in forward:
                    yield int(row), forward[joints]


def _oriented(limb: Limb, bone: int) -> int:
    """Return the joint at which the performer's bone begins, or −1 for a bone whose roll follows the body's sides."""
    joints = limb.joints[bone]
    return joints[0] if len(joints) == 1 and limb.name != TRUNK else -1


def _pitches(
    places: Sequence[_Place], aims: NDArray[np.float64], performer: Performer, rest: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the pitch of the character's feet relative to the performer's at rest (b + 1,), radians.

    Sensors place the joint of a foot at other heights than meshes: Kinect v1's is nearly below the ankle.
    """
    pitches = np.zeros(len(aims))
    for (limb, rows, _), k in _feet(places, performer):
        if limb.follow == "direction":
            ankle, foot = (rest[list(joints)].mean(axis=0) for joints in limb.joints[k : k + 2])
            pitch = _elevation(aims[rows[k]]) - _elevation(foot - ankle)
            pitches[rows[k]] = pitch if np.isfinite(pitch) else 0.0
    return pitches


def _feet(places: Sequence[_Place], performer: Performer) -> Iterator[tuple[_Place, int]]:
    """Iterate over the feet, the third bones from a hip: their limb, and their index in it."""
    hips = {(joint,) for joint in performer.hips}
    for place in places:
        for k in range(2, len(place.rows)):
            if place.limb.joints[k - 2] in hips:
                yield place, k


def _elevation(direction: NDArray[np.float64]) -> float:
    """Return the angle of a direction over the horizontal, radians."""
    return float(np.arctan2(direction[1], np.hypot(direction[0], direction[2])))


def _bases(places: Sequence[_Place], bones: Bones) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows to which each bone's rotation is relative, and to which it is applied."""
    base, shown = np.full((2, len(bones.parents) + 1), -1, dtype=np.int64)
    trunk = {int(row) for limb, rows, _ in places if limb.name == TRUNK for row in rows}
    directed = {int(row) for limb, rows, _ in places if limb.follow == "direction" for row in rows}
    for limb, rows, _ in places:
        for row in rows:
            before = [ancestor + 1 for ancestor in _ancestors(int(row) - 1, bones.parents)]
            if limb.follow == "direction":
                base[row] = shown[row] = next((each for each in before if each in directed), -1)
            elif row > rows[0]:
                base[row] = shown[row] = row - 1
            else:
                base[row] = -1 if limb.name == TRUNK else 0
                shown[row] = next((each for each in before if each in trunk), -1)
    return base, shown


def _units(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the directions of (n, 3) vectors; zero for unknown ones and those without a direction."""
    return np.array([unit(tuple(vector)) for vector in np.nan_to_num(vectors)]).reshape(-1, 3)


def _ancestors(bone: int, parents: NDArray[np.int64]) -> list[int]:
    """Return the ancestors of a bone, its parent first."""
    found = []
    while parents[bone] >= 0:
        bone = int(parents[bone])
        found.append(bone)
    return found


def _sides(pose: NDArray[np.float64], performer: Performer) -> NDArray[np.float64]:
    """Return the directions (2, 3) from right to left of a performer's hips and shoulders."""
    left, right = np.array([performer.hips, performer.shoulders]).T
    return _units(pose[left] - pose[right])


def _sides_at_rest(limbs: Sequence[Limb], performer: Performer, basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the same directions of a character: between the roots of its legs and arms, or +x if it has none."""
    roots = {limb.joints[0]: limb.points[0] @ basis.T for limb in limbs}
    found = np.tile([1.0, 0.0, 0.0], (2, 1))
    for row, (left, right) in zip(found, (performer.hips, performer.shoulders), strict=True):
        if (left,) in roots and (right,) in roots:
            row[:] = unit(tuple(roots[(left,)] - roots[(right,)]))
    return found


def _torso(pose: NDArray[np.float64], performer: Performer) -> NDArray[np.float64]:
    """Return a performer's torso as (3, 3) columns left, up and forward; NaN if unknown."""
    hips, shoulders = pose[list(performer.hips)], pose[list(performer.shoulders)]
    with np.errstate(invalid="ignore"):
        up = shoulders.mean(axis=0) - hips.mean(axis=0)
        up = up / np.linalg.norm(up)
        left = _sides(pose, performer).sum(axis=0)
        left = left - (left @ up) * up
        left = left / np.linalg.norm(left)
    return np.column_stack([left, up, np.cross(left, up)])


def _hinge(upper: NDArray[np.float64], lower: NDArray[np.float64], forward: float) -> NDArray[np.float64]:
    """Return the axis (3,) about which an elbow (forward = 1) or knee (−1) bends, at rest.

    For a limb that is bent at rest, it is the normal of the limb's plane. A straight arm bends forwards, and upwards if
    it points forwards; a straight leg bends the other way.
    """
    upper, lower = _units(np.array([upper, lower]))
    axis: NDArray[np.float64] = np.cross(upper, lower)
    if np.linalg.norm(axis) > BENT_SINES[0]:
        return axis
    bends_to = np.array([0, 0, forward])
    return np.cross(upper, bends_to if abs(upper[2]) < 0.9 else np.array([0, forward * np.sign(upper[2]), 0]))
