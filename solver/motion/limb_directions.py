"""Directions and sides of a performer's bones in one frame, with exchanged left and right corrected."""

import math

import numpy as np

from puppetline.compiled import compiled
from solver.model.vectors import MIN_LENGTH, between, blend, dot, length, minus, plus, row_of, unit, write_row
from solver.motion import quaternions as quat
from solver.motion.limb_plan import SIDES
from solver.motion.retarget import is_position

INNER_JOINT_SHARES = 0.15, 0.35
"""Distances of a joint within the trunk from the trunk's ends, as shares of its length, above which it counts, and
counts fully. The spine joint of Kinect v1 is 7 cm above the hips and a few centimetres behind them; its direction is
not that of the back."""

MIN_WIDTH_SHARES = 0.12, 0.25
"""Widths of hips and of shoulders, as shares of the trunk's length, below which left and right are unknown."""

EXCHANGED_COSINE = -0.5
"""Cosine of the angle, 120°, beyond which a sudden turn of the body means that the sensor has exchanged its sides."""

STEADY_SECONDS = 0.1
"""Time constant, in seconds, of the mean direction with which the sides of a body are compared."""

MIN_STEADY_LENGTH = 0.75
"""Smallest length of that mean at which it is a heading and not noise; a turn at 8 rad/s has 0.78."""

MAX_EXCHANGE_SECONDS = 0.25
"""Longest time between two frames, in seconds, in which such a turn is sudden."""

EXCHANGED_SECONDS = 1.5
"""Time, in seconds, for which an exchange of left and right is undone; then the sensor's sides are used again."""

TIME, SIDE_TIME, EXCHANGED, SINCE, HEADING = range(5)
"""Entries of the state's clock."""


@compiled(inner=True)
def observed(plan, state, time, positions, confidence, orientations):
    """Measure the performer's bones in a frame.

    Returns
    -------
    directions : (rows, 3)
        Zero if unknown.
    weight : float
        Of the trunk's inner joints.
    sides : (rows, 3)
        Directions from right to left that rolls follow; zero if none.
    turned : (rows, 4)
        Orientations that rolls follow; NaN if none.
    """
    seen, rows = _tracked_joints(plan, state, time, positions, confidence), len(plan.roll)
    _remove_heading(plan, state, seen)
    directions, weight = _directions(plan, seen, rows)
    return directions, weight, _sides(plan, seen, rows), _orientations(plan, state, orientations, rows)


@compiled(inner=True)
def smooth_step(value, limits):
    """Return 0 below the first limit, 1 above the second, and a smooth step between."""
    share = min(max((value - limits[0]) / (limits[1] - limits[0]), 0.0), 1.0)
    return share * share * (3 - 2 * share)


@compiled(inner=True)
def _torso(pairs, seen):
    """Return the vector from the middle of the hips to the middle of the shoulders."""
    hips = plus(row_of(seen, pairs[0, 0]), row_of(seen, pairs[0, 1]), 1.0)
    shoulders = plus(row_of(seen, pairs[1, 0]), row_of(seen, pairs[1, 1]), 1.0)
    up = minus(shoulders, hips)
    return (up[0] / 2, up[1] / 2, up[2] / 2)


@compiled(inner=True)
def _hips_and_shoulders(pairs, seen):
    """Return the directions from right to left of hips and shoulders; zero if unknown."""
    trunk = length(_torso(pairs, seen))
    hips = between(seen, pairs[0, 1], pairs[0, 0])
    shoulders = between(seen, pairs[1, 1], pairs[1, 0])
    # comparisons with NaN are false, so unknown joints count as too narrow
    if not (length(hips) > MIN_LENGTH and not length(hips) < MIN_WIDTH_SHARES[0] * trunk):
        hips = (0.0, 0.0, 0.0)
    if not (length(shoulders) > MIN_LENGTH and not length(shoulders) < MIN_WIDTH_SHARES[1] * trunk):
        shoulders = (0.0, 0.0, 0.0)
    return unit(hips), unit(shoulders)


@compiled(inner=True)
def _tracked_joints(plan, state, time, positions, confidence):
    """Return the joints, NaN if lost, with exchanged left and right undone."""
    seen = _known_joints(positions, confidence)
    clock = state.clock
    hips, shoulders = _hips_and_shoulders(plan.pairs, seen)
    if clock[EXCHANGED] > 0 and time - clock[SINCE] > EXCHANGED_SECONDS:
        clock[EXCHANGED] = 0.0
        clock[SIDE_TIME] = -np.inf
        for row in range(len(state.known)):  # so that all bones ease to the sensor's pose
            state.known[row] = state.roll_known[row] = 0.0
    sign = -1.0 if clock[EXCHANGED] > 0 else 1.0
    side = unit((hips[0] + shoulders[0], hips[1] + shoulders[1], hips[2] + shoulders[2]))
    if dot(side, side) > 0:
        mean = (state.side[0], state.side[1], state.side[2])
        pause = time - clock[SIDE_TIME]
        if length(mean) > MIN_STEADY_LENGTH and pause <= MAX_EXCHANGE_SECONDS:
            turned = sign * dot(side, mean) < EXCHANGED_COSINE * length(mean)
            # hips and shoulders: one of them alone is noise
            if turned and sign * dot(hips, mean) <= 0 and sign * dot(shoulders, mean) <= 0:
                clock[EXCHANGED], clock[SINCE] = 1 - clock[EXCHANGED], time
                sign = -sign
        kept = math.exp(-max(0.0, pause) / STEADY_SECONDS)
        for axis in range(3):
            state.side[axis] = kept * mean[axis] + (1 - kept) * sign * side[axis]
        if side[0] ** 2 + side[2] ** 2 > 0.1:  # a body that lies on its side keeps its last heading
            clock[HEADING] = math.atan2(-sign * side[2], sign * side[0])
        clock[SIDE_TIME] = time
    return _exchanged(plan, seen) if clock[EXCHANGED] > 0 else seen


@compiled(inner=True)
def _known_joints(positions, confidence):
    seen = np.empty((len(positions), 3))
    for j in range(len(positions)):
        position = row_of(positions, j)
        known = confidence[j] > 0 and is_position(position)
        write_row(seen, j, position if known else (np.nan, np.nan, np.nan))
    return seen


@compiled(inner=True)
def _exchanged(plan, seen):
    """Return the joints with left and right exchanged."""
    exchanged = np.empty((len(seen), 3))
    for j in range(len(seen)):
        write_row(exchanged, j, row_of(seen, plan.opposite[j]))
    return exchanged


@compiled(inner=True)
def _remove_heading(plan, state, seen):
    """Turn the joints about the upright axis until the body faces +z, if the character does not turn."""
    if plan.turns:
        return
    c, s = math.cos(state.clock[HEADING]), math.sin(state.clock[HEADING])
    for j in range(len(seen)):
        seen[j, 0], seen[j, 2] = c * seen[j, 0] - s * seen[j, 2], s * seen[j, 0] + c * seen[j, 2]


@compiled(inner=True)
def _points(plan, seen):
    """Return the means of the joints that each point of the performer is between."""
    points = np.empty((len(plan.joints), 3))
    for p in range(len(points)):
        point, count = (0.0, 0.0, 0.0), 0
        for k in range(plan.joints.shape[1]):
            j = plan.joints[p, k]
            if j >= 0:
                point = plus(point, row_of(seen, j), 1.0)
                count += 1
        for axis in range(3):
            points[p, axis] = point[axis] / count
    return points


@compiled(inner=True)
def _directions(plan, seen, rows):
    """Return the directions of the bones (rows, 3), zero if unknown, and the weight of the trunk's inner joints."""
    points = _points(plan, seen)
    directions = np.empty((rows, 3))
    write_row(directions, 0, _known_unit(_torso(plan.pairs, seen)))
    for row in range(1, rows):
        direction = _known_unit(between(points, plan.ends[row, 0], plan.ends[row, 1]))
        write_row(directions, row, _raised(direction, plan.pitch[row]) if plan.pitch[row] != 0 else direction)
    counts = 1.0
    if len(plan.trunk) > 2:
        first, last = plan.trunk[0], plan.trunk[-1]
        chord = between(points, first, last)
        for k in range(1, len(plan.trunk) - 1):
            near = length(between(points, first, plan.trunk[k]))
            near = min(near, length(between(points, plan.trunk[k], last)))
            share = smooth_step(near / max(length(chord), MIN_LENGTH), INNER_JOINT_SHARES)
            counts = min(counts, share) if share == share else 0.0
        chord = _known_unit(chord)
        if counts < 1:
            for row in plan.trunk_rows:
                direction = (0.0, 0.0, 0.0)
                if dot(chord, chord) > 0:
                    direction = unit(blend(chord, row_of(directions, row), counts))
                write_row(directions, row, direction)
    return directions, counts


@compiled(inner=True)
def _raised(direction, angle):
    """Return a direction raised by an angle, at most to the vertical."""
    flat = math.sqrt(direction[0] * direction[0] + direction[2] * direction[2])
    if flat < MIN_LENGTH:
        return direction
    raised = min(max(math.atan2(direction[1], flat) + angle, -math.pi / 2), math.pi / 2)
    scale = math.cos(raised) / flat
    return (scale * direction[0], math.sin(raised), scale * direction[2])


@compiled(inner=True)
def _known_unit(v):
    """Return the direction of a vector; zero if it has none or is unknown."""
    return unit(v) if math.isfinite(v[0] + v[1] + v[2]) else (0.0, 0.0, 0.0)


@compiled(inner=True)
def _sides(plan, seen, rows):
    """Return the direction from right to left (rows, 3) that each bone's roll follows; zero if none."""
    across = np.empty((rows, 3))
    hips, shoulders = _hips_and_shoulders(plan.pairs, seen)
    if dot(hips, shoulders) < 0:  # a body is not twisted that far; the hips are narrower, so less certain
        hips = (0.0, 0.0, 0.0)
    for row in range(rows):
        side = (0.0, 0.0, 0.0)
        if plan.roll[row] == SIDES:
            share = plan.hips[row]
            if dot(hips, hips) == 0:
                share = 0.0
            elif dot(shoulders, shoulders) == 0:
                share = 1.0
            side = unit(blend(shoulders, hips, share))
        write_row(across, row, side)
    return across


@compiled(inner=True)
def _orientations(plan, state, orientations, rows):
    """Return the orientation of the performer's bone that each roll follows (rows, 4); NaN if none."""
    turned = np.empty((rows, 4))
    heading = (1.0, 0.0, 0.0, 0.0)
    if not plan.turns:
        heading = quat.about((0.0, 1.0, 0.0), -state.clock[HEADING])
    for row in range(rows):
        turn = (np.nan, np.nan, np.nan, np.nan)
        if plan.oriented[row] >= 0 and state.clock[EXCHANGED] == 0:
            turn = quat.normalised(quat.product(heading, quat.row_of(orientations, plan.oriented[row])))
        quat.write_row(turned, row, turn)
    return turned
