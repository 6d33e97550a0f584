"""Constants and state of a body that stands on legs and steps (`solver.motion.steps`)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.model.bones import Bones
from solver.motion.gait import new_gait, phases
from solver.motion.leg_chain import Chains, chains_of
from solver.motion.resting_feet import VOTE_FRAMES

MIN_FOOT_BONES = 3
"""Smallest number of bones of a leg whose last one can be a foot."""

MAX_FOOT_SHARE, MAX_FOOT_SLOPE = 0.2, math.radians(65)
"""Largest length of a foot as a share of its leg's, and largest slope of a longer one in radians. A longer and steeper
last bone is part of the leg, which stands on its tip."""

HEADING, TURNING, FOLLOWS, DROP, PITCH, CROUCH, JUMP, REARING, SINKING = range(9)
"""Entries of a body's state: heading of its homes in radians; its rate; share with which the homes follow the body; how
far the body is lowered for its legs to reach; pitch in radians; crouch of the performer; height of a jump; share with
which it rears; speed at which it is lowered."""


MAX_FOLD = 0.75
"""Share of the way from how legs are at rest to where they are fully folded by which a body crouches at most."""


@dataclass(frozen=True)
class StandingLeg:
    """A leg that stands on the floor.

    Attributes
    ----------
    bones : tuple of int
        From hip to tip. The last of three or more is the foot.
    hand, shoulder : int
        The performer's joints; a raised hand lifts the leg. −1 for a leg that only stands.
    """

    bones: tuple[int, ...]
    hand: int = -1
    shoulder: int = -1


@dataclass(frozen=True, eq=False)
class PerformersLegs:
    """The measures of a performer from which steps follow.

    Attributes
    ----------
    ankles, hips : (int, int)
        The left and the right joint.
    leg, arm : float
        Lengths from hip to ankle, and from shoulder to hand, in metres.
    """

    ankles: tuple[int, int]
    hips: tuple[int, int]
    leg: float
    arm: float


class Watch(NamedTuple):
    """Constants of `resting_feet`."""

    joints: NDArray[np.int64]  # (2,): the performer's ankles
    metre: float


class WatchState(NamedTuple):
    """State of `resting_feet`."""

    held: NDArray[np.float64]
    last: NDArray[np.float64]
    velocity: NDArray[np.float64]
    noise: NDArray[np.float64]
    still: NDArray[np.float64]
    votes: NDArray[np.float64]
    clock: NDArray[np.float64]


class StepPlan(NamedTuple):
    """Constants of a character that steps."""

    chains: Chains
    feet: NDArray[np.int64]  # (l,): −1 for a leg without a foot
    carriers: NDArray[np.int64]  # (l,): the bone that carries the leg, −1 for none
    hips: NDArray[np.float64]  # (l, 3)
    ankles: NDArray[np.float64]  # (l, 3): end of the chain at rest
    offsets: NDArray[np.float64]  # (l, 2): phases of walk and trot
    front: NDArray[np.bool_]  # (l,): the first of several pairs
    hands: NDArray[np.int64]  # (l,): −1 for legs that are not lifted
    shoulders: NDArray[np.int64]  # (l,)
    ground: NDArray[np.float64]  # (l,): height of the lower end of the foot, or of the leg, at rest
    heads: NDArray[np.float64]  # (b, 3)
    tails: NDArray[np.float64]  # (b, 3)
    parents: NDArray[np.int64]  # (b,)
    trunk: NDArray[np.int64]  # (t,)
    behind: NDArray[np.bool_]  # (b,): bones that hang on the rear half of the trunk
    axes: NDArray[np.float64]  # (3, 3): rows left, up and forward
    pivot: NDArray[np.float64]  # (3,): the point about which the body turns: the middle of its hips
    radius: float  # mean level distance of the ankles from it
    leg_length: float  # how far legs reach when they stand
    depth: float  # how far the body can sink until a leg is folded
    span: float  # distance from the hind hips to the front hips along the body, 0 for a single pair
    metre: float
    max_turn: float  # radians: of the trunk from upright, and from the heading of the homes
    watch: Watch
    performers_hips: NDArray[np.int64]  # (2,)
    performers_leg: float
    performers_arm: float
    goes_forward: bool  # whether a walk in place moves the character


class StepState(NamedTuple):
    """The state between frames. Positions are of ankles, in the mesh file's coordinates with the root's motion."""

    place: NDArray[np.float64]  # (l, 3): where a foot stands, or is in the air
    origin: NDArray[np.float64]  # (l, 3): where its swing began
    aim: NDArray[np.float64]  # (l, 3): where its swing will end
    yaw: NDArray[np.float64]  # (l, 3): heading of the foot now, at the beginning and at the end of its swing
    swing: NDArray[np.float64]  # (l,): share of the swing that is over, 0 for a foot that stands
    seconds: NDArray[np.float64]  # (l,): length of the swing
    held: NDArray[np.float64]  # (l,): 1 for a foot that stands at a place of an earlier recording in the first frame
    lift: NDArray[np.float64]  # (l, 2): time for which the hand has been up; share of the gesture, 0 to 1
    body: NDArray[np.float64]  # (9,)
    velocity: NDArray[np.float64]  # (3,): of the body, level, mesh units per second
    last: NDArray[np.float64]  # (3,): the body's level translation in the last frame
    base: NDArray[np.float64]  # (3,): translation of the homes from rest
    walked: NDArray[np.float64]  # (3,): way added by walking in place
    stand: NDArray[np.float64]  # (2, 3): where the performer's feet came to rest, metres, character axes
    gait: NDArray[np.float64]
    watch: WatchState


MIN_REACH = 0.5
"""Smallest reach of a leg when it stands, as a share of the length of its bones: a frog's legs are folded at rest."""

MAX_TURNS = np.radians([35.0, 12.0])
"""Largest turn of the trunk from how it stands, in radians, of bodies with one pair of legs, and with several."""


def plan_of(
    bones: Bones,
    legs: Sequence[StandingLeg],
    trunk: Sequence[int],
    performer: PerformersLegs,
    metre: float,
    basis: NDArray[np.float64],
    goes_forward: bool,
) -> StepPlan:
    """Compute the constants of a character that steps; see `solver.motion.steps.Steps`."""
    _, up, ahead = basis
    feet = np.array([_foot(bones, leg, up) for leg in legs], dtype=np.int64)
    numbers = [list(leg.bones if foot < 0 else leg.bones[:-1]) for leg, foot in zip(legs, feet, strict=True)]
    hips = bones.heads[[leg.bones[0] for leg in legs]]
    ankles = bones.tails[[chain[-1] for chain in numbers]]
    tips = bones.tails[[leg.bones[-1] for leg in legs]]
    pivot = np.ascontiguousarray(hips.mean(axis=0))
    sides, rows = _pairs(ankles, basis)
    front = (rows == rows.max()) & (rows > 0)
    towards = np.where(front[:, None], -ahead, ahead)
    span = float(((hips[front].mean(axis=0) - hips[rows == 0].mean(axis=0)) @ ahead) if front.any() else 0.0)
    chains = chains_of(numbers, bones.heads, bones.tails, towards)
    lengths = np.linalg.norm(hips - ankles, axis=1)
    return StepPlan(
        chains=chains,
        feet=feet,
        carriers=bones.parents[[leg.bones[0] for leg in legs]],
        hips=hips,
        ankles=ankles,
        offsets=phases(sides, rows),
        front=front,
        hands=np.array([leg.hand if front[k] else -1 for k, leg in enumerate(legs)], dtype=np.int64),
        shoulders=np.array([leg.shoulder for leg in legs], dtype=np.int64),
        ground=np.minimum(tips @ up, ankles @ up),
        heads=np.ascontiguousarray(bones.heads),
        tails=np.ascontiguousarray(bones.tails),
        parents=bones.parents,
        trunk=np.array(trunk, dtype=np.int64),
        behind=_behind(bones, trunk),
        axes=np.ascontiguousarray(basis),
        pivot=pivot,
        radius=float(np.linalg.norm((ankles - pivot) - np.outer((ankles - pivot) @ up, up), axis=1).mean()),
        leg_length=_leg_length(bones, legs, up),
        depth=float(max(0.0, MAX_FOLD * (lengths - chains.shortest)[~front].min())),
        span=max(span, 0.0),
        metre=float(metre),
        max_turn=float(MAX_TURNS[1 if front.any() else 0]),
        watch=Watch(np.array(performer.ankles, dtype=np.int64), float(metre)),
        performers_hips=np.array(performer.hips, dtype=np.int64),
        performers_leg=float(performer.leg),
        performers_arm=float(performer.arm),
        goes_forward=goes_forward,
    )


def _leg_length(bones: Bones, legs: Sequence[StandingLeg], up: NDArray[np.float64]) -> float:
    """Return the mean height of the hips over the tips of the legs, or more where legs are folded at rest."""
    heights = [(bones.heads[leg.bones[0]] - bones.tails[leg.bones[-1]]) @ up for leg in legs]
    lengths = [bones.lengths[list(leg.bones)].sum() for leg in legs]
    return float(max(np.mean(heights), MIN_REACH * np.mean(lengths), 1e-9))


def _behind(bones: Bones, trunk: Sequence[int]) -> NDArray[np.bool_]:
    """Return which bones (b,) hang on the rear half of the trunk."""
    out = np.zeros(len(bones), dtype=bool)
    if not len(trunk):
        return out
    start, chord = bones.heads[trunk[0]], bones.tails[trunk[-1]] - bones.heads[trunk[0]]
    for bone, parent in enumerate(bones.parents):  # parents precede their children
        if parent in trunk:
            out[bone] = bone not in trunk and (bones.heads[bone] - start) @ chord < 0.5 * (chord @ chord)
        elif parent >= 0:
            out[bone] = out[parent]
    return out


def _foot(bones: Bones, leg: StandingLeg, up: NDArray[np.float64]) -> int:
    """Return the bone that is a leg's foot, −1 for none."""
    foot, lengths = leg.bones[-1], bones.lengths[list(leg.bones)]
    steep = abs(math.asin(min(1.0, abs((bones.tails[foot] - bones.heads[foot]) @ up) / lengths[-1]))) > MAX_FOOT_SLOPE
    is_leg = len(leg.bones) < MIN_FOOT_BONES or (steep and lengths[-1] > MAX_FOOT_SHARE * lengths.sum())
    return -1 if is_leg else foot


def _pairs(ankles: NDArray[np.float64], basis: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return each leg's side, 0 for left, and its row from the hind legs to the front.

    A leg in the middle counts for the side that has fewer.
    """
    left, _, ahead = basis
    across = (ankles - ankles.mean(axis=0)) @ left
    sides = np.where(across > 0, 0, 1)
    middle = np.abs(across) < 0.1 * np.abs(across).max(initial=1e-300)
    for leg in np.flatnonzero(middle):
        others = sides[~middle | (np.arange(len(sides)) < leg)]
        sides[leg] = 0 if (others == 0).sum() <= (others == 1).sum() else 1
    rows = np.zeros(len(ankles), dtype=np.int64)
    for side in range(2):
        own = np.flatnonzero(sides == side)
        rows[own[np.argsort(ankles[own] @ ahead, kind="stable")]] = np.arange(len(own))
    return sides.astype(np.int64), rows


def state_of(plan: StepPlan) -> StepState:
    """Return the state of a character before its first frame."""
    count = len(plan.feet)
    return StepState(
        place=plan.ankles.copy(),
        origin=plan.ankles.copy(),
        aim=plan.ankles.copy(),
        yaw=np.zeros((count, 3)),
        swing=np.zeros(count),
        seconds=np.ones(count),
        held=np.zeros(count),
        lift=np.zeros((count, 2)),
        body=np.zeros(9),
        velocity=np.zeros(3),
        last=np.zeros(3),
        base=np.zeros(3),
        walked=np.zeros(3),
        stand=np.full((2, 3), np.nan),
        gait=new_gait(),
        watch=WatchState(
            held=np.zeros(2),
            last=np.full((2, 3), np.nan),
            velocity=np.full((2, 3), np.nan),
            noise=np.zeros(2),
            still=np.zeros(2),
            votes=np.zeros((2, VOTE_FRAMES)),
            clock=np.array([-np.inf, np.nan, 0.0, 0.0, 0.0]),
        ),
    )
