"""Feet that stand: where a performer's foot rests, the character's stays where it is, on the floor.

A foot of the performer that is slow, and near the lowest place of either foot, rests. The character's foot is then held
at its place, flat as at rest. The whole character gives way first: it is shifted so that the legs have to turn as
little as they can, and a leg takes what is left. A foot is let go when the performer's moves or rises, or when it would
have to be held too far from where the leg points, and closes the distance smoothly. The height of the whole character
follows from its legs: the lower foot is on the floor, unless both feet of the performer leave it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.motion import quaternions as quat
from solver.motion.retarget import MAX_JOINT_METRES, RETURN_SECONDS
from solver.motion.two_bones import bend, carry_along, length, minus, moved, place, plus, pole

REST_SPEED, RELEASE_SPEED = 0.15, 0.4
"""Metres per second of a performer's foot below which it comes to rest, and above which it no longer rests."""

REST_HEIGHT_METRES, RELEASE_HEIGHT_METRES = 0.04, 0.06
"""Metres over the floor below which a performer's foot comes to rest, and above which it no longer rests."""

STILL_SECONDS = 0.2
"""How long the lower foot is slow until the floor is where it is, in seconds; longer than the top of a jump."""

MAX_HOLD_METRES = 0.15
"""Metres of the performer's that a foot is held at most from where the leg points."""

HOLD_AGAIN_METRES = 0.03
"""Metres of the performer's to which a foot that was let go comes near where the leg points before it is held again."""

MIN_JUMP_METRES = 0.05
"""Metres that both of a performer's feet leave the floor before the character leaves its own."""

SLACK_METRES = 0.01
"""Metres of the performer's that a foot at rest may be over the floor, so that no leg bends for it: a straight leg that
is shortened by one centimetre turns by 6° at hip and knee."""

STAY_WEIGHT = 0.25
"""Weight with which the character stays where the performer is, against that of one held foot that shifts it."""

SHIFT_SECONDS = 0.1
"""Time constant with which the character is shifted towards where held feet have it, in seconds."""

SHIFT_BACK_SECONDS = 0.5
"""The same with which it comes back while no foot is held."""

VELOCITY_SECONDS = 0.05
"""Time constant of the mean velocity of a performer's foot, in seconds: joints shake, though they are smoothed."""

NOISE_SECONDS = 1.0
"""Time constant of the mean distance from that velocity, which tells how much a foot's joint shakes."""

NOISE_SHARE = 0.5
"""Share of this noise that is added to the speeds at which a foot comes to rest and no longer rests."""

FLOOR_SECONDS = 0.2
"""Time constant with which the floor is where the lower foot rests, in seconds."""

DRIFT_SECONDS = 2.0
"""The same where no foot rests: long against a jump, and short against a walk towards a tilted sensor."""

SETTLE_SECONDS = 0.08
"""Time constant with which a foot that is held comes to lie flat on the floor, in seconds."""

HEADING_SECONDS = 1.0
"""The same with which the heading of a foot that is held follows the performer's: sensors see that of feet badly."""

MIN_CONFIDENCE = 0.6
"""Confidence from which a performer's foot counts; sensors guess where feet out of sight are."""

MAX_VERTICAL_SPEED = 3.0
"""Metres per second of the performer's by which the character rises or sinks at most."""

VOTE_FRAMES = 3
"""Frames of which most must say that a foot rests."""


@dataclass(frozen=True)
class Leg:
    """A leg of the character and the foot of the performer that it follows.

    Attributes
    ----------
    thigh, shin, foot : int
        Bones; foot is −1 where the leg ends at the ankle.
    joint : int
        The performer's ankle.
    """

    thigh: int
    shin: int
    foot: int
    joint: int


class _Plan(NamedTuple):
    """What does not change from frame to frame."""

    legs: NDArray[np.int64]  # (l, 3): thigh, shin and foot
    joints: NDArray[np.int64]  # (l,)
    heads: NDArray[np.float64]  # (b, 3)
    tails: NDArray[np.float64]  # (b, 3)
    parents: NDArray[np.int64]  # (b,)
    poles: NDArray[np.float64]  # (l, 3): where the knee of a straight leg bends to at rest
    up: NDArray[np.float64]  # (3,)
    metre: float  # mesh units for a metre of the performer's


class _State(NamedTuple):
    """What is carried from frame to frame."""

    place: NDArray[np.float64]  # (l, 3): where each foot is held
    offset: NDArray[np.float64]  # (l, 3): from where the leg points to where the foot is shown
    held: NDArray[np.float64]  # (l,): 1 while a foot is held
    stands: NDArray[np.float64]  # (l,): how far it has come to rest, 0 to 1
    flat: NDArray[np.float64]  # (l,): how far it lies flat, 0 to 1
    heading: NDArray[np.float64]  # (l,): about the upright axis, in which it lies, radians
    last: NDArray[np.float64]  # (l, 3): the performer's foot in the last frame; NaN before it was seen
    velocity: NDArray[np.float64]  # (l, 3); NaN before it was seen twice
    noise: NDArray[np.float64]  # (l,): mean distance from that velocity, metres per second
    still: NDArray[np.float64]  # (l,): seconds for which each foot has been slow
    votes: NDArray[np.float64]  # (l, VOTE_FRAMES)
    shift: NDArray[np.float64]  # (3,): of the whole character, level
    clock: NDArray[np.float64]  # (4,): time; height of the performer's floor; of the character over its own; its root's


TIME, FLOOR, LIFT, HEIGHT = range(4)


class Feet:
    """Holds the feet of a character on the floor.

    Parameters
    ----------
    bones : Bones
    legs : sequence of Leg
        At least one; at rest their feet are flat on the floor.
    metre : float
        Mesh units that the character travels for a metre of the performer's: the ratio of their legs' lengths.
    basis : (3, 3) float64, optional
        Rows: the mesh file's directions of the character's left, up and forward.
    """

    def __init__(
        self, bones: Bones, legs: Sequence[Leg], metre: float, basis: NDArray[np.float64] | None = None
    ) -> None:
        basis = np.eye(3) if basis is None else np.asarray(basis, dtype=np.float64)
        count = len(legs)
        chains = np.array([(leg.thigh, leg.shin, leg.foot) for leg in legs], dtype=np.int64)
        self._plan = _Plan(
            legs=chains,
            joints=np.array([leg.joint for leg in legs], dtype=np.int64),
            heads=np.ascontiguousarray(bones.heads, dtype=np.float64),
            tails=np.ascontiguousarray(bones.tails, dtype=np.float64),
            parents=bones.parents,
            poles=np.array([pole(bones, leg.thigh, leg.shin, basis[2]) for leg in legs]),
            up=np.ascontiguousarray(basis[1]),
            metre=float(metre),
        )
        self._state = _State(
            place=np.zeros((count, 3)),
            offset=np.zeros((count, 3)),
            held=np.zeros(count),
            stands=np.zeros(count),
            flat=np.zeros(count),
            heading=np.zeros(count),
            last=np.full((count, 3), np.nan),
            velocity=np.full((count, 3), np.nan),
            noise=np.zeros(count),
            still=np.zeros(count),
            votes=np.zeros((count, VOTE_FRAMES)),
            shift=np.zeros(3),
            clock=np.array([-np.inf, np.nan, 0.0, 0.0]),
        )

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
        time : float
            Seconds, increasing from call to call.
        positions : (j, 3) float64
            The performer's joints: metres, character axes (up +y).
        confidence : (j,) float32
            0 where a joint is lost.
        motions : (b, 4, 3) float64
            Motions of the bones without the root's translation, mesh file's coordinates; written to.
        root : (3,) float64
            Translation of the whole character, mesh file's coordinates; written to.
        """
        _step(self._plan, self._state, float(time), positions, confidence, motions, root)

    @property
    def held(self) -> NDArray[np.bool_]:
        """(l,) bool: the feet that are held."""
        return self._state.held > 0

    @property
    def places(self) -> NDArray[np.float64]:
        """(l, 3) float64: where the feet are held, mesh file's coordinates; NaN where they are not."""
        return np.where(self.held[:, None], self._state.place, np.nan)

    def hold(self, places: NDArray[np.float64]) -> None:
        """Hold feet from the first frame on, as `places` of another one says."""
        held = np.isfinite(places).all(axis=1)
        self._state.place[held], self._state.held[:] = places[held], held
        self._state.votes[held], self._state.flat[held], self._state.stands[held] = 1.0, 1.0, 1.0


@compiled
def _step(plan, state, time, positions, confidence, motions, root):
    """Bring the state up to a frame, and change its motions and the root."""
    clock = state.clock
    began = math.isfinite(clock[TIME])
    elapsed = max(0.0, time - clock[TIME]) if began else math.inf
    clock[TIME] = time
    rests, low = _performers_feet(plan, state, positions, confidence, elapsed, began)
    _ease(state.stands, rests, elapsed)
    _ease(state.flat, rests | low, elapsed)  # how a sensor has a low foot pitched is mostly noise
    _set_height(plan, state, motions, root, elapsed)
    _shift(plan, state, motions, root, elapsed)
    changed, before = np.zeros(len(motions), dtype=np.bool_), motions.copy()
    for leg in range(len(plan.legs)):
        _hold(plan, state, leg, rests[leg], motions, root, elapsed, began)
        _bend(plan, state, leg, motions, changed, elapsed)
    carry_along(motions, before, plan.parents, changed)


@compiled(inner=True)
def _fade(seconds, elapsed):
    """Return the share of a distance that is left after a time."""
    return math.exp(-elapsed / seconds)


@compiled(inner=True)
def _ease(shares, wanted, elapsed):
    """Bring shares nearer to 1 where something is wanted, and to 0 elsewhere."""
    for leg in range(len(shares)):
        goal = 1.0 if wanted[leg] else 0.0
        shares[leg] = goal + _fade(SETTLE_SECONDS, elapsed) * (shares[leg] - goal)


@compiled(inner=True)
def _performers_feet(plan, state, positions, confidence, elapsed, began):
    """Return which of the performer's feet rest and which are low; bring their velocities and the floor up to date."""
    _follow(plan, state, positions, confidence, elapsed)
    lowest, still = np.inf, 0.0
    for leg in range(len(plan.joints)):
        quick = _speed(state, leg) > REST_SPEED + NOISE_SHARE * state.noise[leg]
        state.still[leg] = 0.0 if quick or not began else state.still[leg] + elapsed
        if state.last[leg, 1] < lowest:  # which NaN is not
            lowest, still = state.last[leg, 1], state.still[leg]
    rests, low = np.zeros((2, len(plan.joints)), dtype=np.bool_)
    if not math.isfinite(lowest):
        return rests, low
    _find_floor(plan, state.clock, lowest, still, elapsed)
    for leg in range(len(plan.joints)):
        held = state.held[leg] > 0
        height = state.last[leg, 1] - state.clock[FLOOR]
        if state.still[leg] > STILL_SECONDS:
            height = min(height, state.last[leg, 1] - lowest)
        slow = _speed(state, leg) < (RELEASE_SPEED if held else REST_SPEED) + NOISE_SHARE * state.noise[leg]
        vote = 1.0 if slow and height < (RELEASE_HEIGHT_METRES if held else REST_HEIGHT_METRES) else 0.0
        if not began:
            state.votes[leg] = vote
        state.votes[leg, :-1] = state.votes[leg, 1:]
        state.votes[leg, -1] = vote
        rests[leg] = 2 * state.votes[leg].sum() > VOTE_FRAMES
        low[leg] = height < REST_HEIGHT_METRES
    return rests, low


@compiled(inner=True)
def _follow(plan, state, positions, confidence, elapsed):
    """Bring the velocities of the performer's feet up to date; a lost foot stays where it was."""
    fading = _fade(VELOCITY_SECONDS, elapsed)
    for leg in range(len(plan.joints)):
        j = plan.joints[leg]
        farthest = max(abs(positions[j, 0]), abs(positions[j, 1]), abs(positions[j, 2]))
        if not (confidence[j] > MIN_CONFIDENCE and farthest < MAX_JOINT_METRES):
            continue
        away = 0.0
        for axis in range(3):
            moved = positions[j, axis] - state.last[leg, axis]
            if 0 < elapsed < np.inf and math.isfinite(moved):
                velocity, mean = moved / elapsed, state.velocity[leg, axis]
                mean = mean if math.isfinite(mean) else velocity
                away += (velocity - mean) ** 2
                state.velocity[leg, axis] = velocity + fading * (mean - velocity)
            state.last[leg, axis] = positions[j, axis]
        if _speed(state, leg) < RELEASE_SPEED and elapsed < np.inf:
            away = math.sqrt(away)
            state.noise[leg] = away + _fade(NOISE_SECONDS, elapsed) * (state.noise[leg] - away)


@compiled(inner=True)
def _speed(state, leg):
    """Return how fast a performer's foot is; 0 before that is known."""
    speed = length(state.velocity[leg])
    return speed if math.isfinite(speed) else 0.0


@compiled(inner=True)
def _find_floor(plan, clock, lowest, still, elapsed):
    """Bring the height of the performer's floor up to date, and how far both feet are over it."""
    if not math.isfinite(clock[FLOOR]):
        clock[FLOOR] = lowest
    stands = still > STILL_SECONDS or (still > 0 and lowest < clock[FLOOR] + RELEASE_HEIGHT_METRES)
    seconds = FLOOR_SECONDS if stands or lowest < clock[FLOOR] else DRIFT_SECONDS
    clock[FLOOR] = lowest + _fade(seconds, elapsed) * (clock[FLOOR] - lowest)
    clock[LIFT] = plan.metre * max(0.0, lowest - clock[FLOOR] - MIN_JUMP_METRES)


@compiled(inner=True)
def _set_height(plan, state, motions, root, elapsed):
    """Write the root's height at which the feet are on the floor, or over it by what the performer jumps.

    That is the height of the lower foot, and of both if both rest but for `SLACK_METRES`: the leg that reaches less far
    must reach.
    """
    up, heights = (plan.up[0], plan.up[1], plan.up[2]), np.empty(len(plan.legs))
    for leg in range(len(plan.legs)):
        shin, foot = plan.legs[leg, 1], plan.legs[leg, 2]
        ankle = plan.tails[shin]
        height = quat.dot(minus(moved(motions[shin], ankle), ankle), up)
        # a foot that lies flat is as high as its ankle; another may be lower with its tip
        if foot >= 0:
            tip = quat.dot(minus(moved(motions[foot], plan.tails[foot]), plan.tails[foot]), up)
            height += (1 - state.flat[leg]) * min(0.0, tip - height)
        heights[leg] = height
    lowest = heights.min()
    apart = (state.stands * (heights - lowest)).max()
    wanted = state.clock[LIFT] - lowest - max(0.0, apart - plan.metre * SLACK_METRES)
    farthest = plan.metre * MAX_VERTICAL_SPEED * elapsed
    last = state.clock[HEIGHT]
    state.clock[HEIGHT] = min(max(wanted, last - farthest), last + farthest)
    rise = state.clock[HEIGHT] - quat.dot((root[0], root[1], root[2]), up)
    for axis in range(3):
        root[axis] += rise * up[axis]


@compiled(inner=True)
def _shift(plan, state, motions, root, elapsed):
    """Shift the root along the floor so that legs with held feet turn least.

    The shift s minimises Σ ‖t − s‖² + `STAY_WEIGHT` ‖s‖² over the ways t from where those legs point to where the feet
    are.
    """
    up = (plan.up[0], plan.up[1], plan.up[2])
    wanted, count = (0.0, 0.0, 0.0), 0
    for leg in range(len(plan.legs)):
        if state.held[leg] > 0:
            wanted = plus(wanted, _way(plan, state, leg, motions, root), 1.0)
            count += 1
    fading = _fade(SHIFT_SECONDS if count else SHIFT_BACK_SECONDS, elapsed)
    level = plus(wanted, up, -quat.dot(wanted, up))
    for axis in range(3):
        wanted_shift = level[axis] / (count + STAY_WEIGHT)
        state.shift[axis] = wanted_shift + fading * (state.shift[axis] - wanted_shift)
        root[axis] += state.shift[axis]


@compiled(inner=True)
def _way(plan, state, leg, motions, root):
    """Return the way from where a leg points to where its foot is held."""
    shin = plan.legs[leg, 1]
    points = plus(moved(motions[shin], plan.tails[shin]), root, 1.0)
    return minus((state.place[leg, 0], state.place[leg, 1], state.place[leg, 2]), points)


@compiled(inner=True)
def _hold(plan, state, leg, rests, motions, root, elapsed, began):
    """Decide whether a foot is held, and where it is shown against where its leg points."""
    thigh, shin, up = plan.legs[leg, 0], plan.legs[leg, 1], (plan.up[0], plan.up[1], plan.up[2])
    floor = quat.dot((plan.tails[shin, 0], plan.tails[shin, 1], plan.tails[shin, 2]), up)
    points = plus(moved(motions[shin], plan.tails[shin]), root, 1.0)
    hip = plus(moved(motions[thigh], plan.heads[thigh]), root, 1.0)
    offset = (state.offset[leg, 0], state.offset[leg, 1], state.offset[leg, 2])
    if state.held[leg] == 0:
        fading = _fade(RETURN_SECONDS, elapsed) if began else 0.0
        offset = quat.scaled(offset, fading)
        if rests and length(offset) < HOLD_AGAIN_METRES * plan.metre:
            state.held[leg] = 1.0
            state.place[leg] = plus(points, offset, 1.0)
    if state.held[leg] > 0:
        offset = _way(plan, state, leg, motions, root)
        level = plus(offset, up, -quat.dot(offset, up))
        if (
            not rests
            or length(plus(level, (state.shift[0], state.shift[1], state.shift[2]), 1.0)) > MAX_HOLD_METRES * plan.metre
        ):
            state.held[leg] = 0.0
        # as high as the leg reaches without bending, if that is near the floor
        there = plus(points, level, 1.0)
        away = minus(there, hip)
        high = quat.dot(away, up)
        straight = length(minus(points, hip)) ** 2 - (quat.dot(away, away) - high * high)
        high = quat.dot(hip, up) - math.sqrt(max(0.0, straight))
        wanted = min(max(high, floor), floor + plan.metre * SLACK_METRES)
        last = quat.dot((state.place[leg, 0], state.place[leg, 1], state.place[leg, 2]), up)
        high = wanted + _fade(SETTLE_SECONDS, elapsed) * (last - wanted)
        there = plus(there, up, high - quat.dot(there, up))
        state.place[leg] = there
        offset = minus(there, points)
    sunk = floor - quat.dot(plus(points, offset, 1.0), up)
    state.offset[leg] = plus(offset, up, max(0.0, sunk))


@compiled(inner=True)
def _bend(plan, state, leg, motions, changed, elapsed):
    """Bend a leg so that its ankle is where it is shown, and lay its foot flat as far as it rests."""
    thigh, shin, foot = plan.legs[leg]
    ankle = moved(motions[shin], plan.tails[shin])
    if length(state.offset[leg]) > 1e-9 * plan.metre:
        ankle = bend(motions, plan.heads, plan.tails, thigh, shin, plan.poles[leg], state.offset[leg])
        changed[thigh] = changed[shin] = True
    if foot >= 0:
        turn = quat.of_rows(motions[foot])
        _follow_heading(state, leg, _twist_about(turn, plan.up), elapsed)
        if state.flat[leg] > 1e-6 or changed[shin]:
            up = (plan.up[0], plan.up[1], plan.up[2])
            level = quat.to_vector(quat.product(quat.about(up, state.heading[leg]), quat.inverse(turn)))
            level = quat.from_vector(quat.scaled(level, state.flat[leg]))
            place(motions[foot], quat.product(level, turn), plan.heads[foot], ankle)
            changed[foot] = True


@compiled(inner=True)
def _follow_heading(state, leg, heading, elapsed):
    """Bring the heading of a foot up to date: slowly while it is held."""
    away = (state.heading[leg] - heading + math.pi) % (2 * math.pi) - math.pi
    fading = _fade(HEADING_SECONDS, elapsed) if state.held[leg] > 0 else 0.0
    state.heading[leg] = heading + fading * away


@compiled(inner=True)
def _twist_about(q, axis):
    """Return the angle of the part of a rotation that is about a unit axis."""
    return 2 * math.atan2(q[1] * axis[0] + q[2] * axis[1] + q[3] * axis[2], q[0])
