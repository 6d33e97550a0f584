"""Steps of a body on any number of legs: feet stand on the floor, and step when the body moves on.

Each foot has a home, its place at rest carried by the body's position and heading. A foot stands where it is until its
leg steps: in the order and cadence of a gait (`solver.motion.gait`) while the body walks, and when it is too far from
home or turned too far otherwise. It swings on an arc to where its home will be when it has been passed half way
(Raibert and Hodgins 1991; Hecker et al. 2008). The body leans, sinks and rears as its legs allow
(`solver.motion.body_on_legs`), and a raised hand of the performer lifts a front leg (`solver.motion.lifted_legs`).
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.model.vectors import dot, length, minus, plus, row_of, scaled, write, write_row
from solver.motion import quaternions as quat
from solver.motion.body_on_legs import pose_body
from solver.motion.gait import DUTY, RATE, RESTED, RESTED_SECONDS, STOPPED, WALKS, share_of_stride, update
from solver.motion.leg_chain import stretch
from solver.motion.lifted_legs import apply_gesture, watch_hands
from solver.motion.resting_feet import TIME, is_seen, remaining, resting_feet
from solver.motion.step_plan import FOLLOWS, HEADING, JUMP, TURNING, PerformersLegs, StandingLeg, plan_of, state_of
from solver.motion.two_bones import carry_along, moved, place

VELOCITY_SECONDS = 0.15
"""Time constant of the body's velocity and turning rate, in seconds: sensors measure them imprecisely."""

MAX_AHEAD = 0.45
"""Largest distance at which a foot is put down from its home, in leg lengths."""

TOO_FAR, TOO_FAR_WALKING = 0.22, 0.47
"""Distances between a foot and its home, in leg lengths, from which a leg steps while the body stands and walks."""

MAX_AWAY = 0.52
"""Largest distance between a foot that stands and its home, in leg lengths."""

TIDY_DISTANCE, TIDY_SECONDS = 0.1, 0.5
"""Distance from home, in leg lengths, from which a leg steps once more in this time after a walk, in seconds."""

LEAN_AWAY, TURN_AWAY = 0.2, math.radians(25)
"""Distance, in leg lengths, and angle, in radians, by which a body that does not walk can be away from its homes until
they follow."""

SLOW_STEP_METRES, QUICK_STEP_METRES = 0.18, 0.12
"""Distances between a performer's foot and where it came to rest, in metres, from which it has stepped: of a foot that
moves so slowly that it seems to rest, and of another one."""

CAUGHT_UP = 0.2
"""Share of these below which the homes rest again."""

MAX_SHIFT = 0.2
"""Distance towards which the body's way from its homes levels off, in leg lengths."""

FOLLOW_SECONDS = 0.25
"""Time in which the homes begin or end to follow the body, in seconds."""

BASE_SECONDS, SLOW_BASE_SECONDS = 0.15, 0.5
"""Time constants with which the homes follow a body that walks, and one that does not, in seconds."""

HEADING_SECONDS = 0.08
"""Time constant of the critically damped spring with which the homes turn, in seconds."""

MAX_TURNING_SPEED = 1.4
"""Largest speed at which a turning body moves the homes of its feet, in leg lengths per second."""

TOO_TURNED = math.radians(20)
"""Angle between a foot and its home from which a leg steps, in radians."""

MAX_LEAD = math.radians(15)
"""Largest angle by which a foot is put down turned further than the body, in radians."""

STEP_SECONDS = 0.35
"""Length of a step that is not part of a walk, in seconds."""

MIN_SWING_SECONDS, MAX_SWING_SECONDS = 0.14, 0.5
"""Shortest and longest swing of a walk, in seconds."""

ARC_HEIGHT, ARC_SLOPE, MAX_ARC_HEIGHT = 0.08, 0.06, 0.2
"""Height of a swing in leg lengths: of a short one; its increase with the step's length; the largest."""

LIFTING_SHARE = 0.1
"""Share of a swing at its beginning, and at its end, in which the foot only rises, and only sinks."""

AIM_SHARE = 0.8
"""Share of a swing in which its end is still corrected."""

LATE_SHARE = 0.7
"""Share of a leg's time in the air after which it no longer begins a swing that others have delayed."""

FOOT_PITCH = math.radians(25)
"""Largest angle by which the tip of a foot hangs down in a swing, in radians."""

MIN_JUMP, JUMP_SECONDS = 0.05, 0.1
"""Height of a jump, in leg lengths, above which feet go to their homes, and the time constant, in seconds."""

FORWARD_SPEED = 1.0
"""Leg lengths per stride by which walking in place moves a character that goes forward."""


FOOT_CLEARANCE, MIN_FOOT_LENGTH = 0.4, 0.25
"""Share of the height of a swing by which the tip of a foot hangs down at most, and length of a foot that counts, in
leg lengths, if its bone is shorter: soles of hooves and stout legs reach farther than their bones."""


class Steps:
    """Puts the feet of a character on the floor, and lets it step.

    Parameters
    ----------
    bones : Bones
    legs : sequence of StandingLeg
        At least one. At rest their feet are on the floor.
    trunk : sequence of int
        Bones of the trunk; empty without one.
    performer : PerformersLegs
    metre : float
        Mesh units per metre of the performer: the ratio of their leg lengths.
    basis : (3, 3) float64, optional
        Rows: the mesh file's directions of the character's left, up and forward.
    goes_forward : bool
        Whether a performer who walks in place moves the character forward.
    """

    def __init__(
        self,
        bones: Bones,
        legs: Sequence[StandingLeg],
        trunk: Sequence[int],
        performer: PerformersLegs,
        metre: float,
        basis: NDArray[np.float64] | None = None,
        *,
        goes_forward: bool = False,
    ) -> None:
        basis = np.eye(3) if basis is None else np.asarray(basis, dtype=np.float64)
        self._plan = plan_of(bones, legs, trunk, performer, metre, basis, goes_forward)
        self._state = state_of(self._plan)

    def step(
        self,
        time: float,
        positions: NDArray[np.float64],
        confidence: NDArray[np.float32],
        motions: NDArray[np.float64],
        root: NDArray[np.float64],
    ) -> None:
        """Put the feet of one frame on the floor.

        Parameters
        ----------
        time, positions, confidence
            As for `limb_motion.LimbMotion.step`.
        motions : (b, 4, 3) float64
            From `limb_motion.LimbMotion.step`; written to.
        root : (3,) float64
            Translation of the whole character, mesh file's coordinates; written to.
        """
        _step(self._plan, self._state, float(time), positions, confidence, motions, root)

    @property
    def metre(self) -> float:
        """Mesh units per metre of the performer."""
        return self._plan.metre

    @property
    def swinging(self) -> NDArray[np.bool_]:
        """(l,) bool: the feet that swing from one place to the next."""
        return self._state.swing > 0

    @property
    def lifted(self) -> bool:
        """Whether a hand lifts a leg, or the body jumps."""
        return bool(self._state.lift[:, 1].any() or self._state.body[JUMP] > 0)

    @property
    def places(self) -> NDArray[np.float64]:
        """(l, 3) float64: positions of feet that stand, mesh file's coordinates; NaN for others."""
        stands = (self._state.swing == 0) & (self._state.lift[:, 1] == 0)
        return np.where(stands[:, None], self._state.place, np.nan)

    def hold(self, places: NDArray[np.float64]) -> None:
        """Let feet stand from the first frame on at the `places` of another instance."""
        held = np.isfinite(places).all(axis=1)
        self._state.place[held], self._state.held[held] = places[held], 1.0


@compiled(waits=False)
def _step(plan, state, time, positions, confidence, motions, root):
    """Update the state, the motions and the root of a frame."""
    clock = state.watch.clock
    began = math.isfinite(clock[TIME])
    elapsed = max(0.0, time - clock[TIME]) if began else math.inf
    clock[TIME] = time
    rests, low = resting_feet(plan.watch, state.watch, positions, confidence, elapsed, began)
    unseen = 0  # a flag that begins as a constant has two types, and the gait would be compiled for both
    for foot in range(2):
        seen = is_seen(plan.watch.joints[foot], positions, confidence)
        unseen += 0 if seen else 1
        state.watch.held[foot] = 1.0 if rests[foot] else 0.0
        # a lost foot keeps its position, which says nothing about whether the performer stands; a foot that is held up
        # does not carry the body on, and on tilted sensors feet on the floor differ in height
        rests[foot] = state.watch.still[foot] > 0 and seen
    _move_homes(plan, state, motions, root, elapsed, began)
    speed = math.hypot(length(state.velocity), plan.radius * state.body[TURNING])
    update(state.gait, time, elapsed, ~(rests | low), rests, unseen > 0, speed, plan.leg_length, plan.metre)
    watch_hands(plan, state, positions, confidence, elapsed)
    if not began:
        for leg in range(len(plan.feet)):
            if state.held[leg] > 0:
                _face(state, leg, state.body[HEADING])
            else:
                _stand_at_home(plan, state, leg)
    _begin_swings(plan, state)
    for leg in range(len(plan.feet)):
        _swing(plan, state, leg, elapsed if began else 0.0)
    free = motions.copy()
    pitch = pose_body(plan, state, positions, confidence, motions, root, elapsed)
    changed, before = np.zeros(len(motions), dtype=np.bool_), motions.copy()
    for leg in range(len(plan.feet)):
        _put_leg(plan, state, leg, motions, root, changed)
        floor = state.body[JUMP] - dot(root, row_of(plan.axes, 1))
        apply_gesture(plan, state, leg, free, pitch, motions, floor)
    carry_along(motions, before, plan.parents, changed)


@compiled(inner=True)
def _move_homes(plan, state, motions, root, elapsed, began):
    """Let the homes follow the body while it walks or is far from them; limit its way from them.

    While the performer's feet rest, the homes stay: a performer who bends, sits down or looks around moves the hips,
    and sensors are imprecise.
    """
    up, body = row_of(plan.axes, 1), state.body
    if plan.goes_forward and began and state.gait[WALKS] > 0:
        ahead = quat.rotated(quat.about(up, body[HEADING]), row_of(plan.axes, 2))
        by = FORWARD_SPEED * plan.leg_length * state.gait[RATE] * elapsed
        write(state.walked, plus(state.walked, ahead, by))
    height = dot(root, up)
    level = plus(plus(root, state.walked, 1.0), up, -height - dot(state.walked, up))
    heading = body[HEADING]
    if len(plan.trunk):
        turn = quat.of_rows(motions[plan.trunk[0]])
        heading = 2 * math.atan2(turn[1] * up[0] + turn[2] * up[1] + turn[3] * up[2], turn[0])
    way = minus(level, state.base)
    turned = (heading - body[HEADING] + math.pi) % (2 * math.pi) - math.pi
    away = max(length(way) / (LEAN_AWAY * plan.leg_length), abs(turned) / TURN_AWAY)
    walks = state.gait[WALKS] > 0
    follows = walks or away > (CAUGHT_UP if body[FOLLOWS] > 0 else 1.0)
    stays = _stays(state)
    goal = 1.0 if follows and not stays else 0.0
    most = elapsed / FOLLOW_SECONDS
    body[FOLLOWS] += min(max(goal - body[FOLLOWS], -most), most)
    moved_share = (
        (1 - remaining(BASE_SECONDS if walks else SLOW_BASE_SECONDS, elapsed)) * body[FOLLOWS] if began else 1.0
    )
    if elapsed > 0 and began:
        fading = remaining(VELOCITY_SECONDS, elapsed)
        for axis in range(3):
            now = (level[axis] - state.last[axis]) / elapsed
            state.velocity[axis] = now + fading * (state.velocity[axis] - now)
        _turn_homes(plan, body, turned, elapsed)
    elif not began:
        body[HEADING] += turned
    write(state.last, level)
    write(state.base, plus(state.base, way, moved_share))
    way = scaled(way, 1 - moved_share)
    size, most = length(way), MAX_SHIFT * plan.leg_length
    if size > 1e-9 * most:
        way = scaled(way, most * math.tanh(size / most) / size)
    # the trunk turns about its first bone; the body turns about its middle
    beside = minus(plan.pivot, plan.heads[plan.trunk[0]]) if len(plan.trunk) else (0.0, 0.0, 0.0)
    turned_about = minus(beside, quat.rotated(quat.about(up, body[HEADING]), beside))
    write(root, plus(plus(plus(state.base, way, 1.0), up, height), turned_about, 1.0))


@compiled(inner=True)
def _turn_homes(plan, body, turned, elapsed):
    """Turn the homes towards the heading of the body, as a critically damped spring, as fast as feet can follow."""
    # a spring whose goal stays this far ahead turns at the largest speed
    most = 2 * HEADING_SECONDS * MAX_TURNING_SPEED * plan.leg_length / max(plan.radius, 1e-9 * plan.leg_length)
    rate, goal = 1 / HEADING_SECONDS, body[HEADING] + min(max(body[FOLLOWS] * turned, -most), most)
    away, decay = body[HEADING] - goal, math.exp(-elapsed / HEADING_SECONDS)
    pull = body[TURNING] + rate * away
    body[HEADING] = goal + (away + pull * elapsed) * decay
    body[TURNING] = (body[TURNING] - rate * pull * elapsed) * decay


@compiled(inner=True)
def _stays(state):
    """Return whether the performer stands where both feet came to rest; update where that is."""
    gait = state.gait
    if gait[RESTED] <= RESTED_SECONDS:
        for foot in range(2):
            write_row(state.stand, foot, row_of(state.watch.last, foot))
        return False
    for foot in range(2):
        way = minus(row_of(state.watch.last, foot), row_of(state.stand, foot))
        if not math.hypot(way[0], way[2]) < (SLOW_STEP_METRES if state.watch.held[foot] > 0 else QUICK_STEP_METRES):
            gait[RESTED] = 0.0
            return False
    return _has_arrived(gait)


@compiled(inner=True)
def _has_arrived(gait):
    """Return whether the performer stands, and the steps that end a walk are over."""
    return gait[RESTED] > RESTED_SECONDS and gait[STOPPED] >= TIDY_SECONDS


@compiled(inner=True)
def _heading(state, ahead):
    """Return the heading that the homes will have after some time."""
    return state.body[HEADING] + min(max(state.body[TURNING] * ahead, -MAX_LEAD), MAX_LEAD)


@compiled(inner=True)
def _home(plan, state, leg, ahead):
    """Return the home that a foot will have after some time, if the body moves on as it does."""
    up = row_of(plan.axes, 1)
    turn = quat.about(up, _heading(state, ahead))
    out = quat.rotated(turn, minus(plan.ankles[leg], plan.pivot))
    return plus(plus(plus(out, plan.pivot, 1.0), state.base, 1.0), state.velocity, ahead * state.body[FOLLOWS])


@compiled(inner=True)
def _face(state, leg, heading):
    """Turn a foot to a heading, from which and to which it turns."""
    for k in range(3):
        state.yaw[leg, k] = heading


@compiled(inner=True)
def _stand_at_home(plan, state, leg):
    """Put a foot down at home."""
    write_row(state.place, leg, _home(plan, state, leg, 0.0))
    _face(state, leg, state.body[HEADING])
    state.swing[leg] = 0.0


@compiled(inner=True)
def _begin_swings(plan, state):
    """Begin the swings that the gait or the distance from home demands, while enough other feet stand."""
    gait, count = state.gait, len(plan.feet)
    most = max(1, count // 2)
    flying = 0
    for leg in range(count):
        if state.swing[leg] > 0 or state.lift[leg, 1] > 0:
            flying += 1
    walks = gait[WALKS] > 0
    while flying < most:
        chosen, worst = -1, 0.0
        for leg in range(count):
            if state.swing[leg] > 0 or state.lift[leg, 1] > 0 or (not walks and not _may_step(plan, state, leg)):
                continue
            urgency = _urgency(plan, state, leg, walks)
            if urgency > worst:
                chosen, worst = leg, urgency
        if chosen < 0:
            return
        _begin_swing(state, chosen, walks)
        flying += 1


@compiled(inner=True)
def _may_step(plan, state, leg):
    """Return whether all legs in the air are of the same group as a leg."""
    for other in range(len(plan.feet)):
        if state.swing[other] > 0 and plan.offsets[other, 1] != plan.offsets[leg, 1]:
            return False
    return True


@compiled(inner=True)
def _urgency(plan, state, leg, walks):
    """Return how urgently a leg has to step, 0 if it may stand."""
    gait = state.gait
    away = length(minus(_home(plan, state, leg, 0.0), row_of(state.place, leg))) / plan.leg_length
    turned = abs(state.yaw[leg, 0] - state.body[HEADING])
    if walks:
        air = 1 - gait[DUTY]
        share = share_of_stride(gait, plan.offsets[leg])
        due = share < LATE_SHARE * air
        return 1.0 + away if due else (away if away > TOO_FAR_WALKING else 0.0)
    if state.body[FOLLOWS] == 0 and _has_arrived(gait):  # homes do not move, so a foot that is near enough stays
        return away if away > TOO_FAR_WALKING else 0.0
    too_far = TIDY_DISTANCE if gait[STOPPED] < TIDY_SECONDS else TOO_FAR
    if away > too_far or turned > TOO_TURNED:
        return away / too_far + turned / TOO_TURNED
    return 0.0


@compiled(inner=True)
def _begin_swing(state, leg, walks):
    """Lift a foot."""
    seconds = STEP_SECONDS
    if walks:
        seconds = min(max((1 - state.gait[DUTY]) / state.gait[RATE], MIN_SWING_SECONDS), MAX_SWING_SECONDS)
    state.seconds[leg], state.swing[leg] = seconds, 1e-9
    write_row(state.origin, leg, row_of(state.place, leg))
    state.yaw[leg, 1] = state.yaw[leg, 0]


@compiled(inner=True)
def _swing(plan, state, leg, elapsed):
    """Move a foot that swings; put it down at the end."""
    if state.lift[leg, 1] > 0:
        _stand_at_home(plan, state, leg)
        return
    if state.swing[leg] == 0:
        home = _home(plan, state, leg, 0.0)
        way = minus(row_of(state.place, leg), home)
        most = MAX_AWAY * plan.leg_length / max(length(way), 1e-9 * plan.leg_length)
        if state.body[JUMP] > MIN_JUMP * plan.leg_length:
            most = remaining(JUMP_SECONDS, elapsed)
            state.yaw[leg, 0] += (1 - most) * (state.body[HEADING] - state.yaw[leg, 0])
        if most < 1:  # in a jump, or where the leg does not reach: it drags its foot rather than tear
            write_row(state.place, leg, plus(home, way, most))
        return
    state.swing[leg] = min(1.0, state.swing[leg] + elapsed / state.seconds[leg])
    share = state.swing[leg]
    if share <= AIM_SHARE or elapsed >= state.seconds[leg]:
        _aim(plan, state, leg, (1 - share) * state.seconds[leg])
    way = minus(row_of(state.aim, leg), row_of(state.origin, leg))
    ahead = min(max((share - LIFTING_SHARE) / (1 - 2 * LIFTING_SHARE), 0.0), 1.0)
    done = ahead * ahead * ahead * (ahead * (6 * ahead - 15) + 10)  # minimum jerk
    arc = min(ARC_HEIGHT + ARC_SLOPE * length(way) / plan.leg_length, MAX_ARC_HEIGHT) * plan.leg_length
    rise = arc * 16 * (share * (1 - share)) ** 2
    now = plus(plus(row_of(state.origin, leg), way, done), row_of(plan.axes, 1), rise)
    write_row(state.place, leg, now)
    state.yaw[leg, 0] = state.yaw[leg, 1] + done * (state.yaw[leg, 2] - state.yaw[leg, 1])
    if share == 1:
        state.swing[leg] = 0.0


@compiled(inner=True)
def _aim(plan, state, leg, left):
    """Choose where a swing ends: where the foot's home will be in the middle of its time on the floor."""
    stance = state.gait[DUTY] / state.gait[RATE] if state.gait[WALKS] > 0 else 0.0
    home = _home(plan, state, leg, left)
    way = minus(_home(plan, state, leg, left + stance / 2), home)
    size = length(way)
    if size > MAX_AHEAD * plan.leg_length:
        way = scaled(way, MAX_AHEAD * plan.leg_length / size)
    write_row(state.aim, leg, plus(home, way, 1.0))
    state.yaw[leg, 2] = _heading(state, left + stance / 2)


@compiled(inner=True)
def _put_leg(plan, state, leg, motions, root, changed):
    """Bend a leg so that its ankle is where its foot stands or swings, and turn its foot as it is at rest."""
    up, carrier = row_of(plan.axes, 1), plan.carriers[leg]
    jump = state.body[JUMP]
    hip = row_of(plan.hips, leg)
    if carrier >= 0:
        hip = moved(motions[carrier], hip)
    there = plus(minus(row_of(state.place, leg), root), up, jump)
    base = quat.about(up, (state.body[HEADING] + state.yaw[leg, 0]) / 2)
    ankle = stretch(plan.chains, leg, motions, plan.heads, base, hip, there)
    for bone in plan.chains.bones[leg]:
        if bone >= 0:
            changed[bone] = True
    foot = plan.feet[leg]
    if foot >= 0:
        hanging = FOOT_PITCH * math.sin(math.pi * min(1.0, state.swing[leg] / 0.85))
        size = max(length(minus(row_of(plan.tails, foot), row_of(plan.heads, foot))), MIN_FOOT_LENGTH * plan.leg_length)
        rise = max(0.0, dot(minus(row_of(state.place, leg), row_of(plan.ankles, leg)), up))
        hanging = min(hanging, math.asin(min(1.0, FOOT_CLEARANCE * rise / size)))
        turn = quat.product(quat.about(up, state.yaw[leg, 0]), quat.about(row_of(plan.axes, 0), hanging))
        place(motions[foot], turn, plan.heads[foot], ankle)
        changed[foot] = True
