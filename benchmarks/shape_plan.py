"""Legs, arms, wings, head and tail of a character's shape, decided together.

The ends of the curves inside a character are candidates (`benchmarks.shape_ends`). Two ends on different sides may
be those of legs, arms or wings, a single one that of the head or of the tail. What is measured of each, times weights,
is the score of a label. A plan is a choice of labels for all; what is measured of a plan as a whole, times weights, is
its score: the sum of its labels' scores, whether it has legs, how its arms compare with its legs, how long the limbs
are that it does not explain. The weights are logits that `benchmarks.shape_weights` fits to rigged characters.
The solver does not use this yet, see there.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from benchmarks.shape_ends import MIDDLE, ShapeEnds
from solver.anatomy.curve_skeleton import CurveSkeleton

ROWS = ("no legs", "one pair of legs", "two pairs of legs", "three pairs of legs", "more pairs of legs")

LABELS = ("leg", "arm", "wing", "head", "tail")

CANDIDATES = {"leg": (9, -4.0), "arm": (4, -5.0), "wing": (2, -4.0), "head": (3, -np.inf), "tail": (3, -4.0)}
"""Maximum number of candidates of each label, and their minimum score."""

MAX_ROWS, GROWN_SETS, MAX_LEG_SETS, MAX_LIMB_SETS, MAX_PLANS = 4, 6, 14, 40, 60
"""Maximum number of pairs of legs; number of likely choices of legs to which a pair is added; maximum number of choices
of legs, of those with arms and wings, and of plans."""

LOW_ARMS = 0.1
"""Height below which arms end on the ground."""

HEAD_LENGTH, HEAD_RATIO, CROWN_SHARE = 0.22, 1.5, 0.97
"""Length of the part at the end of the head in which its thickest place is looked for; radius of the head, as a
multiple of its thickness there; share of its cells that is below the crown."""

NOSE_REACH = 2.5, 0.06
"""Maximum distance from the thickest place of the head to its nose, in thicknesses, and what is added to it."""

MAX_UNEXPLAINED = 1.5
"""Maximum sum of the lengths of curves that are in no limb, which is measured."""

T = TypeVar("T")

Weights = Mapping[str, Mapping[str, float]]
"""Weights of the measures of each label, and of plans for ``plan``, by name."""


@dataclass(frozen=True)
class Plan:
    """Limbs of a shape.

    Attributes
    ----------
    legs : tuple of (int, int)
        Cells at the ends of each pair, the left one first; from hind to front.
    arms, wings : (int, int) or None
    head, tail : int or None
        Cells; the head's is its nose if the body lies or has several pairs of legs, else its crown.
    probability : float
    """

    legs: tuple[tuple[int, int], ...]
    arms: tuple[int, int] | None
    wings: tuple[int, int] | None
    head: int | None
    tail: int | None
    probability: float


@dataclass(frozen=True)
class Choice:
    """Numbers of the pairs that are legs, arms and wings, and of the ends that are head and tail; −1 for none."""

    legs: tuple[int, ...]
    arms: int
    wings: int
    head: int
    tail: int

    def tips(self, shape: ShapeEnds) -> list[int]:
        """Return the numbers of the ends of legs, arms and wings."""
        pairs = [*self.legs, *(pair for pair in (self.arms, self.wings) if pair >= 0)]
        return [*shape.left[pairs].tolist(), *shape.right[pairs].tolist()]


def likeliest_plan(skeleton: CurveSkeleton, weights: Weights) -> Plan:
    """Return the likeliest plan of a character.

    Parameters
    ----------
    skeleton : CurveSkeleton
        In the character's directions: left, up and front.
    weights : mapping
    """
    shape = ShapeEnds(skeleton)
    plans = choices(shape, weights)
    scores = np.array([_score(plan_measures(shape, *each), weights["plan"]) for each in plans])
    best = int(scores.argmax())
    return _plan(shape, plans[best][0], float(np.exp(scores[best] - scipy.special.logsumexp(scores))))


def _score(measures: Mapping[str, Any], weights: Mapping[str, float]) -> NDArray[np.float64]:
    return np.asarray(sum(weight * measures[name] for name, weight in weights.items() if name in measures))


def choices(shape: ShapeEnds, weights: Weights) -> list[tuple[Choice, float]]:
    """Return the choices whose labels are likeliest one by one, with the sums of the labels' scores."""
    found = {}
    for label in LABELS:
        measures = shape.pair_measures if label in ("leg", "arm", "wing") else shape.single_measures
        scores = _score(measures, weights[label])
        most, least = CANDIDATES[label]
        likely = [int(each) for each in np.argsort(-scores, kind="stable")[:most] if scores[each] > least]
        found[label] = [(each, float(scores[each])) for each in likely]
    none = (-1, 0.0)
    limbs = [
        (Choice(legs, arms, wings, -1, -1), score + arm + wing)
        for (legs, score), (arms, arm), (wings, wing) in product(
            _leg_sets(shape, found["leg"]), [none, *found["arm"]], [none, *found["wing"]]
        )
        if (arms < 0 or not shape.clash(arms, legs))
        and (wings < 0 or not shape.clash(wings, legs if arms < 0 else (*legs, arms)))
    ]
    plans = []
    for choice, score in _best(limbs, MAX_LIMB_SETS):
        used = choice.tips(shape)
        for (head, h), (tail, t) in product([none, *found["head"]], [none, *found["tail"]]):
            ends = [end for end in (head, tail) if end >= 0]
            if not shape.same[np.ix_(ends, used)].any() and not (len(ends) == 2 and shape.same[head, tail]):
                plans.append((Choice(choice.legs, choice.arms, choice.wings, head, tail), score + h + t))
    return _best(plans, MAX_PLANS)


def _best(scored: Iterable[tuple[T, float]], most: int) -> list[tuple[T, float]]:
    return sorted(scored, key=lambda each: -each[1])[:most]


def _leg_sets(shape: ShapeEnds, likely: list[tuple[int, float]]) -> list[tuple[tuple[int, ...], float]]:
    """Return likely choices of legs, none among them, with the sums of their scores.

    Pairs are added from the likeliest to the least likely one.
    """
    every: list[tuple[tuple[int, ...], float]] = [((), 0.0)]
    grown = every
    place = {pair: number for number, (pair, _) in enumerate(likely)}
    for _ in range(MAX_ROWS):
        longer = [
            ((*legs, pair), total + score)
            for legs, total in grown
            for pair, score in likely[place[legs[-1]] + 1 if legs else 0 :]
            if not shape.clash(pair, legs)
        ]
        every = [*every, *longer]
        grown = _best(longer, GROWN_SETS)
    best = _best(every, MAX_LEG_SETS)
    return best if any(not legs for legs, _ in best) else [*best, ((), 0.0)]


def plan_measures(shape: ShapeEnds, choice: Choice, labels: float) -> dict[str, float]:
    """Return what is measured of a choice whose labels have this sum of scores; what is missing is 0."""
    parts = (
        _measures_of_labels(choice),
        _measures_of_legs(shape, choice),
        _measures_of_arms(shape, choice),
        _measures_of_head(shape, choice),
        _measures_of_rest(shape, choice),
    )
    return {"labels": labels} | {name: float(value) for part in parts for name, value in part}


def _measures_of_labels(choice: Choice) -> Iterator[tuple[str, float]]:
    rows, arms, wings = len(choice.legs), choice.arms >= 0, choice.wings >= 0
    yield (
        ("no legs", "one pair of legs", "two pairs of legs", "three pairs of legs", "more pairs of legs")[min(rows, 4)],
        1,
    )
    yield "arms", arms
    yield "arms and many legs", arms and rows > 1
    yield "arms without legs", arms and rows == 0
    yield "wings", wings
    yield "wings and arms", wings and arms
    yield "head", choice.head >= 0
    yield "tail", choice.tail >= 0


def _measures_of_legs(shape: ShapeEnds, choice: Choice) -> Iterator[tuple[str, float]]:
    legs = list(choice.legs)
    if not legs:
        return
    place = shape.places[[*shape.left[legs], *shape.right[legs]]].mean(axis=0)
    yield "unlevel feet", np.ptp(shape.pair_low[legs])
    yield "feet apart", shape.apart[legs].mean()
    yield "unlike feet", shape.unlike[0, legs].mean()
    yield "stride", np.ptp(shape.pair_front[legs])
    yield "unequal legs", shape.pair_lengths[:, legs].mean(axis=0).std()
    yield "shortest leg", shape.pair_lengths[:, legs].min()
    weight = float(shape.middle[2] - place[2]) / shape.size
    yield "weight before feet", weight
    yield "weight off the feet", abs(weight)
    if choice.head >= 0:
        yield "from head to feet", _away(place, shape.places[choice.head]) / shape.size


def _measures_of_arms(shape: ShapeEnds, choice: Choice) -> Iterator[tuple[str, float]]:
    arms, legs = choice.arms, list(choice.legs)
    if arms < 0:
        return
    yield "arms on the ground", shape.pair_low[arms] < LOW_ARMS
    yield "unlike arms", shape.unlike[0, arms]
    if legs:
        lengths, thickness = shape.pair_lengths.mean(axis=0), shape.thickness
        yield "arms above legs", np.clip(shape.fork_heights[arms] - shape.fork_heights[legs].mean(), -0.5, 0.5)
        yield "arms farther apart than legs", np.clip(shape.apart[arms] - shape.apart[legs].mean(), -0.5, 0.5)
        yield "arms longer than legs", _ratio(lengths[arms], lengths[legs].mean())
        yield "arms thicker than legs", _ratio(thickness[arms], thickness[legs].mean())
        yield "arms before legs", shape.pair_front[arms] - shape.pair_front[legs].mean()


def _measures_of_head(shape: ShapeEnds, choice: Choice) -> Iterator[tuple[str, float]]:
    head, tail = choice.head, choice.tail
    if head < 0:
        return
    yield "head height", shape.up[head]
    yield "head aside", abs(shape.aside[head])
    yield "head before feet", shape.front[head] - np.mean(shape.pair_front[list(choice.legs)] if choice.legs else 0.0)
    if choice.arms >= 0:
        yield "from head to arms", _away(shape.forks[choice.arms], shape.places[head]) / shape.size
        yield "arms above head", shape.fork_heights[choice.arms] - shape.up[head]
    if tail >= 0:
        yield "head before tail", shape.front[head] - shape.front[tail]
        yield "from head to tail", _away(shape.places[head], shape.places[tail]) / shape.size


def _measures_of_rest(shape: ShapeEnds, choice: Choice) -> Iterator[tuple[str, float]]:
    """Yield what is measured of wings and of a tail, and the lengths of curves that are in no limb."""
    if choice.wings >= 0:
        yield "length of wings", shape.pair_lengths[:, choice.wings].mean()
    if choice.tail >= 0:
        yield "length of tail", shape.lengths[choice.tail] / shape.size
        yield "tail height", shape.up[choice.tail]
    chosen = [*choice.tips(shape), *(end for end in (choice.head, choice.tail) if end >= 0)]
    lengths = [
        shape.along[tip][min([shape.begins[tip], *shape.meets[tip, chosen]])] / shape.size
        for tip in np.flatnonzero(shape.is_tip).tolist()
        if tip not in chosen
    ]
    yield "unexplained length", min(sum(lengths), MAX_UNEXPLAINED)
    yield "longest unexplained", max(lengths, default=0.0)


def _away(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(one - other))


def _ratio(one: float, other: float) -> float:
    """Return the logarithm of a ratio, from −1.5 to 1.5."""
    return float(np.clip(np.log(one / max(other, 1e-3)), -1.5, 1.5))


def _plan(shape: ShapeEnds, choice: Choice, probability: float) -> Plan:
    legs, arms, wings = (
        [(int(shape.tips[shape.left[pair]]), int(shape.tips[shape.right[pair]])) for pair in pairs if pair >= 0]
        for pairs in (sorted(choice.legs, key=lambda pair: shape.pair_front[pair]), [choice.arms], [choice.wings])
    )
    return Plan(
        tuple(legs),
        arms[0] if arms else None,
        wings[0] if wings else None,
        head_end(shape, choice) if choice.head >= 0 else None,
        int(shape.tips[choice.tail]) if choice.tail >= 0 else None,
        probability,
    )


def head_end(shape: ShapeEnds, choice: Choice) -> int:
    """Return the cell at the nose if the body lies or has several pairs of legs, else at the crown."""
    way = shape.ways[choice.head][shape.along[choice.head] <= HEAD_LENGTH * shape.size]
    thickest = way[int(shape.depth[way].argmax())]
    radius, skull = float(shape.depth[thickest]), shape.cells[thickest]
    if len(choice.legs) > 1 or shape.lies:
        others = shape.places[[*choice.tips(shape), *([choice.tail] if choice.tail >= 0 else [])]]
        near = np.linalg.norm(shape.places - skull, axis=1) < NOSE_REACH[0] * radius + NOSE_REACH[1] * shape.size
        free = np.linalg.norm(shape.places[:, None] - others, axis=2) > MIDDLE * shape.size
        ahead = shape.front + 0.25 * shape.up * shape.height / shape.size - np.abs(shape.aside)
        head = near & free.all(axis=1) | (np.arange(len(near)) == choice.head)
        return int(shape.tips[np.where(head, ahead, -np.inf).argmax()])
    around = shape.cells[np.linalg.norm(shape.cells - skull, axis=1) < HEAD_RATIO * radius]
    crown = around.mean(axis=0)
    crown[1] = np.quantile(around[:, 1], CROWN_SHARE)
    return int(np.linalg.norm(shape.cells - crown, axis=1).argmin())
