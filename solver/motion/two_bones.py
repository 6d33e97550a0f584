"""Motions of bones, and inverse kinematics of an arm or leg: two bones bend to move an end to a target."""

import math

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.model.vectors import dot, in_axes, length, minus, plus, row_of, unit
from solver.motion import quaternions as quat

MAX_REACH_SHARE = 0.9995
"""Largest distance between the ends of a bent limb, as a share of its length."""

POLE_SHARE = 0.03
"""Smallest offset of the joint of a bent limb, and the offset of a straight one when it bends, as a share of its first
bone's length."""


def pole(bones: Bones, upper: int, lower: int, towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction in which the joint between two bones bends at rest, at a right angle to the limb.

    Parameters
    ----------
    bones : Bones
    upper, lower : int
    towards : (3,) float64
        Direction in which a straight limb bends.

    Returns
    -------
    (3,) float64
    """
    start, joint, end = bones.heads[upper], bones.tails[upper], bones.tails[lower]
    along = (end - start) / np.linalg.norm(end - start)
    bent = (joint - start) - ((joint - start) @ along) * along
    if np.linalg.norm(bent) < POLE_SHARE * np.linalg.norm(joint - start):
        bent = towards - (towards @ along) * along
    out: NDArray[np.float64] = bent / max(np.linalg.norm(bent), 1e-300)
    return out


@compiled(inner=True)
def moved(T, point):
    """Return the image of a point under a motion."""
    x, y, z = in_axes(point, T)
    return (x + T[3, 0], y + T[3, 1], z + T[3, 2])


@compiled(inner=True)
def bend(motions, heads, tails, upper, lower, pole, shift):
    """Move the end of the second of two bones within their reach, and return its new position.

    The limb turns by the least rotation, and its joint stays on the side to which it is bent.

    Parameters
    ----------
    motions : (b, 4, 3) float64
        Written to.
    heads, tails : (b, 3) float64
    upper, lower : int
    pole : (3,) float64
        From `pole`.
    shift : (3,)
    """
    start, joint, end = (
        moved(motions[upper], heads[upper]),
        moved(motions[upper], tails[upper]),
        moved(motions[lower], tails[lower]),
    )
    first, second = length(minus(joint, start)), length(minus(end, joint))
    was, there = minus(end, start), minus(plus(end, shift, 1.0), start)
    way = unit(there)
    # a limb that is straighter than that stays as straight as it is
    longest = max(MAX_REACH_SHARE * (first + second), length(was))
    reach = min(max(length(there), 1.001 * abs(first - second)), longest)
    side = _side(motions[upper], pole, minus(joint, start), unit(was))
    side = quat.rotated(quat.least(unit(was), way), side)
    along = (first * first - second * second + reach * reach) / (2 * reach)
    beside = math.sqrt(max(0.0, first * first - along * along))
    bent, now = plus(plus(start, way, along), side, beside), plus(start, way, reach)
    _aim(motions[upper], minus(joint, start), minus(bent, start), heads[upper], start)
    _aim(motions[lower], minus(end, joint), minus(now, bent), heads[lower], bent)
    return now


@compiled(inner=True)
def _side(T, rest, joint, way):
    """Return the direction in which a limb's joint bends, at a right angle to the way from its start to its end."""
    bent = plus(joint, in_axes(rest, T), POLE_SHARE * length(joint))
    return unit(plus(bent, way, -dot(bent, way)))


@compiled(inner=True)
def _aim(T, now, wanted, head, there):
    """Turn a motion by the least rotation from one direction to another, and move the bone's head to a position."""
    turn = quat.product(quat.least(unit(now), unit(wanted)), quat.of_rows(T))
    place(T, turn, head, there)


@compiled(inner=True)
def place(T, turn, head, there):
    """Write the motion that turns a bone and moves its head to a position."""
    quat.write_rows(turn, T)
    for axis in range(3):
        T[3, axis] = there[axis] - head[0] * T[0, axis] - head[1] * T[1, axis] - head[2] * T[2, axis]


@compiled(inner=True)
def carry_along(motions, before, parents, changed):
    """Apply the changes of bones to their descendants.

    Parameters
    ----------
    motions, before : (b, 4, 3) float64
        Motions now, written to, and before the change.
    parents : (b,) int64
    changed : (b,) bool
        Bones whose motions have changed; written to.
    """
    for bone in range(len(motions)):
        parent = parents[bone]
        if parent >= 0 and changed[parent] and not changed[bone]:
            _carry(before[parent], motions[parent], motions[bone])
            changed[bone] = True


@compiled(inner=True)
def move_along(motions, before, heads, parents):
    """Move bones so that their heads stay on their parents, whose motions have changed; no bone turns.

    Parameters
    ----------
    motions, before : (b, 4, 3) float64
        Motions now, written to, and before the change.
    heads : (b, 3) float64
    parents : (b,) int64
    """
    for bone in range(len(motions)):
        parent = parents[bone]
        if parent >= 0:
            was, now = moved(before[parent], heads[bone]), moved(motions[parent], heads[bone])
            for axis in range(3):
                motions[bone, 3, axis] += now[axis] - was[axis]


@compiled(inner=True)
def _carry(before, after, T):
    """Apply the change of a parent's motion: T becomes T before⁻¹ after."""
    for i in range(4):
        v = (T[i, 0], T[i, 1], T[i, 2])
        if i == 3:
            v = minus(v, row_of(before, 3))
        for axis in range(3):
            turned = 0.0
            for k in range(3):
                turned += (v[0] * before[k, 0] + v[1] * before[k, 1] + v[2] * before[k, 2]) * after[k, axis]
            T[i, axis] = turned + (after[3, axis] if i == 3 else 0.0)
