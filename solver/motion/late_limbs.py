"""Tails, ears and antennae that follow late: each bone is a critically damped spring to where it would turn.

Springs are softer towards the tip of a limb, so a tail curves when the body turns, and swings on when it stops. Between
two frames the aim is constant and the spring is solved exactly, so it is stable at any frame rate.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.model.vectors import cross, minus, plus, row_of, scaled, write_row
from solver.motion import quaternions as quat
from solver.motion.limbs import Limb
from solver.motion.two_bones import carry_along, moved, place

MAX_SPEED = 20.0
"""Largest angular speed of a bone, in radians per second."""


class _Plan(NamedTuple):
    """Constants of the bones that follow late, in the order of the bones."""

    bones: NDArray[np.int64]  # (k,)
    rates: NDArray[np.float64]  # (k,): of the springs, 1 / s
    lengths: NDArray[np.float64]  # (k,): from the root of the limb to the bone's tail
    heads: NDArray[np.float64]  # (b, 3)
    tails: NDArray[np.float64]  # (b, 3)
    parents: NDArray[np.int64]  # (b,)


class _State(NamedTuple):
    """The state between frames."""

    turn: NDArray[np.float64]  # (k, 4): rotation from rest
    speed: NDArray[np.float64]  # (k, 3): angular velocity
    base: NDArray[np.float64]  # (k, 2, 3): position and velocity of the bone's head
    clock: NDArray[np.float64]  # (1,)


class LateLimbs:
    """Lets the limbs of a character that have a delay follow late.

    Parameters
    ----------
    limbs : sequence of Limb
        In the order of `limbs.parents_first`.
    bones : Bones
        Of these limbs.
    """

    def __init__(self, limbs: Sequence[Limb], bones: Bones) -> None:
        numbers: list[int] = []
        rates: list[float] = []
        lengths: list[float] = []
        first = 0
        for limb in limbs:
            count = len(limb.points) - 1
            if limb.delay > 0:
                numbers += range(first, first + count)
                # a critically damped spring of rate r follows a steady motion 2 / r seconds late
                rates += [2 * count / (limb.delay * (k + 1)) for k in range(count)]
                lengths += list(np.cumsum(bones.lengths[first : first + count]))
            first += count
        count = len(numbers)
        heads, tails = (np.ascontiguousarray(each) for each in (bones.heads, bones.tails))
        self._plan = _Plan(
            np.array(numbers, dtype=np.int64), np.array(rates), np.array(lengths), heads, tails, bones.parents
        )
        self._state = _State(np.zeros((count, 4)), np.zeros((count, 3)), np.zeros((count, 2, 3)), np.array([-np.inf]))

    def step(self, time: float, motions: NDArray[np.float64], root: NDArray[np.float64]) -> None:
        """Delay the limbs in one frame.

        Parameters
        ----------
        time : float
            Seconds, increasing from call to call.
        motions : (b, 4, 3) float64
            Motions without the root's; written to.
        root : (3,) float64
            Translation of the whole character.
        """
        if len(self._plan.bones):
            _step(self._plan, self._state, float(time), motions, root)


@compiled(waits=False)
def _step(plan, state, time, motions, root):
    """Update the state, and the motions of a frame."""
    began = math.isfinite(state.clock[0])
    elapsed = max(0.0, time - state.clock[0]) if began else math.inf
    state.clock[0] = time
    changed, before = np.zeros(len(motions), dtype=np.bool_), motions.copy()
    for k in range(len(plan.bones)):
        bone = plan.bones[k]
        parent, head = plan.parents[bone], row_of(plan.heads, bone)
        there = moved(motions[parent], head) if parent >= 0 else moved(motions[bone], head)
        aim = quat.of_rows(motions[bone])
        turn = _follow(plan, state, k, aim, plus(there, root, 1.0), elapsed, began)
        place(motions[bone], turn, head, there)
        changed[bone] = True
    carry_along(motions, before, plan.parents, changed)


@compiled(inner=True)
def _follow(plan, state, k, aim, base, elapsed, began):
    """Return the rotation of a bone, which is drawn to an aim and swings against the acceleration of its base."""
    if not began:
        quat.write_row(state.turn, k, aim)
        write_row(state.base[k], 0, base)
        return aim
    if elapsed <= 0:
        return quat.row_of(state.turn, k)
    bone, rate, decay = plan.bones[k], plan.rates[k], math.exp(-plan.rates[k] * elapsed)
    before = state.base[k]
    velocity = scaled(minus(base, row_of(before, 0)), 1 / elapsed)
    kick = minus(row_of(before, 1), velocity)
    write_row(before, 0, base)
    write_row(before, 1, velocity)
    turn = quat.row_of(state.turn, k)
    way = quat.rotated(turn, minus(row_of(plan.tails, bone), row_of(plan.heads, bone)))
    size = math.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    speed = plus(row_of(state.speed, k), cross(way, kick), 1 / (size * plan.lengths[k]))
    quick = math.sqrt(speed[0] ** 2 + speed[1] ** 2 + speed[2] ** 2)
    if quick > MAX_SPEED:
        speed = scaled(speed, MAX_SPEED / quick)
    away = quat.to_vector(quat.product(turn, quat.inverse(aim)))
    pull = plus(speed, away, rate)
    write_row(state.speed, k, scaled(plus(speed, pull, -rate * elapsed), decay))
    left = scaled(plus(away, pull, elapsed), decay)
    turn = quat.product(quat.from_vector(left), aim)
    quat.write_row(state.turn, k, turn)
    return turn
