"""Corrections of arms for different proportions: they avoid a wide body, and hands meet as the performer's do."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.model.vectors import dot, in_axes, length, minus, scaled, unit
from solver.motion import quaternions as quat
from solver.motion.retarget import is_position
from solver.motion.two_bones import bend, carry_along, moved, place, pole

MEET_ARM_LENGTHS, APART_ARM_LENGTHS = 0.15, 0.4
"""Distances between a performer's hands, in arm lengths, below which the character's hands have the same distance, and
above which they are not corrected."""

MEET_SECONDS = 0.1
"""Time constant with which the correction eases in and out, in seconds."""

MAX_SHIFT_ARM_LENGTHS = 0.75
"""Largest correction of a hand's position, in lengths of the character's arm."""


@dataclass(frozen=True)
class Arm:
    """An arm of the character, and the hand of the performer that it follows.

    Attributes
    ----------
    upper, lower, last : int
        Bones: upper arm, forearm, and the last bone, which may be the forearm.
    joint : int
        The performer's joint at the tip.
    """

    upper: int
    lower: int
    last: int
    joint: int


class _Plan(NamedTuple):
    """Constants of the character and the performer."""

    arms: NDArray[np.int64]  # (2, 3): left and right; upper, lower and last bone
    joints: NDArray[np.int64]  # (2,)
    heads: NDArray[np.float64]  # (b, 3)
    tails: NDArray[np.float64]  # (b, 3)
    parents: NDArray[np.int64]  # (b,)
    poles: NDArray[np.float64]  # (2, 3)
    basis: NDArray[np.float64]  # (3, 3)
    performer_length: float  # of an arm, metres
    character_length: float  # of an arm, mesh units
    space: float  # radians
    meet: bool


class Arms:
    """Corrects the arms of a character whose proportions differ from the performer's.

    Parameters
    ----------
    bones : Bones
    left, right : Arm
    performer_length : float
        Length of the performer's arm from shoulder to wrist, in metres.
    basis : (3, 3) float64, optional
        Rows: the mesh file's directions of the character's left, up and forward.
    space : float
        Angle, in radians, by which a hanging arm is turned away from the body. It decreases to 0 for a level arm.
    meet : bool
        Whether the hands meet when the performer's do.
    """

    def __init__(
        self,
        bones: Bones,
        left: Arm,
        right: Arm,
        performer_length: float,
        basis: NDArray[np.float64] | None = None,
        *,
        space: float = 0.0,
        meet: bool = True,
    ) -> None:
        basis = np.eye(3) if basis is None else np.ascontiguousarray(basis, dtype=np.float64)
        arms: Sequence[Arm] = (left, right)
        elbows = -2 * basis[2] - basis[1]
        self._plan = _Plan(
            arms=np.array([(arm.upper, arm.lower, arm.last) for arm in arms], dtype=np.int64),
            joints=np.array([arm.joint for arm in arms], dtype=np.int64),
            heads=np.ascontiguousarray(bones.heads, dtype=np.float64),
            tails=np.ascontiguousarray(bones.tails, dtype=np.float64),
            parents=bones.parents,
            poles=np.array([pole(bones, arm.upper, arm.lower, elbows) for arm in arms]),
            basis=basis,
            performer_length=float(performer_length),
            character_length=float(np.mean([bones.lengths[[arm.upper, arm.lower]].sum() for arm in arms])),
            space=float(space),
            meet=bool(meet),
        )
        self._state = np.array([-np.inf, 0.0])  # time; weight with which the hands are drawn together

    def step(
        self,
        time: float,
        positions: NDArray[np.float64],
        confidence: NDArray[np.float32],
        motions: NDArray[np.float64],
        heading: float = 0.0,
    ) -> None:
        """Correct the arms of one frame.

        Parameters
        ----------
        time, positions, confidence
            As for `limb_motion.LimbMotion.step`.
        motions : (b, 4, 3) float64
            Motions of the bones, mesh file's coordinates; written to.
        heading : float
            Angle about the upright axis, in radians, by which the performer is turned and the character is not.
        """
        _step(self._plan, self._state, float(time), positions, confidence, motions, float(heading))


@compiled(waits=False)
def _step(plan, state, time, positions, confidence, motions, heading):
    """Update the state and the motions of a frame."""
    elapsed = max(0.0, time - state[0]) if math.isfinite(state[0]) else math.inf
    state[0] = time
    if plan.space != 0:
        for arm in range(2):
            _hold_away(plan, arm, motions)
    gap = _gap(plan, positions, confidence, heading)
    if plan.meet and math.isfinite(gap[0]):
        near = (APART_ARM_LENGTHS - length(gap) / plan.performer_length) / (APART_ARM_LENGTHS - MEET_ARM_LENGTHS)
        near = min(max(near, 0.0), 1.0)
        near *= near * (3 - 2 * near)
        state[1] = near + math.exp(-elapsed / MEET_SECONDS) * (state[1] - near)
        if state[1] > 1e-6:
            _draw_together(plan, state[1], gap, motions)


@compiled(inner=True)
def _hold_away(plan, arm, motions):
    """Turn an arm away from the body about its parent's forward axis, in proportion to its downward component."""
    upper = plan.arms[arm, 0]
    shoulder = moved(motions[upper], plan.heads[upper])
    along = unit(minus(moved(motions[upper], plan.tails[upper]), shoulder))
    turn = (1.0, 0.0, 0.0, 0.0)
    if plan.parents[upper] >= 0:
        turn = quat.of_rows(motions[plan.parents[upper]])
    down = quat.rotated(turn, scaled(plan.basis[1], -1.0))
    forward = quat.rotated(turn, plan.basis[2])
    angle = plan.space * max(0.0, dot(along, down)) * (1.0 if arm == 0 else -1.0)
    before, changed = motions.copy(), np.zeros(len(motions), dtype=np.bool_)
    turned = quat.product(quat.about(forward, angle), quat.of_rows(motions[upper]))
    place(motions[upper], turned, plan.heads[upper], shoulder)
    changed[upper] = True
    carry_along(motions, before, plan.parents, changed)


@compiled(inner=True)
def _gap(plan, positions, confidence, heading):
    """Return the vector from the performer's right to the left hand in metres, mesh file's axes; NaN if unknown."""
    left, right = plan.joints[0], plan.joints[1]
    gap = minus(positions[left], positions[right])
    if not (confidence[left] > 0 and confidence[right] > 0 and is_position(gap)):
        return (np.nan, np.nan, np.nan)
    c, s = math.cos(heading), math.sin(heading)
    return in_axes((c * gap[0] - s * gap[2], gap[1], s * gap[0] + c * gap[2]), plan.basis)


@compiled(inner=True)
def _draw_together(plan, share, gap, motions):
    """Move both hands by half of the difference to the performer's distance."""
    left, right = plan.arms[0, 2], plan.arms[1, 2]
    now = minus(moved(motions[left], plan.tails[left]), moved(motions[right], plan.tails[right]))
    scale = plan.character_length / plan.performer_length
    missing = minus(scaled(gap, scale), now)
    share *= 0.5 * min(1.0, 2 * MAX_SHIFT_ARM_LENGTHS * plan.character_length / max(length(missing), 1e-300))
    before, changed = motions.copy(), np.zeros(len(motions), dtype=np.bool_)
    for arm in range(2):
        upper, lower = plan.arms[arm, 0], plan.arms[arm, 1]
        shift = scaled(missing, share if arm == 0 else -share)
        if length(shift) > 1e-12 * plan.character_length:
            # the hand keeps its rotation, so its tip moves as the wrist does
            hand = lower + 1 if plan.arms[arm, 2] != lower else -1
            end = bend(motions, plan.heads, plan.tails, upper, lower, plan.poles[arm], shift)
            changed[upper] = changed[lower] = True
            if hand >= 0:
                place(motions[hand], quat.of_rows(motions[hand]), plan.heads[hand], end)
                changed[hand] = True
    carry_along(motions, before, plan.parents, changed)
