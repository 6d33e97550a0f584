"""Directions and sides of a performer's bones in one frame, with exchanged left and right corrected."""

import math

import numpy as np

from puppetline.compiled import compiled
from solver.model.vectors import MIN_LENGTH, between, blend, dot, length, row_of, unit
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
    up = np.empty(3)
    for axis in range(3):
        hips = seen[pairs[0, 0], axis] + seen[pairs[0, 1], axis]
        up[axis] = (seen[pairs[1, 0], axis] + seen[pairs[1, 1], axis] - hips) / 2
    return (up[0], up[1], up[2])


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
    seen = np.full(positions.shape, np.nan)
    for j in range(len(positions)):
        if confidence[j] > 0 and is_position(positions[j]):
            seen[j] = positions[j]
    clock = state.clock
    hips, shoulders = _hips_and_shoulders(plan.pairs, seen)
    if clock[EXCHANGED] > 0 and time - clock[SINCE] > EXCHANGED_SECONDS:
        clock[EXCHANGED] = 0.0
        clock[SIDE_TIME] = -np.inf
        state.known[:] = 0.0  # so that all bones ease to the sensor's pose
        state.roll_known[:] = 0.0
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
    return seen[plan.opposite] if clock[EXCHANGED] > 0 else seen


@compiled(inner=True)
def _remove_heading(plan, state, seen):
    """Turn the joints about the upright axis until the body faces +z, if the character does not turn."""
    if plan.turns:
        return
    c, s = math.cos(state.clock[HEADING]), math.sin(state.clock[HEADING])
    for j in range(len(seen)):
        seen[j, 0], seen[j, 2] = c * seen[j, 0] - s * seen[j, 2], s * seen[j, 0] + c * seen[j, 2]


@compiled(inner=True)
def _directions(plan, seen, rows):
    """Return the directions of the bones (rows, 3), zero if unknown, and the weight of the trunk's inner joints."""
    points = np.zeros((len(plan.joints), 3))
    for p in range(len(plan.joints)):
        count = 0
        for j in plan.joints[p]:
            if j >= 0:
                points[p] += seen[j]
                count += 1
        points[p] /= count
    directions = np.zeros((rows, 3))
    directions[0] = _known_unit(_torso(plan.pairs, seen))
    for row in range(1, rows):
        direction = _known_unit(between(points, plan.ends[row, 0], plan.ends[row, 1]))
        directions[row] = _raised(direction, plan.pitch[row]) if plan.pitch[row] != 0 else direction
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
        if counts < 1 and dot(chord, chord) > 0:
            for row in plan.trunk_rows:
                directions[row] = unit(blend(chord, row_of(directions, row), counts))
        elif counts < 1:
            directions[plan.trunk_rows] = 0.0
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
    across = np.zeros((rows, 3))
    hips, shoulders = _hips_and_shoulders(plan.pairs, seen)
    if dot(hips, shoulders) < 0:  # a body is not twisted that far; the hips are narrower, so less certain
        hips = (0.0, 0.0, 0.0)
    for row in range(rows):
        if plan.roll[row] == SIDES:
            share = plan.hips[row]
            if dot(hips, hips) == 0:
                share = 0.0
            elif dot(shoulders, shoulders) == 0:
                share = 1.0
            across[row] = unit(blend(shoulders, hips, share))
    return across


@compiled(inner=True)
def _orientations(plan, state, orientations, rows):
    """Return the orientation of the performer's bone that each roll follows (rows, 4); NaN if none."""
    turned = np.full((rows, 4), np.nan)
    if state.clock[EXCHANGED] > 0:
        return turned
    heading = (1.0, 0.0, 0.0, 0.0)
    if not plan.turns:
        heading = quat.about((0.0, 1.0, 0.0), -state.clock[HEADING])
    for row in range(rows):
        if plan.oriented[row] >= 0:
            turned[row] = quat.normalised(quat.product(heading, quat.row_of(orientations, plan.oriented[row])))
    return turned
