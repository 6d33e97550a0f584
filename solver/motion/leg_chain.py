"""Inverse kinematics of a leg with any number of bones: its joints bend or straighten together.

In animals' legs, long muscles couple knee and hock, so both fold at once. A single number κ bends every joint in the
direction in which it is bent at rest: joint j turns by κ wⱼ, with a larger weight wⱼ the more it is bent at rest, and
no joint turns past straight. κ is found from the distance between hip and ankle, and is 0 for the distance at rest.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.vectors import length, minus, plus, row_of, unit
from solver.motion import quaternions as quat
from solver.motion.two_bones import place

MIN_WEIGHT = math.radians(8)
"""Smallest weight of a joint, in radians; the weight of a joint that is straight at rest."""

STRAIGHT = math.radians(3)
"""Largest angle of a joint at rest, in radians, that does not determine in which direction it bends."""

MAX_BEND = math.radians(165)
"""Largest angle of a joint, in radians, unless it is bent further at rest."""

MOST_FOLDED = 12.0
"""Largest κ."""

SAMPLES = 120
"""Number of values of κ at which a leg's length is sampled."""

STEPS = 40
"""Largest number of steps with which κ is found; five to ten are usual."""


class Chains(NamedTuple):
    """Constants of legs, from hip to ankle. Rows are padded with −1 and 0."""

    bones: NDArray[np.int64]  # (l, k)
    ways: NDArray[np.float64]  # (l, k, 3): the bones at rest, from head to tail
    hinges: NDArray[np.float64]  # (l, k, 3): axis about which each bone turns relative to the one before it
    bends: NDArray[np.float64]  # (l, k): angle of that joint at rest, radians
    range: NDArray[np.float64]  # (l, 2): smallest and largest κ
    reach: NDArray[np.float64]  # (l,): length of the leg at the smallest κ
    shortest: NDArray[np.float64]  # (l,): and at the largest κ


def chains_of(
    bones: list[list[int]], heads: NDArray[np.float64], tails: NDArray[np.float64], towards: NDArray[np.float64]
) -> Chains:
    """Return the constants of legs.

    Parameters
    ----------
    bones : list of list of int
        The bones of each leg, from hip to ankle.
    heads, tails : (b, 3) float64
    towards : (l, 3) float64
        Direction in which the first joint of a straight leg bends.
    """
    legs, most = len(bones), max(map(len, bones))
    rows, bends = np.full((legs, most), -1, dtype=np.int64), np.zeros((legs, most))
    ways, hinges = np.zeros((legs, most, 3)), np.zeros((legs, most, 3))
    limits, reach, shortest = np.zeros((legs, 2)), np.zeros(legs), np.zeros(legs)
    for leg, numbers in enumerate(bones):
        count = len(numbers)
        rows[leg, :count] = numbers
        ways[leg, :count] = tails[numbers] - heads[numbers]
        hinges[leg, 1:count], bends[leg, 1:count] = _hinges(ways[leg, :count], towards[leg])
    found = Chains(rows, ways, hinges, bends, limits, reach, shortest)
    for leg in range(legs):
        limits[leg] = [_turning_point(found, leg, end) for end in (-1.0, MOST_FOLDED)]
        reach[leg], shortest[leg] = (_length(found, leg, kappa) for kappa in limits[leg])
    return found


def _hinges(ways: NDArray[np.float64], towards: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the axis (k − 1, 3) and the angle (k − 1,) of each joint at rest.

    A straight joint bends in the plane of the most bent one, to the other side than its neighbour, as knee and hock do.
    """
    units = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    axes = np.cross(units[:-1], units[1:])
    sines = np.linalg.norm(axes, axis=1)
    angles = np.arctan2(sines, np.einsum("nx,nx->n", units[:-1], units[1:]))
    if not len(angles):
        return axes, angles
    known = angles > STRAIGHT
    if not known.any():
        across = np.cross(towards, ways.sum(axis=0))
        axes[0], angles = across / max(np.linalg.norm(across), 1e-300), np.zeros(len(angles))
        known = np.arange(len(angles)) == 0
    else:
        axes[known] /= sines[known, None]
        angles = np.where(known, angles, 0.0)
    order = np.argsort(np.abs(np.arange(len(known)) - np.flatnonzero(known)[angles[known].argmax()]), kind="stable")
    for j in order:
        if not known[j]:
            beside = j - 1 if j > 0 and known[j - 1] else j + 1
            axes[j], known[j] = -axes[beside], True
    return axes, angles


def _turning_point(chains: Chains, leg: int, end: float) -> float:
    """Return how far κ can go from 0 towards an end while the leg's length keeps growing or shrinking.

    A leg that is nearly straight may become a little longer before it folds.
    """
    values = np.linspace(0.0, end, SAMPLES)
    steps = np.diff([_length(chains, leg, value) for value in values]) * -np.sign(end)
    first = int(np.argmax(steps > 0)) if end > 0 else 0
    wrong = np.flatnonzero(steps[first:] < 0)
    return float(values[first + wrong[0]] if len(wrong) else end)


@compiled(inner=True)
def _angle(chains, leg, joint, kappa):
    """Return the angle by which a joint turns from rest."""
    bend = chains.bends[leg, joint]
    return min(max(kappa * max(bend, MIN_WEIGHT), -bend), max(MAX_BEND - bend, 0.0))


@compiled(inner=True)
def _way(chains, leg, kappa):
    """Return the vector from hip to ankle while the first bone keeps its direction at rest."""
    turn, end = (1.0, 0.0, 0.0, 0.0), row_of(chains.ways[leg], 0)
    for j in range(1, chains.bones.shape[1]):
        if chains.bones[leg, j] >= 0:
            turn = quat.product(turn, quat.about(row_of(chains.hinges[leg], j), _angle(chains, leg, j, kappa)))
            end = plus(end, quat.rotated(turn, row_of(chains.ways[leg], j)), 1.0)
    return end


@compiled
def _length(chains, leg, kappa):
    """Return the distance from hip to ankle."""
    return length(_way(chains, leg, kappa))


@compiled(inner=True)
def _folded(chains, leg, distance):
    """Return the κ with which hip and ankle have a distance, as far as the leg can."""
    low, high = chains.range[leg, 0], chains.range[leg, 1]
    if distance >= chains.reach[leg]:
        return low
    if distance <= chains.shortest[leg]:
        return high
    above, below = chains.reach[leg] - distance, chains.shortest[leg] - distance
    middle, last = 0.0, 0  # exact at rest
    for _ in range(STEPS):
        away = length(_way(chains, leg, middle)) - distance
        if abs(away) < 1e-9 * distance:
            break
        # the method of false position; halving the other end's value keeps it from getting stuck (Illinois)
        if away > 0:
            low, above = middle, away
            below = below / 2 if last > 0 else below
            last = 1
        else:
            high, below = middle, away
            above = above / 2 if last < 0 else above
            last = -1
        middle = (low * below - high * above) / (below - above)
    return middle


@compiled(inner=True)
def stretch(chains, leg, motions, heads, base, hip, ankle):
    """Turn the bones of a leg so that its ankle is at a position, as far as it reaches; return where the ankle is.

    Parameters
    ----------
    chains : Chains
    leg : int
    motions : (b, 4, 3) float64
        Written to.
    heads : (b, 3) float64
    base : quaternion
        Rotation of the leg before it turns by the least rotation towards the ankle.
    hip, ankle : (3,)
        Positions.
    """
    wanted = minus(ankle, hip)
    kappa = _folded(chains, leg, length(wanted))
    now = quat.rotated(base, _way(chains, leg, kappa))
    turn, joint = quat.product(quat.least(unit(now), unit(wanted)), base), hip
    for j in range(chains.bones.shape[1]):
        bone = chains.bones[leg, j]
        if bone >= 0:
            if j > 0:
                turn = quat.product(turn, quat.about(row_of(chains.hinges[leg], j), _angle(chains, leg, j, kappa)))
            place(motions[bone], turn, heads[bone], joint)
            joint = plus(joint, quat.rotated(turn, row_of(chains.ways[leg], j)), 1.0)
    return joint
