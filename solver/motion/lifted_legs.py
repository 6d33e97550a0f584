"""Legs that a performer's hands lift: a paw waves, a spider threatens (`solver.motion.steps`).

A hand that is raised for a moment lifts its leg, which then follows the performer's arm. The leg returns to the floor
when the hand is lowered. While the body walks, the hand must be raised further, because arms swing.
"""

import math

from puppetline.compiled import compiled
from solver.model.vectors import length, row_of, scaled
from solver.motion import quaternions as quat
from solver.motion.gait import WALKS
from solver.motion.retarget import is_position
from solver.motion.two_bones import moved, place

LIFT_RAISE, LOWER_RAISE = 0.3, 0.18
"""Heights of a hand over where it hangs, in arm lengths, above which it lifts a leg and below which it lowers it."""

WALKING_RAISE = 0.35
"""Height that is added to these while the body walks, in arm lengths."""

RAISED_SECONDS = 0.1
"""Time for which a hand must be raised, in seconds."""

GESTURE_SECONDS = 0.35
"""Time in which a leg begins or ends to follow an arm, in seconds."""

MAX_TURN = math.radians(85)
"""Angle towards which the turn of a lifted bone relative to the one before it levels off, in radians."""


@compiled(inner=True)
def watch_hands(plan, state, positions, confidence, elapsed):
    """Update which legs are lifted."""
    if not elapsed < math.inf:
        return
    for leg in range(len(plan.feet)):
        hand, shoulder = plan.hands[leg], plan.shoulders[leg]
        if hand < 0:
            continue
        raised = 0.0
        if confidence[hand] > 0 and confidence[shoulder] > 0 and is_position(positions[hand]):
            hanging = positions[shoulder, 1] - plan.performers_arm
            raised = (positions[hand, 1] - hanging) / plan.performers_arm
        walking = WALKING_RAISE if state.gait[WALKS] > 0 else 0.0
        lifted = state.lift[leg, 0] > RAISED_SECONDS
        if raised > walking + (LOWER_RAISE if lifted else LIFT_RAISE):
            state.lift[leg, 0] += elapsed
        else:
            state.lift[leg, 0] = 0.0
        goal = 1.0 if state.lift[leg, 0] > RAISED_SECONDS else 0.0
        most = elapsed / GESTURE_SECONDS
        state.lift[leg, 1] += min(max(goal - state.lift[leg, 1], -most), most)


@compiled(inner=True)
def apply_gesture(plan, state, leg, free, pitch, motions):
    """Turn the bones of a lifted leg towards the performer's arm, as far as the leg is lifted.

    Parameters
    ----------
    free : (b, 4, 3) float64
        Motions that follow the performer.
    pitch : quaternion
        Of the body.
    motions : (b, 4, 3) float64
        Motions of a leg that stands; written to.
    """
    share = state.lift[leg, 1]
    if share == 0:
        return
    share = share * share * (3 - 2 * share)
    turned, stood = (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    joint = moved(motions[plan.chains.bones[leg, 0]], row_of(plan.heads, plan.chains.bones[leg, 0]))
    before_free = before_stood = (1.0, 0.0, 0.0, 0.0)
    for k in range(plan.chains.bones.shape[1] + 1):
        bone = plan.feet[leg] if k == plan.chains.bones.shape[1] else plan.chains.bones[leg, k]
        if bone < 0:
            continue
        stood = quat.of_rows(motions[bone])
        follows = quat.product(pitch, quat.of_rows(free[bone]))
        # relative to the bone before, so that angles stay small
        own = quat.product(quat.inverse(before_free), follows)
        there = quat.product(quat.inverse(before_stood), stood)
        before_free, before_stood = follows, stood
        way = quat.to_vector(quat.product(own, quat.inverse(there)))
        angle = length(way)
        if angle > 1e-9:
            way = scaled(way, share * MAX_TURN * math.tanh(angle / MAX_TURN) / angle)
        turned = quat.product(turned, quat.product(quat.from_vector(way), there))
        head, tail = row_of(plan.heads, bone), _tail(plan, leg, k, bone)
        place(motions[bone], turned, head, joint)
        joint = moved(motions[bone], tail)


@compiled(inner=True)
def _tail(plan, leg, k, bone):
    """Return the end of a bone at rest."""
    if k == plan.chains.bones.shape[1]:
        return row_of(plan.heads, bone)
    head = row_of(plan.heads, bone)
    return (
        head[0] + plan.chains.ways[leg, k, 0],
        head[1] + plan.chains.ways[leg, k, 1],
        head[2] + plan.chains.ways[leg, k, 2],
    )
