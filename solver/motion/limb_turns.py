"""Rotations of a character's bones relative to their bases: swing to a direction, then roll about it."""

import math

from puppetline.compiled import compiled
from solver.model.vectors import MIN_LENGTH, cross, dot, length, row_of, scaled, unit, write_row
from solver.motion import quaternions as quat
from solver.motion.limb_directions import smooth_step
from solver.motion.limb_plan import BENT_SINES, HINGE, SIDES
from solver.motion.retarget import RETURN_SECONDS

MAX_TURN_RATE = 25.0
"""Largest angular speed of a limb relative to its base, in radians per second; a thrower's forearm reaches about 40."""

MAX_FOOT_RADIANS = 0.9
"""Largest rotation of a foot from rest relative to its shin, in radians; the joint of a foot is a sensor's noisiest."""

FOOT_SECONDS = 0.05
"""Time constant with which a foot follows the performer's, in seconds; the foot starts from the rest pose."""

HINGE_RATE = 20.0
"""Rate, per second, with which the roll of an upper arm or thigh follows the plane of a bent limb."""

ORIENTATION_RATE = 30.0
"""Rate, per second, with which a roll follows that of the performer's bone if its orientation is known."""

ORIENTATION_COSINES = 0.5, 0.8
"""Cosines of the angle between the direction of a bone and that of its orientation above which the orientation counts,
and counts fully."""

SWING_RATE = 20.0
"""Rate, per second, with which a roll follows that of the least rotation from rest."""

STRAIGHT_RATE = 0.5
"""The same rate for an upper arm or thigh, which nearly keeps its roll while the limb is straight."""


@compiled(inner=True)
def turn_bone(plan, state, row, from_base, aims, directions, across, turned, elapsed, began):
    """Update a bone's rotation relative to its base, and return it."""
    aim, direction = row_of(aims, row), row_of(directions, row)
    local = quat.row_of(state.local, row)
    known = dot(aim, aim) > 0.5 and dot(direction, direction) > 0.5
    fading = math.exp(-elapsed / RETURN_SECONDS)
    if known:
        wanted = quat.rotated(from_base, direction)
        if plan.foot[row]:
            wanted = _eased_foot(aim, quat.rotated(local, aim), wanted, elapsed if began else 0.0)
        local = _swing(state, row, local, aim, wanted, fading, elapsed, began)
        if math.isfinite(turned[row, 0] + state.mount[row, 0]):
            local = _rolled_as_performer(plan, state, row, local, from_base, aim, turned, elapsed)
        else:
            local = _rolled(plan, state, row, local, from_base, aims, directions, across, fading, elapsed, began)
        local = quat.normalised(local)
        quat.write_row(state.local, row, local)
    state.known[row] = 1.0 if known else 0.0
    return local


@compiled(inner=True)
def _eased_foot(aim, now, wanted, elapsed):
    """Return the next direction of a foot on its way to the wanted one, within `MAX_FOOT_RADIANS` of its rest."""
    away = length(quat.to_vector(quat.least(aim, wanted)))
    wanted = _turned_by_share(aim, wanted, min(1.0, MAX_FOOT_RADIANS / max(away, MIN_LENGTH)))
    return _turned_by_share(now, wanted, 1 - math.exp(-elapsed / FOOT_SECONDS))


@compiled(inner=True)
def _turned_by_share(start, end, share):
    """Return a direction turned by a share of the least rotation to another."""
    way = quat.to_vector(quat.least(start, end))
    return unit(quat.rotated(quat.from_vector(scaled(way, share)), start))


@compiled(inner=True)
def _swing(state, row, local, aim, wanted, fading, elapsed, began):
    """Turn a bone by the least rotation towards the wanted direction, at most at `MAX_TURN_RATE`."""
    now = quat.rotated(local, aim)
    gap = (0.0, 0.0, 0.0)
    if began:
        gap = scaled(row_of(state.gap, row), fading)
        if state.known[row] == 0:
            gap = quat.to_vector(quat.least(wanted, now))
        wanted = quat.rotated(quat.from_vector(gap), wanted)
    write_row(state.gap, row, gap)
    turn = quat.to_vector(quat.least(now, wanted))
    angle = length(turn)
    if angle > MAX_TURN_RATE * elapsed:
        turn = scaled(turn, MAX_TURN_RATE * elapsed / angle)
    return quat.product(quat.from_vector(turn), local)


@compiled(inner=True)
def _rolled(plan, state, row, local, from_base, aims, directions, across, fading, elapsed, began):
    """Roll a bone about itself towards the roll that follows from the pose."""
    aim, side = row_of(aims, row), row_of(plan.sides, row)
    axis, now = quat.rotated(local, aim), quat.rotated(local, side)
    if plan.roll[row] == SIDES:
        wanted = quat.rotated(from_base, row_of(across, row))
        flat = cross(axis, wanted)
        known = length(flat) > 0.2
        angle, gap = 0.0, 0.0
        if known:
            angle = quat.twist(now, wanted, axis)
            if began:
                gap = state.roll_gap[row] * fading if state.roll_known[row] > 0 else -angle
        state.roll_gap[row], state.roll_known[row] = gap, 1.0 if known else 0.0
        angle = (angle + gap + math.pi) % (2 * math.pi) - math.pi
    else:
        # the roll of the least rotation from rest, which is undefined if that is half a turn
        swing = quat.rotated(quat.least(aim, axis), side)
        error = quat.twist(now, swing, axis)
        weight = STRAIGHT_RATE if plan.roll[row] == HINGE else SWING_RATE
        weight *= (1 + dot(aim, axis)) / 2
        x, y = weight * math.cos(error), weight * math.sin(error)
        if plan.roll[row] == HINGE:
            hinge = cross(row_of(directions, row), row_of(directions, row + 1))
            bent = HINGE_RATE * smooth_step(length(hinge), BENT_SINES)
            if bent > 0:
                error = quat.twist(now, quat.rotated(from_base, hinge), axis)
                if began:
                    bent *= (1 + math.cos(error)) / 2  # the opposite roll is an error of the sensor
                x, y, weight = x + bent * math.cos(error), y + bent * math.sin(error), weight + bent
        share = 1 - math.exp(-weight * elapsed) if began else 1.0
        angle = share * math.atan2(y, x) if weight > 0 else 0.0
    largest = MAX_TURN_RATE * elapsed
    return quat.product(quat.about(axis, min(max(angle, -largest), largest)), local)


@compiled(inner=True)
def _rolled_as_performer(plan, state, row, local, from_base, aim, turned, elapsed):
    """Roll a bone about itself as the performer's bone has rolled."""
    there = quat.product(from_base, quat.product(quat.row_of(turned, row), quat.row_of(state.mount, row)))
    axis, side = quat.rotated(local, aim), row_of(plan.sides, row)
    weight = ORIENTATION_RATE * smooth_step(dot(axis, quat.rotated(there, aim)), ORIENTATION_COSINES)
    angle = quat.twist(quat.rotated(local, side), quat.rotated(there, side), axis)
    angle *= 1 - math.exp(-weight * elapsed) if weight > 0 else 0.0  # after a cut, `elapsed` is infinite
    largest = MAX_TURN_RATE * elapsed
    return quat.product(quat.about(axis, min(max(angle, -largest), largest)), local)
