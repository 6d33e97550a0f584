"""Detection of a performer's resting feet, and of the floor that they rest on.

A foot rests if it is slow, and near the lowest position of either foot. `solver.motion.feet` keeps its state.
"""

import math

import numpy as np

from puppetline.compiled import compiled
from solver.model.vectors import length
from solver.motion.retarget import is_position

REST_SPEED, RELEASE_SPEED = 0.15, 0.4
"""Speeds of a performer's foot, in metres per second, below which it comes to rest and above which it stops resting."""

REST_HEIGHT_METRES, RELEASE_HEIGHT_METRES = 0.04, 0.06
"""Heights of a performer's foot over the floor, in metres, below which it comes to rest, and above which it stops
resting."""

STILL_SECONDS = 0.2
"""Time for which the lower foot must be slow until it defines the floor, in seconds; longer than the top of a jump."""

MIN_JUMP_METRES = 0.03
"""Height of both of a performer's feet over the floor, in metres, from which the character leaves its own floor."""

SOFT_JUMP_METRES = 0.03
"""Height above that one, in metres, at which the character rises half as far, so that it leaves the floor smoothly."""

VELOCITY_SECONDS = 0.05
"""Time constant of the mean velocity of a performer's foot, in seconds: smoothed joints still shake."""

NOISE_SECONDS = 1.0
"""Time constant of the mean deviation from that velocity, in seconds."""

NOISE_SHARE = 0.5
"""Share of this deviation that is added to the speeds at which a foot comes to rest and stops resting."""

FLOOR_SECONDS = 0.2
"""Time constant with which the floor follows the lower foot while it rests, in seconds."""

DRIFT_SECONDS = 2.0
"""Time constant with which the floor follows while no foot rests, in seconds: long compared to a jump, short compared
to a walk towards a tilted sensor."""

MIN_CONFIDENCE = 0.6
"""Smallest confidence of a foot's joint that is used; sensors guess the positions of hidden feet."""

VOTE_FRAMES = 3
"""Number of frames of which most must agree that a foot rests."""

TIME, FLOOR, LIFT, HEIGHT, TILT = range(5)
"""Entries of the state's clock."""


@compiled(inner=True)
def remaining(seconds, elapsed):
    """Return the share of a distance that remains after easing for some time with a time constant."""
    return math.exp(-elapsed / seconds)


@compiled(inner=True)
def is_seen(joint, positions, confidence):
    """Return whether the sensor sees a foot's joint."""
    return confidence[joint] > MIN_CONFIDENCE and is_position(positions[joint])


@compiled(inner=True)
def resting_feet(plan, state, positions, confidence, elapsed, began):
    """Return which of the performer's feet rest and which are low; update their velocities and the floor."""
    _follow(plan, state, positions, confidence, elapsed)
    lowest, still = np.inf, 0.0
    for leg in range(len(plan.joints)):
        quick = _speed(state, leg) > REST_SPEED + NOISE_SHARE * state.noise[leg]
        state.still[leg] = 0.0 if quick or not began else state.still[leg] + elapsed
        if state.last[leg, 1] < lowest:  # False for NaN
            lowest, still = state.last[leg, 1], state.still[leg]
    rests, low = np.zeros(len(plan.joints), dtype=np.bool_), np.zeros(len(plan.joints), dtype=np.bool_)
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
        votes = vote
        for frame in range(VOTE_FRAMES - 1):
            state.votes[leg, frame] = state.votes[leg, frame + 1] if began else vote
            votes += state.votes[leg, frame]
        state.votes[leg, VOTE_FRAMES - 1] = vote
        rests[leg] = 2 * votes > VOTE_FRAMES
        low[leg] = height < REST_HEIGHT_METRES
    return rests, low


@compiled(inner=True)
def _follow(plan, state, positions, confidence, elapsed):
    """Update the velocities of the performer's feet; a lost foot keeps its position."""
    fading = remaining(VELOCITY_SECONDS, elapsed)
    for leg in range(len(plan.joints)):
        j = plan.joints[leg]
        if not is_seen(j, positions, confidence):
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
            state.noise[leg] = away + remaining(NOISE_SECONDS, elapsed) * (state.noise[leg] - away)


@compiled(inner=True)
def _speed(state, leg):
    """Return the speed of a performer's foot; 0 until it is known."""
    speed = length(state.velocity[leg])
    return speed if math.isfinite(speed) else 0.0


@compiled(inner=True)
def _find_floor(plan, clock, lowest, still, elapsed):
    """Update the height of the performer's floor, and that of a jump over it."""
    if not math.isfinite(clock[FLOOR]):
        clock[FLOOR] = lowest
    stands = still > STILL_SECONDS or (still > 0 and lowest < clock[FLOOR] + RELEASE_HEIGHT_METRES)
    seconds = FLOOR_SECONDS if stands else DRIFT_SECONDS
    clock[FLOOR] = lowest + remaining(seconds, elapsed) * (clock[FLOOR] - lowest)
    rise = max(0.0, lowest - clock[FLOOR] - MIN_JUMP_METRES)
    clock[LIFT] = plan.metre * rise * rise / (rise + SOFT_JUMP_METRES)
