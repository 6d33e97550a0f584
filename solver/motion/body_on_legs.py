"""Lean, crouch and height of a body that stands on legs (`solver.motion.steps`).

A body on several pairs of legs leans and twists little: its neck and head do what the performer's back does. If the
performer crouches, such a body sits: its hind legs fold more than its front legs. If both front legs are lifted, it
rears. Then the body sinks until every leg that stands reaches its foot.
"""

import math

from puppetline.compiled import compiled
from solver.model.vectors import dot, length, minus, plus, row_of, scaled
from solver.motion import quaternions as quat
from solver.motion.limb_directions import smooth_step
from solver.motion.resting_feet import FLOOR, LIFT, remaining
from solver.motion.retarget import is_position
from solver.motion.step_plan import CROUCH, DROP, HEADING, JUMP, PITCH, REARING, SINKING
from solver.motion.two_bones import move_along, moved, place

MAX_REACH = 0.985
"""Largest distance between hip and ankle of a leg that stands, as a share of its length, unless it is straighter at
rest."""

MAX_DROP = 0.3
"""Largest way by which a body sinks for its legs to reach their feet, in leg lengths."""

MAX_RISE = 0.3
"""Largest way by which a body rises for its legs not to fold more than they can, in leg lengths."""

SINK_SECONDS, RETURN_SECONDS = 0.05, 0.3
"""Time constants of the critically damped spring with which a body goes there and returns, in seconds. A walk swings
less if it returns slowly."""

AHEAD_SECONDS = 0.08
"""Time by which the place of the body is predicted for this, in seconds: about what the spring is late."""

SLACK = 0.015
"""Largest way by which the spring may be behind, in leg lengths."""

STANDING_HEIGHT = 0.9
"""Height of the performer's hips over the ankles, as a share of the length of the legs, below which the performer
crouches."""

MAX_CROUCH = 0.45
"""Largest crouch, as a share of the height of the hips."""

JUMP_CROUCH = 0.1
"""Crouch from which the performer does not jump, though the sensor loses the feet."""

FRONT_CROUCH = 0.25
"""Share of a crouch by which the front of a body sinks that sits."""

MAX_SITTING_PITCH, REARING_PITCH = math.radians(40), math.radians(36)
"""Largest pitch of a body that sits, and that of one that rears, in radians."""

REARED = 0.03
"""Share of that pitch from which a body does not sink for its front legs."""

POSE_SECONDS = 0.15
"""Time constant of crouch and pitch, in seconds."""

PITCH_SHARE = 0.5
"""Share of the body's pitch that neck, wings and tail follow."""


@compiled(inner=True)
def pose_body(plan, state, positions, confidence, motions, root, elapsed):
    """Lean, pitch and lower the body, and return its pitch as a rotation.

    Parameters
    ----------
    plan, state
        From `step_plan`.
    positions, confidence
        The performer's joints.
    motions : (b, 4, 3) float64
        Written to.
    root : (3,) float64
        Written to: its height is set.
    elapsed : float
        Seconds.
    """
    body, up = state.body, row_of(plan.axes, 1)
    fading = remaining(POSE_SECONDS, elapsed)
    crouch = _crouch(plan, state, positions, confidence)
    body[CROUCH] = crouch + fading * (body[CROUCH] - crouch)
    sunk = min(body[CROUCH] * plan.leg_length, plan.depth)
    rearing = _rearing(plan, state)
    body[REARING] = rearing + fading * (body[REARING] - rearing)
    body[PITCH] = REARING_PITCH * body[REARING]
    if plan.span > 0:
        body[PITCH] += min(math.asin(min((1 - FRONT_CROUCH) * sunk / plan.span, 1.0)), MAX_SITTING_PITCH)
    across = quat.rotated(quat.about(up, body[HEADING]), row_of(plan.axes, 0))
    pitch = quat.about(across, -body[PITCH])
    _turn_trunk(plan, state, motions, pitch)
    # the feet take the body's height: at rest, plus a jump, less a crouch and what the legs do not reach
    body[JUMP] = state.watch.clock[LIFT] * max(0.0, 1 - body[CROUCH] / JUMP_CROUCH)
    height = body[JUMP] - sunk
    level = dot(root, up)
    for axis in range(3):
        root[axis] += (height - level) * up[axis]
    _ease_drop(
        plan, state, _drop(plan, state, motions, root, 0.0), _drop(plan, state, motions, root, AHEAD_SECONDS), elapsed
    )
    for axis in range(3):
        root[axis] -= body[DROP] * up[axis]
    return pitch


@compiled(inner=True)
def _crouch(plan, state, positions, confidence):
    """Return how far the performer's hips are below those of a person who stands, as a share of that height."""
    left, right = plan.performers_hips
    floor = state.watch.clock[FLOOR]
    known = confidence[left] > 0 and confidence[right] > 0 and math.isfinite(floor)
    if not (known and is_position(positions[left]) and is_position(positions[right])):
        return state.body[CROUCH]
    lowest = min(state.watch.last[0, 1], state.watch.last[1, 1])
    height = (positions[left, 1] + positions[right, 1]) / 2 - (lowest if lowest > floor else floor)
    return min(max(1 - height / (STANDING_HEIGHT * plan.performers_leg), 0.0), MAX_CROUCH)


@compiled(inner=True)
def _rearing(plan, state):
    """Return the share with which all front legs are lifted."""
    share, count = 1.0, 0
    for leg in range(len(plan.feet)):
        if plan.front[leg]:
            share *= smooth_step(state.lift[leg, 1], (0.0, 1.0))
            count += 1
    return share if count > 1 else 0.0


@compiled(inner=True)
def _turn_trunk(plan, state, motions, pitch):
    """Limit the turns of the trunk's bones and pitch them.

    A tail moves with the trunk. Neck and wings keep what the performer's back does, and follow a share of the pitch.
    """
    if len(plan.trunk) == 0:
        return
    before, stand = motions.copy(), quat.about(row_of(plan.axes, 1), state.body[HEADING])
    shared = quat.from_vector(scaled(quat.to_vector(pitch), PITCH_SHARE))
    of_rear = (1.0, 0.0, 0.0, 0.0)
    trunk = 0
    for bone in range(len(motions)):
        turn = quat.of_rows(before[bone])
        if trunk < len(plan.trunk) and plan.trunk[trunk] == bone:
            now = quat.product(pitch, _near_stand(turn, stand, plan.max_turn))
            if trunk == 0:
                of_rear = quat.product(now, quat.inverse(turn))
            trunk += 1
        else:
            now = quat.product(of_rear if plan.behind[bone] else shared, turn)
        place(motions[bone], now, plan.heads[bone], moved(before[bone], plan.heads[bone]))
    move_along(motions, before, plan.heads, plan.parents)


@compiled(inner=True)
def _near_stand(turn, stand, most):
    """Return a rotation whose way from how the body stands levels off towards an angle."""
    way = quat.to_vector(quat.product(turn, quat.inverse(stand)))
    angle = length(way)
    if angle < 1e-9:
        return turn
    return quat.product(quat.from_vector(scaled(way, most * math.tanh(angle / most) / angle)), stand)


@compiled(inner=True)
def _drop(plan, state, motions, root, ahead):
    """Return how far the body must sink until each leg that will stand soon reaches its foot, and how far it can sink.

    A body must not fold a leg further than it can be folded; it rises, by a negative way, if one is.
    """
    up, jump, needed, room = row_of(plan.axes, 1), state.body[JUMP], 0.0, MAX_DROP * plan.leg_length
    for leg in range(len(plan.feet)):
        carrier, hip = plan.carriers[leg], row_of(plan.hips, leg)
        rest = length(minus(hip, plan.ankles[leg]))
        if carrier >= 0:
            hip = moved(motions[carrier], hip)
        away = minus(plus(hip, root, 1.0), plus(row_of(state.place, leg), up, jump))
        flat = dot(away, away) - dot(away, up) ** 2
        high = dot(away, up) + dot(minus(row_of(state.place, leg), row_of(plan.ankles, leg)), up)  # over the floor
        share = state.swing[leg]
        if share > 0:
            share = min(share + ahead / state.seconds[leg], 1.0)
        else:
            away = plus(away, state.velocity, ahead)
            flat = dot(away, away) - dot(away, up) ** 2
        weight = math.cos(math.pi * share) ** 2 * (1 - smooth_step(state.lift[leg, 1], (0.0, 1.0)))
        if plan.front[leg]:  # a body that has reared does not drop to its front feet
            weight *= 1 - smooth_step(state.body[REARING], (0.0, REARED))
        longest = max(MAX_REACH * plan.chains.reach[leg], rest)
        shortest = min(plan.chains.shortest[leg], rest)
        needed = max(needed, weight * (high - math.sqrt(max(0.0, longest * longest - flat))))
        folds = high - math.sqrt(max(0.0, shortest * shortest - flat))
        room = min(room, folds)  # of a leg in the air, too: its foot must not sink into the floor
    room = max(room, -MAX_RISE * plan.leg_length)
    return min(needed, room), room


@compiled(inner=True)
def _ease_drop(plan, state, now, soon, elapsed):
    """Move the body's drop towards the one that will be needed soon, and between the limits of now."""
    body = state.body
    if not elapsed < math.inf:
        body[DROP], body[SINKING] = now[0], 0.0
        return
    rate = 1 / (SINK_SECONDS if abs(soon[0]) > abs(body[DROP]) else RETURN_SECONDS)
    away, decay = body[DROP] - soon[0], math.exp(-rate * elapsed)
    pull = body[SINKING] + rate * away
    body[DROP] = soon[0] + (away + pull * elapsed) * decay
    body[SINKING] = (body[SINKING] - rate * pull * elapsed) * decay
    slack = SLACK * plan.leg_length
    least = now[0] - slack if now[0] > 0 else -math.inf
    body[DROP] = min(max(body[DROP], least), now[1] + slack)
