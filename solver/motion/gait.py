"""When the legs of a walking body step: cadence by dynamic similarity, phases by the number of legs.

Animals of all sizes walk alike at the same Froude number Fr = v² / (g L), with leg length L (Alexander 1976). Stride
length, the share of time on the floor and the change from walk to trot follow from it. If the performer's feet are seen
to alternate, their cadence and phase are used instead, so a person who walks in place makes a character walk in place.
"""

import math

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.motion.limb_directions import smooth_step
from solver.motion.resting_feet import remaining

GRAVITY = 9.81
"""Acceleration of gravity, in metres per second squared."""

STRIDE_FACTOR, STRIDE_POWER = 2.3, 0.3
"""A stride is 2.3 L Fr^0.3 long (Alexander 1976)."""

MIN_PERIOD, MAX_PERIOD = 0.4, 1.4
"""Shortest and longest stride, in seconds."""

SLOW_DUTY, FAST_DUTY, FAST_FROUDE = 0.7, 0.5, 0.5
"""Share of a stride for which a foot is on the floor: at a slow walk, and from this Froude number on. It is at least
half, so that half of the feet always stand."""

TROT_FROUDE = 0.3, 0.6
"""Froude numbers above which four legs begin to trot, and trot. Animals change near 0.5."""

WALK_SPEED, STOP_SPEED = 0.12, 0.06
"""Speeds, as a share of √(g L), above which a body begins to walk and below which it stops."""

MAX_STANCE_SHARE = 0.8
"""Longest way of the body over a foot that stands, in leg lengths."""

MIN_STEP_SECONDS, MAX_STEP_SECONDS = 0.18, 1.1
"""Shortest and longest time between a performer's two feet lifting that is one step of a walk."""

SEEN_STEPS = 1.6
"""Number of steps without which a performer's walk has ended."""

CATCH_UP_SECONDS = 0.25
"""Time constant, in seconds, with which the phase follows the performer's steps."""

TROT_SECONDS = 0.4
"""Time constant, in seconds, of the change between walk and trot."""

RESTED_SECONDS = 0.35
"""Time for which both of a performer's feet must rest until the performer stands, in seconds. It is longer than both
feet rest during a walk."""

FIRST_SHARE = 0.5
"""Share of its time in the air at which the first leg of a walk begins: its first step is half a step."""

UNREST_RATE = 3.0
"""Rate at which this time shrinks while a foot does not rest: sensors lose feet for some frames."""

PHASE, RATE, BEHIND, DUTY, TROT, WALKS, LAST_FOOT, LIFTED_AT, STEP_TIME, RESTED, STOPPED = range(11)
"""Entries of a gait's state: phase 0 to 1; strides per second; phase by which it is behind the performer's; share of
time on the floor; share of the trot; 1 while walking; performer's foot that lifted last, −1 for none; when; time
between two lifts, 0 until known; seconds for which both feet have rested; seconds since the walk ended."""


def new_gait() -> NDArray[np.float64]:
    """Return the state of a body that stands."""
    state = np.zeros(11)
    state[LAST_FOOT], state[LIFTED_AT], state[DUTY], state[STOPPED] = -1.0, -np.inf, SLOW_DUTY, np.inf
    return state


def phases(sides: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the phase of each leg in a walk and in a trot.

    Parameters
    ----------
    sides : (l,) int64
        0 for legs on the left, 1 for legs on the right.
    rows : (l,) int64
        Number of the pair, from the hind legs to the front.

    Returns
    -------
    (l, 2) float64
        Two rows walk left hind, left fore, right hind, right fore. Any other number of rows alternates, in tripods with
        three rows and in fours with four.
    """
    alternating = ((sides + rows) % 2) / 2.0
    walk = (sides / 2.0 + rows / 4.0) if rows.max(initial=0) == 1 else alternating
    return np.stack([walk, alternating], axis=1)


@compiled(inner=True)
def update(gait, time, elapsed, lifted, rests, lost, speed, leg_length, metre):
    """Update the gait of a body.

    Parameters
    ----------
    gait : (11,) float64
        Written to.
    time, elapsed : float
    lifted, rests : (2,) bool
        Which of the performer's feet are in the air, and which rest.
    lost : bool
        Whether the sensor does not see one of them.
    speed : float
        Of the body, or of its feet if it turns on the spot; mesh units per second.
    leg_length, metre : float
        Mesh units; mesh units per metre.
    """
    _watch_steps(gait, time, elapsed, lifted, rests, lost)
    natural = math.sqrt(GRAVITY * metre * leg_length)
    froude = (speed / natural) ** 2
    seen = gait[STEP_TIME] > 0 and time - gait[LIFTED_AT] < SEEN_STEPS * gait[STEP_TIME]
    stands = gait[RESTED] > RESTED_SECONDS
    walked = gait[WALKS] > 0
    # a body that turns over feet that rest does not begin to walk
    moves = speed > (STOP_SPEED if walked else WALK_SPEED) * natural and (walked or not (rests[0] and rests[1]))
    gait[WALKS] = 1.0 if (seen or moves) and not stands else 0.0
    gait[STOPPED] = 0.0 if gait[WALKS] > 0 else gait[STOPPED] + elapsed
    gait[DUTY] = max(FAST_DUTY, SLOW_DUTY - (SLOW_DUTY - FAST_DUTY) * froude / FAST_FROUDE)
    trot = smooth_step(froude, TROT_FROUDE)
    gait[TROT] = trot + remaining(TROT_SECONDS, elapsed) * (gait[TROT] - trot)
    if gait[WALKS] == 0:
        gait[BEHIND] = 0.0
        return
    if not walked and not seen:
        gait[PHASE] = FIRST_SHARE * (1 - gait[DUTY])
    period = 2 * gait[STEP_TIME]
    if not seen:
        stride = STRIDE_FACTOR * leg_length * froude**STRIDE_POWER
        period = min(max(stride / max(speed, 1e-9 * natural), MIN_PERIOD), MAX_PERIOD)
    longest = MAX_STANCE_SHARE * leg_length / (gait[DUTY] * max(speed, 1e-9 * natural))
    gait[RATE] = 1 / max(min(period, longest), MIN_PERIOD)
    caught = gait[BEHIND] * (1 - remaining(CATCH_UP_SECONDS, elapsed))
    gait[BEHIND] -= caught
    gait[PHASE] = (gait[PHASE] + max(0.0, gait[RATE] * elapsed + caught)) % 1.0


@compiled(inner=True)
def _watch_steps(gait, time, elapsed, lifted, rests, lost):
    """Update the cadence and phase of a performer's steps. A stand ends when both feet have stepped, or are lost."""
    if rests[0] and rests[1]:
        gait[RESTED] = min(gait[RESTED] + elapsed, 2 * RESTED_SECONDS)
    elif lost or gait[RESTED] <= RESTED_SECONDS:
        gait[RESTED] = max(gait[RESTED] - UNREST_RATE * elapsed, 0.0)
    if gait[RESTED] > RESTED_SECONDS:
        gait[STEP_TIME] = 0.0
    for foot in range(2):
        other = 1 - foot
        if not (lifted[foot] and not lifted[other]) or gait[LAST_FOOT] == foot:
            continue
        since = time - gait[LIFTED_AT]
        if since < MIN_STEP_SECONDS:
            continue
        if gait[LAST_FOOT] >= 0 and since < MAX_STEP_SECONDS:
            gait[STEP_TIME] = since if gait[STEP_TIME] == 0 else (gait[STEP_TIME] + since) / 2
            gait[RESTED] = 0.0
        else:
            gait[STEP_TIME] = 0.0
        gait[LAST_FOOT], gait[LIFTED_AT] = foot, time
        wanted = 0.0 if foot == 0 else 0.5  # the hind leg of that side lifts
        if gait[WALKS] > 0:
            gait[BEHIND] = (wanted - gait[PHASE] + 0.5) % 1.0 - 0.5
        else:
            gait[PHASE] = wanted


@compiled(inner=True)
def share_of_stride(gait, offsets):
    """Return how far a leg is in its stride, 0 to 1; it is in the air while this is below 1 − duty.

    Parameters
    ----------
    gait : (11,) float64
    offsets : (2,) float64
        From `phases`: a leg with the offset φ lifts when the gait's phase is φ.
    """
    offset = offsets[0] + gait[TROT] * ((offsets[1] - offsets[0] + 0.5) % 1.0 - 0.5)
    return (gait[PHASE] - offset) % 1.0
