"""A performer's joints to the motions of a character's bones: arrays only.

A limb is a chain of bones that follows a chain of the performer's joints. Its bones point where the performer's point
(`follow = "direction"`), or turn from their rest as the performer's have turned from theirs (`"turn"`). The bones keep
their own lengths: only directions are taken over.

Few sensors see how a limb is rolled about itself. A bone is carried by its parent and turned by the least
rotation to where it should point; its roll is then corrected, a little in each frame, towards what is known about it:
the two sides of the body for the trunk; the orientation of the performer's bone where a log has it; the plane of the
elbow or knee where an arm or leg is bent; and otherwise the roll that the least rotation from rest gives. Each loses
its weight where it is undefined, so that no roll flips.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.motion import quaternions as quat
from solver.motion.limb_plan import BENT_SINES, HINGE, SIDES, plan_of
from solver.motion.limbs import Limb, Performer, bones_of, parents_first
from solver.motion.retarget import MAX_JOINT_METRES, RETURN_SECONDS
from solver.motion.two_bones import length

MAX_TURN_RATE = 25.0
"""Radians per second that a limb turns at most against what it hangs on; a thrower's forearm reaches about 40."""

MAX_FOOT_RADIANS = 0.9
"""Radians that a foot turns at most from how the shin carries it; the joint of a foot is a sensor's noisiest."""

FOOT_SECONDS = 0.05
"""Time constant with which a foot turns to where the performer's points, in seconds. It begins as at rest."""

HINGE_RATE = 20.0
"""Per second, how fast the roll of an upper arm or thigh closes in on the plane of a limb that is bent."""

ORIENTATION_RATE = 30.0
"""Per second, how fast a roll closes in on that of the performer's bone, where its orientation is known."""

ORIENTATION_COSINES = 0.5, 0.8
"""Cosine of the angle between where a bone points and where its orientation has it, from which the orientation counts,
and from which it counts in full."""

SWING_RATE = 20.0
"""Per second, how fast a roll closes in on the one that the least rotation from rest gives."""

STRAIGHT_RATE = 0.5
"""The same for an upper arm or thigh, whose roll stays nearly as it was while the limb is straight."""

INNER_JOINT_SHARES = 0.15, 0.35
"""How far a joint within the trunk is from the trunk's ends, as a share of its length, to count, and to count in full.
Kinect v1's spine is 7 cm above the hips and a few behind: the direction between them says nothing about the back."""

MIN_WIDTH_SHARES = 0.12, 0.25
"""Width of hips and of shoulders, as a share of the trunk's length, below which left and right cannot be told."""

EXCHANGED_COSINE = -0.5
"""Cosine of the angle beyond which a body that turns at once has had its sides exchanged by the sensor: 120°."""

STEADY_SECONDS = 0.1
"""Time constant of the mean direction that the sides of a body are compared with, in seconds."""

MIN_STEADY_LENGTH = 0.75
"""Length of that mean from which it is a body's heading and not noise; a turn at 8 rad/s has 0.78."""

MAX_EXCHANGE_SECONDS = 0.25
"""Seconds between two frames above which a body may have turned that far."""

EXCHANGED_SECONDS = 1.5
"""How long an exchange of left and right is undone, in seconds; then the sensor is believed."""


class _State(NamedTuple):
    """What is carried from frame to frame."""

    local: NDArray[np.float64]  # (b + 1, 4): each bone's turn from rest against its base, as it is shown
    gap: NDArray[np.float64]  # (b + 1, 3): what is left of the way from where a lost bone was held
    roll_gap: NDArray[np.float64]  # (b + 1,)
    known: NDArray[np.float64]  # (b + 1,): 1 where the bone was known in the last frame
    roll_known: NDArray[np.float64]  # (b + 1,)
    vector: NDArray[np.float64]  # (b + 1, 3): `local` as axis times angle, for the gain
    mount: NDArray[np.float64]  # (b + 1, 4): from the performer's bone's own axes to the bone's rest; NaN before
    side: NDArray[np.float64]  # (3,): the mean direction from the body's right to its left
    clock: NDArray[np.float64]  # (5,): time; time of `side`; 1 while exchanged; since when; heading


TIME, SIDE_TIME, EXCHANGED, SINCE, HEADING = range(5)


class LimbMotion:
    """Turns a performer's joints into the motions of a character's bones.

    Parameters
    ----------
    limbs : sequence of Limb
    performer : Performer
    rest : (j, 3) float64
        The performer in the pose that stands for the character's rest pose; metres, character axes (left +x, up +y,
        forward +z), NaN for unknown joints. Only limbs that follow by "turn" depend on it, and how far feet point up:
        sensors have the joint of a foot at other heights than meshes, so feet are level where the performer's are.
    basis : (3, 3) float64
        Rows: the mesh file's directions of the character's left, up and forward.
    turns : bool
        Whether the character turns with the performer. It takes a trunk for that: without one it does not.
    """

    def __init__(
        self,
        limbs: Sequence[Limb],
        performer: Performer,
        rest: NDArray[np.float64],
        basis: NDArray[np.float64] | None = None,
        *,
        turns: bool = True,
    ) -> None:
        self.limbs = parents_first(limbs)
        self.bones = bones_of(limbs)
        basis = np.eye(3) if basis is None else np.ascontiguousarray(basis, dtype=np.float64)
        self._plan = plan_of(self.limbs, self.bones, performer, rest, basis, turns)
        rows = len(self._plan.roll)
        self._unknown = np.full((len(performer.opposite), 4), np.nan)
        self._state = _State(
            local=np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1)),
            gap=np.zeros((rows, 3)),
            roll_gap=np.zeros(rows),
            known=np.zeros(rows),
            roll_known=np.zeros(rows),
            vector=np.zeros((rows, 3)),
            mount=np.full((rows, 4), np.nan),
            side=np.zeros(3),
            clock=np.array([-np.inf, -np.inf, 0.0, 0.0, 0.0]),
        )

    def step(
        self,
        time: float,
        positions: NDArray[np.float64],
        confidence: NDArray[np.float32],
        out: NDArray[np.float64] | None = None,
        *,
        orientations: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return the motions of the bones in one frame.

        A bone whose joints are lost keeps its direction against the bone it hangs on; when they come back it closes
        the distance smoothly. In the first frame every bone is where it should be at once.

        Parameters
        ----------
        time : float
            Seconds, increasing from call to call.
        positions : (j, 3) float64
            Metres, character axes. NaN, and more than `MAX_JOINT_METRES`, is a lost joint.
        confidence : (j,) float32
            0 where a joint is lost.
        out : (b, 4, 3) float64, optional
            Written to, and returned.
        orientations : (j, 4) float64, optional
            Unit quaternions (w, x, y, z) of the bones that begin at the joints, from axes of their own to character
            axes; NaN where unknown. A bone's roll follows how they turn from where they are first known.

        Returns
        -------
        (b, 4, 3) float64
            Motions for row vectors, x' = [x 1] T, mesh file's coordinates, without the root's translation.
        """
        out = np.empty((len(self.bones.parents), 4, 3)) if out is None else out
        turns = self._unknown if orientations is None else np.ascontiguousarray(orientations)
        _step(self._plan, self._state, float(time), np.ascontiguousarray(positions), confidence, turns, out)
        return out

    @property
    def heading(self) -> float:
        """Radians about the upright axis by which the performer is turned and the character does not turn."""
        return 0.0 if self._plan.turns else float(self._state.clock[HEADING])

    @property
    def trunk(self) -> int | None:
        """The first bone of the trunk, if there is one."""
        return int(self._plan.trunk_rows[0]) - 1 if len(self._plan.trunk_rows) else None


@compiled
def _step(plan, state, time, positions, confidence, orientations, out):
    """Bring the state up to a frame, and write the motions of the bones."""
    began = math.isfinite(state.clock[TIME])
    elapsed = max(0.0, time - state.clock[TIME]) if began else math.inf  # a clock that is set back stands still here
    state.clock[TIME] = time
    seen = _seen(plan, state, time, positions, confidence)
    _take_heading_off(plan, state, seen)
    rows = len(plan.roll)
    directions, counts = _directions(plan, seen, rows)
    aims, across = plan.aims.copy(), _sides_of(plan, seen, rows)
    for row in plan.trunk_rows:
        aims[row] = quat.unit(_blend(plan.chords[row], plan.aims[row], counts))
    turned = _turned(plan, state, orientations, rows)
    world = np.empty((rows, 4))
    for row in range(rows):
        base = (1.0, 0.0, 0.0, 0.0)
        if plan.base[row] >= 0:
            base = _quaternion(world, plan.base[row])
        local = _turn(plan, state, row, quat.inverse(base), aims, directions, across, turned, elapsed, began)
        world[row] = quat.product(base, local)
    _mount(state, turned, world)
    _write_motions(plan, state, out)


@compiled(inner=True, inline="always")
def _quaternion(values, row):
    return (values[row, 0], values[row, 1], values[row, 2], values[row, 3])


@compiled(inner=True, inline="always")
def _vector(values, row):
    return (values[row, 0], values[row, 1], values[row, 2])


@compiled(inner=True)
def _blend(a, b, share):
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))


@compiled(inner=True)
def _rise(value, limits):
    """Return 0 below the first limit, 1 above the second, and a smooth step between."""
    share = min(max((value - limits[0]) / (limits[1] - limits[0]), 0.0), 1.0)
    return share * share * (3 - 2 * share)


@compiled(inner=True)
def _between(seen, tail, head):
    return (seen[head, 0] - seen[tail, 0], seen[head, 1] - seen[tail, 1], seen[head, 2] - seen[tail, 2])


@compiled(inner=True)
def _torso(pairs, seen):
    """Return the vector from the middle of the hips to that of the shoulders."""
    up = np.empty(3)
    for axis in range(3):
        hips = seen[pairs[0, 0], axis] + seen[pairs[0, 1], axis]
        up[axis] = (seen[pairs[1, 0], axis] + seen[pairs[1, 1], axis] - hips) / 2
    return (up[0], up[1], up[2])


@compiled(inner=True)
def _pair(pairs, seen):
    """Return the directions from right to left of hips and shoulders; zero where they cannot be told."""
    trunk = length(_torso(pairs, seen))
    hips = _between(seen, pairs[0, 1], pairs[0, 0])
    shoulders = _between(seen, pairs[1, 1], pairs[1, 0])
    # comparisons with NaN are false: what is not known is too narrow
    if not (length(hips) > quat.MIN_LENGTH and not length(hips) < MIN_WIDTH_SHARES[0] * trunk):
        hips = (0.0, 0.0, 0.0)
    if not (length(shoulders) > quat.MIN_LENGTH and not length(shoulders) < MIN_WIDTH_SHARES[1] * trunk):
        shoulders = (0.0, 0.0, 0.0)
    return quat.unit(hips), quat.unit(shoulders)


@compiled(inner=True)
def _seen(plan, state, time, positions, confidence):
    """Return the joints as they should be: NaN where lost, left and right where they belong."""
    seen = np.full(positions.shape, np.nan)
    for j in range(len(positions)):
        farthest = max(abs(positions[j, 0]), abs(positions[j, 1]), abs(positions[j, 2]))
        if confidence[j] > 0 and farthest < MAX_JOINT_METRES:
            seen[j] = positions[j]
    clock = state.clock
    hips, shoulders = _pair(plan.pairs, seen)
    if clock[EXCHANGED] > 0 and time - clock[SINCE] > EXCHANGED_SECONDS:
        clock[EXCHANGED] = 0.0
        clock[SIDE_TIME] = -np.inf
        state.known[:] = 0.0  # and everything eases to where the sensor sees it
        state.roll_known[:] = 0.0
    sign = -1.0 if clock[EXCHANGED] > 0 else 1.0
    side = quat.unit((hips[0] + shoulders[0], hips[1] + shoulders[1], hips[2] + shoulders[2]))
    if quat.dot(side, side) > 0:
        mean = (state.side[0], state.side[1], state.side[2])
        pause = time - clock[SIDE_TIME]
        if length(mean) > MIN_STEADY_LENGTH and pause <= MAX_EXCHANGE_SECONDS:
            turned = sign * quat.dot(side, mean) < EXCHANGED_COSINE * length(mean)
            # hips and shoulders alike: one alone is noise
            if turned and sign * quat.dot(hips, mean) <= 0 and sign * quat.dot(shoulders, mean) <= 0:
                clock[EXCHANGED], clock[SINCE] = 1 - clock[EXCHANGED], time
                sign = -sign
        kept = math.exp(-max(0.0, pause) / STEADY_SECONDS)
        for axis in range(3):
            state.side[axis] = kept * mean[axis] + (1 - kept) * sign * side[axis]
        if side[0] ** 2 + side[2] ** 2 > 0.1:  # a body that lies on its side has no heading: it keeps the last one
            clock[HEADING] = math.atan2(-sign * side[2], sign * side[0])
        clock[SIDE_TIME] = time
    return seen[plan.opposite] if clock[EXCHANGED] > 0 else seen


@compiled(inner=True)
def _take_heading_off(plan, state, seen):
    """Turn the joints about the upright axis until the body faces +z, if the character does not turn."""
    if plan.turns:
        return
    c, s = math.cos(state.clock[HEADING]), math.sin(state.clock[HEADING])
    for j in range(len(seen)):
        seen[j, 0], seen[j, 2] = c * seen[j, 0] - s * seen[j, 2], s * seen[j, 0] + c * seen[j, 2]


@compiled(inner=True)
def _directions(plan, seen, rows):
    """Return where the bones point (rows, 3), zero where unknown, and how much the trunk's inner joints count."""
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
        direction = _known_unit(_between(points, plan.ends[row, 0], plan.ends[row, 1]))
        directions[row] = _raised(direction, plan.pitch[row]) if plan.pitch[row] != 0 else direction
    counts = 1.0
    if len(plan.trunk) > 2:
        first, last = plan.trunk[0], plan.trunk[-1]
        chord = _between(points, first, last)
        for k in range(1, len(plan.trunk) - 1):
            near = length(_between(points, first, plan.trunk[k]))
            near = min(near, length(_between(points, plan.trunk[k], last)))
            share = _rise(near / max(length(chord), quat.MIN_LENGTH), INNER_JOINT_SHARES)
            counts = min(counts, share) if share == share else 0.0
        chord = _known_unit(chord)
        if counts < 1 and quat.dot(chord, chord) > 0:
            for row in plan.trunk_rows:
                directions[row] = quat.unit(_blend(chord, _vector(directions, row), counts))
        elif counts < 1:
            directions[plan.trunk_rows] = 0.0
    return directions, counts


@compiled(inner=True)
def _raised(direction, angle):
    """Return a direction that points further up by an angle, not over the upright."""
    flat = math.sqrt(direction[0] * direction[0] + direction[2] * direction[2])
    if flat < quat.MIN_LENGTH:
        return direction
    raised = min(max(math.atan2(direction[1], flat) + angle, -math.pi / 2), math.pi / 2)
    scale = math.cos(raised) / flat
    return (scale * direction[0], math.sin(raised), scale * direction[2])


@compiled(inner=True)
def _known_unit(v):
    """Return a direction; zero where there is none, or where it is not known."""
    return quat.unit(v) if math.isfinite(v[0] + v[1] + v[2]) else (0.0, 0.0, 0.0)


@compiled(inner=True)
def _sides_of(plan, seen, rows):
    """Return the direction from right to left (rows, 3) that each bone's roll follows; zero where there is none."""
    across = np.zeros((rows, 3))
    hips, shoulders = _pair(plan.pairs, seen)
    if quat.dot(hips, shoulders) < 0:  # a body is not twisted that far: the hips are the narrower ones
        hips = (0.0, 0.0, 0.0)
    for row in range(rows):
        if plan.roll[row] == SIDES:
            share = plan.hips[row]
            if quat.dot(hips, hips) == 0:
                share = 0.0
            elif quat.dot(shoulders, shoulders) == 0:
                share = 1.0
            across[row] = quat.unit(_blend(shoulders, hips, share))
    return across


@compiled(inner=True)
def _turned(plan, state, orientations, rows):
    """Return the orientation of the performer's bone that tells each roll (rows, 4); NaN where none does."""
    turned = np.full((rows, 4), np.nan)
    if state.clock[EXCHANGED] > 0:
        return turned
    heading = (1.0, 0.0, 0.0, 0.0)
    if not plan.turns:
        heading = quat.about((0.0, 1.0, 0.0), -state.clock[HEADING])
    for row in range(rows):
        if plan.oriented[row] >= 0:
            turned[row] = quat.normalised(quat.product(heading, _quaternion(orientations, plan.oriented[row])))
    return turned


@compiled(inner=True)
def _mount(state, turned, world):
    """Note where bones are in the axes of the performer's when their orientations are first known."""
    for row in range(len(world)):
        if math.isfinite(turned[row, 0]) and state.known[row] > 0 and not math.isfinite(state.mount[row, 0]):
            state.mount[row] = quat.product(quat.inverse(_quaternion(turned, row)), _quaternion(world, row))


@compiled(inner=True)
def _turn(plan, state, row, from_base, aims, directions, across, turned, elapsed, began):
    """Bring a bone's turn against its base up to date."""
    aim, direction = _vector(aims, row), _vector(directions, row)
    local = _quaternion(state.local, row)
    known = quat.dot(aim, aim) > 0.5 and quat.dot(direction, direction) > 0.5
    fading = math.exp(-elapsed / RETURN_SECONDS)
    if known:
        wanted = quat.rotated(from_base, direction)
        if plan.foot[row]:
            wanted = _eased_foot(aim, quat.rotated(local, aim), wanted, elapsed if began else 0.0)
        local = _swing(state, row, local, aim, wanted, fading, elapsed, began)
        if math.isfinite(turned[row, 0] + state.mount[row, 0]):
            local = _as_turned(plan, state, row, local, from_base, aim, turned, elapsed)
        else:
            local = _rolled(plan, state, row, local, from_base, aims, directions, across, fading, elapsed, began)
        local = quat.normalised(local)
        state.local[row] = local
    state.known[row] = 1.0 if known else 0.0
    return local


@compiled(inner=True)
def _eased_foot(aim, now, wanted, elapsed):
    """Return where a foot points next on its way to where it should, against its shin and not too far from its rest."""
    away = length(quat.to_vector(quat.least(aim, wanted)))
    wanted = _on_the_way(aim, wanted, min(1.0, MAX_FOOT_RADIANS / max(away, quat.MIN_LENGTH)))
    return _on_the_way(now, wanted, 1 - math.exp(-elapsed / FOOT_SECONDS))


@compiled(inner=True)
def _on_the_way(start, end, share):
    """Return the direction a share of the least rotation from one to another."""
    way = quat.to_vector(quat.least(start, end))
    return quat.unit(quat.rotated(quat.from_vector(quat.scaled(way, share)), start))


@compiled(inner=True)
def _swing(state, row, local, aim, wanted, fading, elapsed, began):
    """Turn a bone by the least rotation to where it should point, or as near as it may."""
    now = quat.rotated(local, aim)
    gap = (0.0, 0.0, 0.0)
    if began:
        gap = quat.scaled(state.gap[row], fading)
        if state.known[row] == 0:
            gap = quat.to_vector(quat.least(wanted, now))
        wanted = quat.rotated(quat.from_vector(gap), wanted)
    state.gap[row] = gap
    turn = quat.to_vector(quat.least(now, wanted))
    angle = length(turn)
    if angle > MAX_TURN_RATE * elapsed:
        turn = quat.scaled(turn, MAX_TURN_RATE * elapsed / angle)
    return quat.product(quat.from_vector(turn), local)


@compiled(inner=True)
def _rolled(plan, state, row, local, from_base, aims, directions, across, fading, elapsed, began):
    """Roll a bone about itself towards what the pose says about its roll."""
    aim, side = _vector(aims, row), _vector(plan.sides, row)
    axis, now = quat.rotated(local, aim), quat.rotated(local, side)
    if plan.roll[row] == SIDES:
        wanted = quat.rotated(from_base, _vector(across, row))
        flat = quat.cross(axis, wanted)
        known = length(flat) > 0.2
        angle, gap = 0.0, 0.0
        if known:
            angle = quat.twist(now, wanted, axis)
            if began:
                gap = state.roll_gap[row] * fading if state.roll_known[row] > 0 else -angle
        state.roll_gap[row], state.roll_known[row] = gap, 1.0 if known else 0.0
        angle = (angle + gap + math.pi) % (2 * math.pi) - math.pi
    else:
        # the roll of the least rotation from rest, which is undefined where that is half a turn
        swing = quat.rotated(quat.least(aim, axis), side)
        error = quat.twist(now, swing, axis)
        weight = STRAIGHT_RATE if plan.roll[row] == HINGE else SWING_RATE
        weight *= (1 + quat.dot(aim, axis)) / 2
        x, y = weight * math.cos(error), weight * math.sin(error)
        if plan.roll[row] == HINGE:
            hinge = quat.cross(_vector(directions, row), _vector(directions, row + 1))
            bent = HINGE_RATE * _rise(length(hinge), BENT_SINES)
            if bent > 0:
                error = quat.twist(now, quat.rotated(from_base, hinge), axis)
                if began:
                    bent *= (1 + math.cos(error)) / 2  # the other way round is an error of the sensor's
                x, y, weight = x + bent * math.cos(error), y + bent * math.sin(error), weight + bent
        share = 1 - math.exp(-weight * elapsed) if began else 1.0
        angle = share * math.atan2(y, x) if weight > 0 else 0.0
    fastest = MAX_TURN_RATE * elapsed
    return quat.product(quat.about(axis, min(max(angle, -fastest), fastest)), local)


@compiled(inner=True)
def _as_turned(plan, state, row, local, from_base, aim, turned, elapsed):
    """Roll a bone about itself as the performer's has rolled."""
    there = quat.product(from_base, quat.product(_quaternion(turned, row), _quaternion(state.mount, row)))
    axis, side = quat.rotated(local, aim), _vector(plan.sides, row)
    weight = ORIENTATION_RATE * _rise(quat.dot(axis, quat.rotated(there, aim)), ORIENTATION_COSINES)
    angle = quat.twist(quat.rotated(local, side), quat.rotated(there, side), axis)
    angle *= 1 - math.exp(-weight * elapsed)
    fastest = MAX_TURN_RATE * elapsed
    return quat.product(quat.about(axis, min(max(angle, -fastest), fastest)), local)


@compiled(inner=True)
def _write_motions(plan, state, out):
    """Write the motions of the bones, from the root to the tips, each with its own length."""
    rows = len(plan.roll)
    shown = np.empty((rows, 4))
    shown[0] = 1.0, 0.0, 0.0, 0.0
    for row in range(1, rows):
        local = _quaternion(state.local, row)
        if plan.gain[row] != 1:
            vector = quat.near_vector(local, _vector(state.vector, row))
            state.vector[row] = vector
            local = quat.from_vector(quat.scaled(vector, plan.gain[row]))
        base = plan.shown_base[row]
        shown[row] = quat.product(_quaternion(shown, base), local) if base >= 0 else local
        bone = row - 1
        turn = _in_file_axes(_quaternion(shown, row), plan.basis)
        _write_motion(turn, plan.heads, plan.parents[bone], bone, out)


@compiled(inner=True)
def _in_file_axes(q, basis):
    """Return a rotation in character axes as one in those of the mesh file."""
    x, y, z = q[1], q[2], q[3]
    return (
        q[0],
        x * basis[0, 0] + y * basis[1, 0] + z * basis[2, 0],
        x * basis[0, 1] + y * basis[1, 1] + z * basis[2, 1],
        x * basis[0, 2] + y * basis[1, 2] + z * basis[2, 2],
    )


@compiled(inner=True)
def _write_motion(turn, heads, parent, bone, out):
    """Write the motion that turns a bone about its head, where the bone that it hangs on carries it."""
    quat.write_rows(turn, out[bone])
    for axis in range(3):
        place, kept = heads[bone, axis], 0.0
        if parent >= 0:
            place = out[parent, 3, axis]
        for i in range(3):
            if parent >= 0:
                place += heads[bone, i] * out[parent, i, axis]
            kept += heads[bone, i] * out[bone, i, axis]
        out[bone, 3, axis] = place - kept
