"""Legs that a performer's hands lift: a paw waves, a spider threatens (`solver.motion.steps`).

A hand that is raised for a moment lifts its leg, which then follows the performer's arm. The leg returns to the floor
when the hand is lowered. While the body walks, the hand must be raised further, because arms swing.
"""

import math

from puppetline.compiled import compiled
from solver.model.vectors import dot, length, row_of, scaled
from solver.motion import quaternions as quat
from solver.motion.gait import WALKS
from solver.motion.retarget import is_position
from solver.motion.step_plan import HEADING, REARING
from solver.motion.two_bones import moved, place

LIFT_RAISE, LOWER_RAISE = 0.3, 0.18
"""Heights of a hand over where it hangs, in arm lengths, above which it lifts a leg and below which it lowers it."""

WALKING_RAISE = 0.35
"""Height that is added to these while the body walks, in arm lengths."""

RAISED_SECONDS = 0.1
"""Time for which a hand must be raised, in seconds."""

GESTURE_SECONDS = 0.35
"""Time in which a leg begins or ends to follow an arm, in seconds."""

LANDING_SHARE = 0.3
"""Share of a gesture that remains until a body that reared has come down."""

CAME_DOWN = 0.03
"""Share of rearing below which a body has come down."""

MAX_TURN = math.radians(72)
"""Angle towards which the turn of a lifted bone relative to the one before it levels off, in radians."""

OVERHEAD = math.radians(120)
"""Angle of an arm from hanging, in radians, above which a leg rises to the front, although the arm may be a little
behind the head."""

HALVINGS = 6
"""Number of steps with which the share is found at which a leg is above the floor."""


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
        if state.lift[leg, 1] > 0 and state.body[REARING] > CAME_DOWN:
            goal = max(goal, min(LANDING_SHARE, state.body[REARING]))
        state.lift[leg, 1] += min(max(goal - state.lift[leg, 1], -most), most)


@compiled(inner=True)
def apply_gesture(plan, state, leg, free, pitch, motions, floor):
    """Turn the bones of a lifted leg towards the performer's arm, as far as the leg is lifted and above the floor.

    Parameters
    ----------
    free : (b, 4, 3) float64
        Motions that follow the performer.
    pitch : quaternion
        Of the body.
    motions : (b, 4, 3) float64
        Motions of a leg that stands; written to.
    floor : float
        Height of the floor, without the root's motion, over that at rest.
    """
    share = state.lift[leg, 1]
    if share == 0:
        return
    share = share * share * (3 - 2 * share)
    stood = motions.copy()
    across = quat.rotated(quat.about(row_of(plan.axes, 1), state.body[HEADING]), row_of(plan.axes, 0))
    if _blend(plan, leg, free, pitch, across, stood, motions, share) >= floor:
        return
    low = 0.0
    for _ in range(HALVINGS):
        middle = (low + share) / 2
        if _blend(plan, leg, free, pitch, across, stood, motions, middle) >= floor:
            low = middle
        else:
            share = middle
    _blend(plan, leg, free, pitch, across, stood, motions, low)


@compiled(inner=True)
def _blend(plan, leg, free, pitch, across, stood, motions, share):
    """Write the motions between those of a leg that stands and of a free one; return its lowest rise from rest."""
    up, count = row_of(plan.axes, 1), plan.chains.bones.shape[1]
    first = plan.chains.bones[leg, 0]
    joint = moved(stood[first], row_of(plan.heads, first))
    turned = before_free = before_stood = pitch
    lowest = math.inf
    for k in range(count + 1):
        bone = plan.feet[leg] if k == count else plan.chains.bones[leg, k]
        if bone < 0:
            continue
        of_stood = quat.of_rows(stood[bone])
        of_free = quat.product(pitch, quat.of_rows(free[bone]))
        # relative to the body and to the bone before, so that angles stay small
        own = quat.product(quat.inverse(before_free), of_free)
        there = quat.product(quat.inverse(before_stood), of_stood)
        before_free, before_stood = of_free, of_stood
        way = quat.to_vector(quat.product(own, quat.inverse(there)))
        angle = length(way)
        if k == 0 and angle > OVERHEAD and dot(way, across) > 0:
            way, angle = scaled(way, 1 - 2 * math.pi / angle), 2 * math.pi - angle
        if angle > 1e-9:
            way = scaled(way, share * MAX_TURN * math.tanh(angle / MAX_TURN) / angle)
        turned = quat.product(turned, quat.product(quat.from_vector(way), there))
        place(motions[bone], turned, row_of(plan.heads, bone), joint)
        tail = row_of(plan.tails, bone)
        joint = moved(motions[bone], tail)
        if k >= 1:
            lowest = min(lowest, dot(joint, up) - min(dot(tail, up), plan.ground[leg]))
    return lowest
