"""Two bones that bend to take the end of the second one to a place: inverse kinematics of an arm or leg."""

import math

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.motion import quaternions as quat

MAX_REACH_SHARE = 0.9995
"""Share of a limb's length to which it is straightened at most."""

POLE_SHARE = 0.03
"""How much a straight limb leans to the side it bends to, as a share of its first bone's length."""


def pole(bones: Bones, upper: int, lower: int, towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the joint between two bones bends to at rest, a direction at a right angle to the limb.

    Parameters
    ----------
    bones : Bones
    upper, lower : int
    towards : (3,) float64
        Where a straight limb bends to.

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
def length(v):
    """Return the length of a vector."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@compiled(inner=True)
def moved(T, point):
    """Return where a motion takes a point."""
    x, y, z = point[0], point[1], point[2]
    return (
        x * T[0, 0] + y * T[1, 0] + z * T[2, 0] + T[3, 0],
        x * T[0, 1] + y * T[1, 1] + z * T[2, 1] + T[3, 1],
        x * T[0, 2] + y * T[1, 2] + z * T[2, 2] + T[3, 2],
    )


@compiled(inner=True)
def minus(a, b):
    """Return the difference of two vectors."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled(inner=True)
def plus(a, b, share):
    """Return a vector and a share of another."""
    return (a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2])


@compiled(inner=True)
def bend(motions, heads, tails, upper, lower, pole, shift):
    """Move the end of the second of two bones, as far as they reach, and return where it is now.

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
    way = quat.unit(there)
    # no farther than it reaches, nor than it did: a straight limb that is where it should be stays straight
    farthest = max(MAX_REACH_SHARE * (first + second), length(was))
    reach = min(max(length(there), 1.001 * abs(first - second)), farthest)
    side = _side(motions[upper], pole, minus(joint, start), quat.unit(was))
    side = quat.rotated(quat.least(quat.unit(was), way), side)
    along = (first * first - second * second + reach * reach) / (2 * reach)
    beside = math.sqrt(max(0.0, first * first - along * along))
    bent, now = plus(plus(start, way, along), side, beside), plus(start, way, reach)
    _aim(motions[upper], minus(joint, start), minus(bent, start), heads[upper], start)
    _aim(motions[lower], minus(end, joint), minus(now, bent), heads[lower], bent)
    return now


@compiled(inner=True)
def _side(T, rest, joint, way):
    """Return where a limb's joint bends to, at a right angle to the way from its start to its end."""
    pole = (
        rest[0] * T[0, 0] + rest[1] * T[1, 0] + rest[2] * T[2, 0],
        rest[0] * T[0, 1] + rest[1] * T[1, 1] + rest[2] * T[2, 1],
        rest[0] * T[0, 2] + rest[1] * T[1, 2] + rest[2] * T[2, 2],
    )
    bent = plus(joint, pole, POLE_SHARE * length(joint))
    return quat.unit(plus(bent, way, -quat.dot(bent, way)))


@compiled(inner=True)
def _aim(T, now, wanted, head, there):
    """Turn a motion by the least rotation from one direction to another, and take the bone's head to a place."""
    turn = quat.product(quat.least(quat.unit(now), quat.unit(wanted)), quat.of_rows(T))
    place(T, turn, head, there)


@compiled(inner=True)
def place(T, turn, head, there):
    """Write the motion that turns a bone and takes its head to a place."""
    quat.write_rows(turn, T)
    for axis in range(3):
        T[3, axis] = there[axis] - head[0] * T[0, axis] - head[1] * T[1, axis] - head[2] * T[2, axis]


@compiled(inner=True)
def carry_along(motions, before, parents, changed):
    """Take along what hangs on bones that have changed.

    Parameters
    ----------
    motions, before : (b, 4, 3) float64
        Now, written to, and before the change.
    parents : (b,) int64
    changed : (b,) bool
        Bones that are as they should be; written to.
    """
    for bone in range(len(motions)):
        parent = parents[bone]
        if parent >= 0 and changed[parent] and not changed[bone]:
            _carry(before[parent], motions[parent], motions[bone])
            changed[bone] = True


@compiled(inner=True)
def _carry(before, after, T):
    """Take a motion along with another one that has changed: T becomes T before⁻¹ after."""
    rows = np.empty((4, 3))
    for i in range(4):
        v = (T[i, 0], T[i, 1], T[i, 2])
        if i == 3:
            v = minus(v, before[3])
        for axis in range(3):
            turned = 0.0
            for k in range(3):
                turned += (v[0] * before[k, 0] + v[1] * before[k, 1] + v[2] * before[k, 2]) * after[k, axis]
            rows[i, axis] = turned + (after[3, axis] if i == 3 else 0.0)
    T[:] = rows
