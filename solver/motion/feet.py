"""Foot locking: while a performer's foot rests (`resting_feet`), the character's foot keeps its position on the floor.

A held foot is flat as in the rest pose. First the pelvis is tilted to one side so that no foot is lower than one that
rests: the same directions of the legs end at different heights if the hips of the character are wider than the
performer's. Then the whole character is shifted so that its legs turn as little as possible, and each leg bends by the
remaining distance. A foot is released when the performer's foot moves or rises, or when it is held too far from where
the leg points; then it eases back. The height of the character follows from its legs: the lower foot is on the floor,
unless both feet of the performer leave it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.model.vectors import cross, dot, length, minus, plus, row_of, scaled, unit, write_row
from solver.motion import quaternions as quat
from solver.motion.resting_feet import HEIGHT, LIFT, TILT, TIME, VOTE_FRAMES, remaining, resting_feet
from solver.motion.retarget import RETURN_SECONDS
from solver.motion.two_bones import bend, carry_along, move_along, moved, place, pole

MAX_HOLD_METRES = 0.18
"""Largest level distance between a held foot and where the leg points, in the performer's metres."""

HOLD_AGAIN_METRES = 0.03
"""Distance between a released foot and where the leg points below which it can be held again, in the performer's
metres."""

SLACK_METRES = 0.01
"""Largest height of a resting foot over the floor for which no leg bends, in the performer's metres. A straight leg
that is shortened by 1 cm turns by 6° at hip and knee."""

STAY_WEIGHT = 0.25
"""Weight of the performer's position, relative to that of a held foot, when the character is shifted."""

SHIFT_SECONDS = 0.1
"""Time constant with which held feet shift the character, in seconds."""

SHIFT_BACK_SECONDS = 0.5
"""Time constant with which the character returns while no foot is held, in seconds."""

SETTLE_SECONDS = 0.08
"""Time constant with which a held foot becomes flat on the floor, in seconds."""

HEADING_SECONDS = 4.0
"""Time constant with which the heading of a held foot follows the performer's, in seconds. It is long, because sensors
measure the heading imprecisely and a foot that turns slides."""

MAX_TILT = math.radians(20)
"""Largest angle by which the pelvis is tilted to one side, in radians."""

MAX_VERTICAL_SPEED = 3.0
"""Largest speed with which the character rises or sinks, in the performer's metres per second."""


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
    """Constants of the character."""

    legs: NDArray[np.int64]  # (l, 3): thigh, shin and foot
    joints: NDArray[np.int64]  # (l,)
    heads: NDArray[np.float64]  # (b, 3)
    tails: NDArray[np.float64]  # (b, 3)
    parents: NDArray[np.int64]  # (b,)
    poles: NDArray[np.float64]  # (l, 3): direction in which the knee of a straight leg bends at rest
    up: NDArray[np.float64]  # (3,)
    metre: float  # mesh units per metre of the performer
    pelvis: int  # the bone that is tilted, −1 for none


class _State(NamedTuple):
    """The state between frames."""

    place: NDArray[np.float64]  # (l, 3): position at which each foot is held
    offset: NDArray[np.float64]  # (l, 3): from where the leg points to the foot's position
    held: NDArray[np.float64]  # (l,): 1 while a foot is held
    stands: NDArray[np.float64]  # (l,): weight of rest, 0 to 1
    flat: NDArray[np.float64]  # (l,): weight of the flat foot, 0 to 1
    heading: NDArray[np.float64]  # (l,): angle about the upright axis, radians
    last: NDArray[np.float64]  # (l, 3): the performer's foot in the last frame; NaN before it was tracked
    velocity: NDArray[np.float64]  # (l, 3); NaN before it was tracked twice
    noise: NDArray[np.float64]  # (l,): mean deviation from that velocity, metres per second
    still: NDArray[np.float64]  # (l,): seconds for which each foot has been slow
    votes: NDArray[np.float64]  # (l, VOTE_FRAMES)
    shift: NDArray[np.float64]  # (3,): of the whole character, level
    clock: NDArray[np.float64]  # (5,): time; height of the performer's floor; the character's jump, height and tilt


class Feet:
    """Holds the feet of a character on the floor.

    Parameters
    ----------
    bones : Bones
    legs : sequence of Leg
        At least one; at rest their feet are flat on the floor.
    metre : float
        Mesh units per metre of the performer: the ratio of their leg lengths.
    basis : (3, 3) float64, optional
        Rows: the mesh file's directions of the character's left, up and forward.
    pelvis : int, optional
        The bone that is tilted to one side where this keeps legs from bending, if two legs are attached to it.
    """

    def __init__(
        self,
        bones: Bones,
        legs: Sequence[Leg],
        metre: float,
        basis: NDArray[np.float64] | None = None,
        *,
        pelvis: int | None = None,
    ) -> None:
        basis = np.eye(3) if basis is None else np.asarray(basis, dtype=np.float64)
        count, thighs = len(legs), [leg.thigh for leg in legs]
        self._plan = _Plan(
            legs=np.array([(leg.thigh, leg.shin, leg.foot) for leg in legs], dtype=np.int64),
            joints=np.array([leg.joint for leg in legs], dtype=np.int64),
            heads=np.ascontiguousarray(bones.heads, dtype=np.float64),
            tails=np.ascontiguousarray(bones.tails, dtype=np.float64),
            parents=bones.parents,
            poles=np.array([pole(bones, leg.thigh, leg.shin, basis[2]) for leg in legs]),
            up=np.ascontiguousarray(basis[1]),
            metre=float(metre),
            pelvis=-1 if pelvis is None or count != 2 or np.any(bones.parents[thighs] != pelvis) else pelvis,
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
            clock=np.array([-np.inf, np.nan, 0.0, 0.0, 0.0]),
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
        time, positions, confidence
            As for `limb_motion.LimbMotion.step`.
        motions : (b, 4, 3) float64
            From `limb_motion.LimbMotion.step`; written to.
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
        """(l, 3) float64: positions of held feet, mesh file's coordinates; NaN for others."""
        return np.where(self.held[:, None], self._state.place, np.nan)

    def hold(self, places: NDArray[np.float64]) -> None:
        """Hold feet from the first frame on, at the `places` of another instance."""
        held = np.isfinite(places).all(axis=1)
        self._state.place[held], self._state.held[:] = places[held], held
        self._state.votes[held], self._state.flat[held], self._state.stands[held] = 1.0, 1.0, 1.0


@compiled(waits=False)
def _step(plan, state, time, positions, confidence, motions, root):
    """Update the state, the motions and the root of a frame."""
    clock = state.clock
    began = math.isfinite(clock[TIME])
    elapsed = max(0.0, time - clock[TIME]) if began else math.inf
    clock[TIME] = time
    rests, low = resting_feet(plan, state, positions, confidence, elapsed, began)
    _ease(state.stands, rests, elapsed)
    for leg in range(len(low)):
        low[leg] = low[leg] or rests[leg]
    _ease(state.flat, low, elapsed)  # the measured pitch of a low foot is mostly noise
    heights = _heights(plan, state, motions)
    if plan.pelvis >= 0:
        _tilt_pelvis(plan, state, motions, heights, elapsed)
    _set_height(plan, state, heights, root, elapsed)
    _shift(plan, state, motions, root, elapsed)
    changed, before = np.zeros(len(motions), dtype=np.bool_), motions.copy()
    for leg in range(len(plan.legs)):
        _hold(plan, state, leg, rests[leg], motions, root, elapsed, began)
        _bend(plan, state, leg, motions, changed, elapsed)
    carry_along(motions, before, plan.parents, changed)


@compiled(inner=True)
def _ease(shares, wanted, elapsed):
    """Ease shares towards 1 where wanted, and towards 0 elsewhere."""
    for leg in range(len(shares)):
        goal = 1.0 if wanted[leg] else 0.0
        shares[leg] = goal + remaining(SETTLE_SECONDS, elapsed) * (shares[leg] - goal)


@compiled(inner=True)
def _heights(plan, state, motions):
    """Return the heights of the feet over their height at rest, as the legs point and without the root's motion."""
    heights = np.empty(len(plan.legs))
    for leg in range(len(plan.legs)):
        shin, foot = plan.legs[leg, 1], plan.legs[leg, 2]
        ankle = plan.tails[shin]
        height = dot(minus(moved(motions[shin], ankle), ankle), plan.up)
        # the height of a flat foot is that of its ankle; the tip of another may be lower
        if foot >= 0:
            tip = dot(minus(moved(motions[foot], plan.tails[foot]), plan.tails[foot]), plan.up)
            height += (1 - state.flat[leg]) * min(0.0, tip - height)
        heights[leg] = height
    return heights


@compiled(inner=True)
def _tilt_pelvis(plan, state, motions, heights, elapsed):
    """Tilt the pelvis to one side so that no foot is lower than one that rests; update the heights."""
    left, right = plan.legs[0, 0], plan.legs[1, 0]
    hips = minus(moved(motions[left], plan.heads[left]), moved(motions[right], plan.heads[right]))
    width, axis = length(hips), unit(cross(hips, plan.up))
    if length(axis) == 0:  # both hips are at one place, or one above the other
        return
    higher = heights[0] - heights[1]
    wanted = state.stands[1] * max(0.0, -higher) - state.stands[0] * max(0.0, higher)
    rise = min(max(dot(hips, plan.up) / width, -1.0), 1.0)
    angle = math.asin(min(max(rise + wanted / width, -1.0), 1.0)) - math.asin(rise)
    angle = min(max(angle, -MAX_TILT), MAX_TILT)
    angle += remaining(SHIFT_SECONDS, elapsed) * (state.clock[TILT] - angle)
    state.clock[TILT] = angle
    T, head = motions[plan.pelvis], plan.heads[plan.pelvis]
    before = motions.copy()
    place(T, quat.product(quat.about(axis, angle), quat.of_rows(T)), head, moved(T, head))
    move_along(motions, before, plan.heads, plan.parents)
    for leg in range(2):
        thigh = plan.legs[leg, 0]
        heights[leg] += dot(minus(motions[thigh, 3], before[thigh, 3]), plan.up)


@compiled(inner=True)
def _set_height(plan, state, heights, root, elapsed):
    """Write the root's height with which the lower foot is on the floor, or above it by the height of a jump.

    If both feet rest, both are on the floor within `SLACK_METRES`.
    """
    lowest, apart = math.inf, -math.inf
    for leg in range(len(heights)):
        lowest = min(lowest, heights[leg])
    for leg in range(len(heights)):
        apart = max(apart, state.stands[leg] * (heights[leg] - lowest))
    wanted = state.clock[LIFT] - lowest - max(0.0, apart - plan.metre * SLACK_METRES)
    largest = plan.metre * MAX_VERTICAL_SPEED * elapsed
    last = state.clock[HEIGHT]
    state.clock[HEIGHT] = min(max(wanted, last - largest), last + largest)
    rise = state.clock[HEIGHT] - dot(root, plan.up)
    for axis in range(3):
        root[axis] += rise * plan.up[axis]


@compiled(inner=True)
def _shift(plan, state, motions, root, elapsed):
    """Shift the root along the floor so that legs with held feet turn least.

    The shift s minimises Σ ‖t − s‖² + `STAY_WEIGHT` ‖s‖² over the ways t from where those legs point to where the feet
    are.
    """
    wanted, count = (0.0, 0.0, 0.0), 0
    for leg in range(len(plan.legs)):
        if state.held[leg] > 0:
            wanted = plus(wanted, _way(plan, state, leg, motions, root), 1.0)
            count += 1
    fading = remaining(SHIFT_SECONDS if count else SHIFT_BACK_SECONDS, elapsed)
    level = plus(wanted, plan.up, -dot(wanted, plan.up))
    for axis in range(3):
        wanted_shift = level[axis] / (count + STAY_WEIGHT)
        state.shift[axis] = wanted_shift + fading * (state.shift[axis] - wanted_shift)
        root[axis] += state.shift[axis]


@compiled(inner=True)
def _way(plan, state, leg, motions, root):
    """Return the vector from where a leg points to where its foot is held."""
    shin = plan.legs[leg, 1]
    points = plus(moved(motions[shin], plan.tails[shin]), root, 1.0)
    return minus(state.place[leg], points)


@compiled(inner=True)
def _hold(plan, state, leg, rests, motions, root, elapsed, began):
    """Decide whether a foot is held, and update its offset from where its leg points."""
    thigh, shin, up = plan.legs[leg, 0], plan.legs[leg, 1], plan.up
    floor = dot(plan.tails[shin], up)
    points = plus(moved(motions[shin], plan.tails[shin]), root, 1.0)
    hip = plus(moved(motions[thigh], plan.heads[thigh]), root, 1.0)
    offset = row_of(state.offset, leg)
    if state.held[leg] == 0:
        fading = remaining(RETURN_SECONDS, elapsed) if began else 0.0
        offset = scaled(offset, fading)
        if rests and length(offset) < HOLD_AGAIN_METRES * plan.metre:
            state.held[leg] = 1.0
            write_row(state.place, leg, plus(points, offset, 1.0))
    if state.held[leg] > 0:
        offset = _way(plan, state, leg, motions, root)
        level = plus(offset, up, -dot(offset, up))
        if not rests or length(plus(level, state.shift, 1.0)) > MAX_HOLD_METRES * plan.metre:
            state.held[leg] = 0.0
        # the height at which the straight leg ends, if that is near the floor
        there = plus(points, level, 1.0)
        away = minus(there, hip)
        high = dot(away, up)
        straight = length(minus(points, hip)) ** 2 - (dot(away, away) - high * high)
        high = dot(hip, up) - math.sqrt(max(0.0, straight))
        wanted = min(max(high, floor), floor + plan.metre * SLACK_METRES)
        last = dot(state.place[leg], up)
        high = wanted + remaining(SETTLE_SECONDS, elapsed) * (last - wanted)
        there = plus(there, up, high - dot(there, up))
        write_row(state.place, leg, there)
        offset = minus(there, points)
    sunk = floor - dot(plus(points, offset, 1.0), up)
    write_row(state.offset, leg, plus(offset, up, max(0.0, sunk)))


@compiled(inner=True)
def _bend(plan, state, leg, motions, changed, elapsed):
    """Bend a leg by its foot's offset, and turn its foot flat by its weight."""
    thigh, shin, foot = plan.legs[leg, 0], plan.legs[leg, 1], plan.legs[leg, 2]
    ankle = moved(motions[shin], plan.tails[shin])
    if length(state.offset[leg]) > 1e-9 * plan.metre:
        ankle = bend(motions, plan.heads, plan.tails, thigh, shin, plan.poles[leg], state.offset[leg])
        changed[thigh] = changed[shin] = True
    if foot >= 0:
        turn = quat.of_rows(motions[foot])
        _follow_heading(state, leg, _twist_about(turn, plan.up), elapsed)
        if state.flat[leg] > 1e-6 or changed[shin]:
            level = quat.to_vector(quat.product(quat.about(plan.up, state.heading[leg]), quat.inverse(turn)))
            level = quat.from_vector(scaled(level, state.flat[leg]))
            place(motions[foot], quat.product(level, turn), plan.heads[foot], ankle)
            changed[foot] = True


@compiled(inner=True)
def _follow_heading(state, leg, heading, elapsed):
    """Update the heading of a foot, slowly while it is held."""
    away = (state.heading[leg] - heading + math.pi) % (2 * math.pi) - math.pi
    fading = remaining(HEADING_SECONDS, elapsed) if state.held[leg] > 0 else 0.0
    state.heading[leg] = heading + fading * away


@compiled(inner=True)
def _twist_about(q, axis):
    """Return the angle of the part of a rotation that is about a unit axis."""
    return 2 * math.atan2(q[1] * axis[0] + q[2] * axis[1] + q[3] * axis[2], q[0])
