"""Up, front and limbs of a body, decided together from its graph.

For each direction from side to side, branches that mirror each other are pairs. For each up and front, each pair may be
arms, legs, wings, ears or nothing, and each branch in the middle may be the head, the tail or nothing. A label has a
score: the sum of what is measured (`PAIR_MEASURES`, `SINGLE_MEASURES`), each times its weight. The labels with the
highest sum are chosen: one pair of arms, of wings and of ears, one head and one tail, any number of legs; then all
other pairs that are called arms or wings. To that sum comes what speaks for an orientation (`ORIENTATION_MEASURES`).
`body_weights.toml` has the weights; they are logits, so that the sums are log odds.

Where names do not tell what a pair is, points inside the character do (`solver.anatomy.part_network`): they tell a fin
from a leg, and which way a fish swims.
"""

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.anatomy.body_graph import LABELS, LIMB_SHARE, BodyGraph, Pair, find_pairs
from solver.anatomy.inside_evidence import MIN_ASKED, Inside, evidence
from solver.anatomy.pair_shape import PAIR_LABELS, PairShape, said

SINGLE_LABELS = ("head", "tail")

PAIR_MEASURES = (
    "bias",
    "name",
    "ground",
    "height",
    "root height",
    "down",
    "aside",
    "forward",
    "length",
    "near head",
    "thickness",
    "fingers",
    "mass",
    "unlike",
)
SINGLE_MEASURES = (
    "bias",
    "name",
    "height",
    "front",
    "up",
    "forward",
    "length",
    "thickness",
    "mass",
    "aside",
    "face",
    "carries",
)
ORIENTATION_MEASURES = (
    "limbs",
    "up",
    "front",
    "sides",
    "toes",
    "knees",
    "elbows",
    "face",
    "head",
    "tail",
    "likeness",
    "muzzle",
    "stance",
)

GROUND_SHARE = 0.06
"""Height, as a share of the body's, at which the measure `ground` of an end has fallen to 1/e."""

FACE_SHARE = 0.1
"""Distance from the head's middle at which eyes and a jaw show the front fully, as a share of the body's size."""

FORK_SHARE = 0.75
"""Minimum distance of a fork of the trunk from the farthest end below it, as a share of that of the first node."""

MIN_NAMELESS_ROWS, ROW_RATIO = 4, 0.5
"""Minimum number of pairs without names that are all legs, and minimum length of each as a share of the longest."""

MAX_HEADS = 3
"""Number of branches in the middle that are tried as the head."""

LIKELY = 4.6
"""Maximum difference of a way's score from the highest one at which the points inside are asked about it."""

STANDS_WEIGHT = 0.5
"""Weight of the logit that a character stands in a way, by the points inside."""

WEIGHTS = Path(__file__).with_name("body_weights.toml")

Weights = Mapping[str, NDArray[np.float64]]


def load_weights(section: str, path: Path = WEIGHTS) -> Weights:
    """Return the weights of a builder's graphs: (measures,) for each label, and for ``orientation``.

    Parameters
    ----------
    section : str
        Builder: "joints".
    path : Path, optional
    """
    table = tomllib.loads(path.read_text(encoding="utf-8"))[section]
    rows: dict[str, Sequence[str]] = {"orientation": ORIENTATION_MEASURES}
    rows |= dict.fromkeys(PAIR_LABELS, PAIR_MEASURES) | dict.fromkeys(SINGLE_LABELS, SINGLE_MEASURES)
    return {label: np.array([float(table[label].get(name, 0.0)) for name in row]) for label, row in rows.items()}


@dataclass(frozen=True, eq=False)
class Body:
    """One way to see a body.

    Attributes
    ----------
    up, front : (3,) float64
        Unit vectors along axes.
    pairs : tuple of (str, Pair)
        Limbs on both sides and their labels; `Pair.one` is the left one.
    singles : dict of str to list of int
        Nodes of the head and the tail from the trunk to the end.
    measures : (13,) float64
        `ORIENTATION_MEASURES`; `stance` is how steeply down legs lead whose names say so: 1 straight down, 0
        from 60° off.
    score : float
    """

    up: NDArray[np.float64]
    front: NDArray[np.float64]
    pairs: tuple[tuple[str, Pair], ...]
    singles: dict[str, list[int]]
    measures: NDArray[np.float64]
    score: float

    @property
    def left(self) -> NDArray[np.float64]:
        """Unit vector (3,) to the character's left."""
        return np.cross(self.up, self.front)


def decide(
    graph: BodyGraph,
    weights: Weights,
    up: NDArray[np.float64] | None = None,
    front: NDArray[np.float64] | None = None,
    ask: Callable[[NDArray[np.float64]], Inside] | None = None,
) -> list[tuple[float, Body]]:
    """Return the ways to see a body with their probabilities, the likeliest first.

    Parameters
    ----------
    graph : BodyGraph
    weights : mapping
        Of `load_weights`.
    up, front : (3,) float64, optional
        Known directions. They are not parallel.
    ask : callable, optional
        Returns what points inside say, for the directions (3, 3) of left, up and front. It is called for the likely
        ways if names do not tell what the pairs of the likeliest one are; others are left out then.
    """
    known = (up, front)
    found = [
        (view, view.labelled(weights))
        for view in views(graph)
        if all(given is None or given @ own > 0.5 for given, own in zip(known, (view.up, view.front), strict=True))
    ]
    best, highest = max(found, key=lambda each: each[1].score)
    if ask is not None and best.is_unnamed:
        likely = [(view, body) for view, body in found if body.score > highest.score - LIKELY]
        found = [(view, _asked(view, body, ask(view.axes), weights)) for view, body in likely]
    bodies = sorted((body for _, body in found), key=lambda body: -body.score)
    odds = np.exp([body.score - bodies[0].score for body in bodies])
    return [(float(chance), body) for chance, body in zip(odds / odds.sum(), bodies, strict=True)]


def _asked(view: "View", body: Body, inside: Inside, weights: Weights) -> Body:
    """Return a body of a view with the labels and the score that points inside suggest."""
    return replace(view.labelled(weights, inside), score=body.score + STANDS_WEIGHT * inside.stands)


def views(graph: BodyGraph) -> Iterator["View"]:
    """Yield the 24 views of a body along the axes."""
    for axis in range(3):
        found, middle = find_pairs(graph, axis)
        pairs, branches = [PairShape.of(graph, pair) for pair in found], _branches(graph, found, middle)
        for upward, forward in permutations([other for other in range(3) if other != axis]):
            for sign_up in (1.0, -1.0):
                for sign_front in (1.0, -1.0):
                    yield View(graph, sign_up * np.eye(3)[upward], sign_front * np.eye(3)[forward], pairs, branches)


class View:
    """A body with a left, up and front.

    Parameters
    ----------
    graph : BodyGraph
    up, front : (3,) float64
    pairs : list
        Pairs of branches from side to side.
    branches : list of list of int
        Branches in the middle.
    """

    def __init__(
        self,
        graph: BodyGraph,
        up: NDArray[np.float64],
        front: NDArray[np.float64],
        pairs: list[PairShape],
        branches: list[list[int]],
    ) -> None:
        self.graph, self.up, self.front, self.branches = graph, up, front, branches
        self.axes = np.array([np.cross(up, front), up, front])
        self.shapes = pairs
        self.mirrored = bool(self.axes[0].sum() < 0)
        self.pairs = [Pair(s.pair.other, s.pair.one, s.pair.unlikeness) if self.mirrored else s.pair for s in pairs]
        own = graph.box @ self.axes.T
        self.low, self.high = own.min(axis=0), own.max(axis=0)
        self.height = max(float(self.high[1] - self.low[1]), 1e-12)
        self._pair_measures: dict[int, NDArray[np.float64]] = {}

    @property
    def is_unnamed(self) -> bool:
        """Whether there is a pair of which names do not tell what it is, or no pair."""
        long = [shape for shape in self.shapes if shape.rest[0] > MIN_ASKED]
        return not self.shapes or not all(shape.names.any() for shape in long)

    @cached_property
    def single_measures(self) -> NDArray[np.float64]:
        """`SINGLE_MEASURES` (s, 2, 12) of the branches in the middle, for the head and for the tail."""
        graph, size, middle = self.graph, self.graph.size, (self.low + self.high) / 2
        aside = float(np.median(graph.places @ self.axes[0]))
        rows = []
        for way in self.branches:
            start, end = self.axes @ graph.places[way[0]], self.axes @ graph.tips[way[-1]]
            length, below = max(float(graph.reach[way[0]]), 1e-3 * size), graph.subtrees[way[0]]
            run = (end - start) / length
            carries = any(shape.rest[0] > LIMB_SHARE for shape in self.shapes if shape.pair.one in below)
            rest = [
                (end[1] - self.low[1]) / self.height,
                (end[2] - middle[2]) / size,
                run[1],
                run[2],
                length / size,
                graph.radii[way].max() / size,
                graph.masses[below].sum(),
                abs(end[0] - aside) / size,
                float(graph.faces[below].any()),
                float(carries),
            ]
            rows.append([[1.0, said(graph, way, label, beyond=not carries), *rest] for label in SINGLE_LABELS])
        return np.array(rows, dtype=float).reshape(-1, len(SINGLE_LABELS), len(SINGLE_MEASURES))

    def pair_measures(self, head: int) -> NDArray[np.float64]:
        """Return `PAIR_MEASURES` (p, 4, 14) of all pairs for each label, if a branch is the head (−1: none is)."""
        if head not in self._pair_measures:
            place = self.graph.tips[self.branches[head][-1]] if head >= 0 else self.graph.places[0]
            away = np.array([float(np.linalg.norm(shape.roots.mean(axis=0) - place)) for shape in self.shapes])
            near = 1 - away / max(float(away.max(initial=0.0)), 1e-12)
            tips = [float((min(shape.ends @ self.up) - self.low[1]) / self.height) for shape in self.shapes]
            rows = [
                [
                    [1.0, named, np.exp(-(tip - min(tips)) / GROUND_SHARE), tip, *self._runs(shape), *shape.rest]
                    for named in shape.names
                ]
                for shape, tip in zip(self.shapes, tips, strict=True)
            ]
            found = np.array(rows, dtype=float).reshape(-1, len(PAIR_LABELS), len(PAIR_MEASURES) - 1)
            self._pair_measures[head] = np.insert(found, 9, near[:, None], axis=2)
        return self._pair_measures[head]

    def _runs(self, shape: PairShape) -> tuple[float, float, float, float]:
        """Return how high a pair begins, and how far it leads down, to its sides and forwards."""
        runs = shape.runs @ self.axes.T
        outwards = (runs[0, 0] - runs[1, 0]) / 2
        root = (shape.roots.mean(axis=0) @ self.up - self.low[1]) / self.height
        return root, -runs[:, 1].mean(), -outwards if self.mirrored else outwards, runs[:, 2].mean()

    def labelled(self, weights: Weights, inside: Inside | None = None) -> Body:
        """Return the body with the best labels, for which points inside the character may speak, too."""
        singles = np.array([self.single_measures[:, k] @ weights[label] for k, label in enumerate(SINGLE_LABELS)]).T
        best: tuple[float, int, int, list[str | None]] = (-np.inf, -1, -1, [])
        for head in [row for row in np.argsort(-singles[:, 0])[:MAX_HEADS].tolist() if self._is_head(row)] or [-1]:
            tails = [row for row in range(len(singles)) if singles[row, 1] > 0 and self._is_tail(row, head)]
            tail = max(tails, key=lambda row: singles[row, 1], default=-1)
            measures = self.pair_measures(head)
            scores = np.array([measures[:, k] @ weights[label] for k, label in enumerate(PAIR_LABELS)]).T
            if inside is not None and self.shapes:
                scores += [evidence(inside, self.graph, shape) for shape in self.shapes]
            beyond_head, beyond_tail = self.beyond(head), self.beyond(tail)
            scores[np.ix_(beyond_head, np.arange(len(PAIR_LABELS)) != PAIR_LABELS.index("ear"))] = -np.inf
            scores[beyond_tail, PAIR_LABELS.index("leg")] = -np.inf  # what hangs on a tail are fins
            scores[[shape.names[2:].max() > 0 for shape in self.shapes], :2] = -np.inf  # called wings or ears
            if len(rows := self._rows({*beyond_head, *beyond_tail})) >= MIN_NAMELESS_ROWS:
                most = scores[rows].max(axis=1)
                others = {number for number, shape in enumerate(self.shapes) if not shape.names.any()}
                scores[sorted(others.difference(beyond_head, beyond_tail))] = -np.inf
                scores[rows, 0] = most
            labels, total = _assigned(scores)
            total += (singles[head, 0] if head >= 0 else 0.0) + (singles[tail, 1] if tail >= 0 else 0.0)
            best = max(best, (float(total), head, tail, labels), key=lambda each: each[0])
        total, head, tail, labels = best
        found = {label: self.branches[row] for label, row in (("head", head), ("tail", tail)) if row >= 0}
        measures = self.orientation_measures(total, found, labels)
        pairs = tuple((label, pair) for label, pair in zip(labels, self.pairs, strict=True) if label)
        pairs += tuple(self._others(labels, self.beyond(head) + self.beyond(tail)))
        return Body(self.up, self.front, pairs, found, measures, float(weights["orientation"] @ measures))

    def _rows(self, beyond: set[int]) -> list[int]:
        """Return the pairs that may be rows of legs: long ones without names that are about as long as each other.

        Those beyond the head or the tail are none.
        """
        nameless = [not shape.names.any() and number not in beyond for number, shape in enumerate(self.shapes)]
        lengths = np.array([shape.rest[0] for shape in self.shapes]) * nameless
        return np.flatnonzero((lengths > LIMB_SHARE) & (lengths > ROW_RATIO * lengths.max(initial=0.0))).tolist()

    def _others(self, labels: Sequence[str | None], excluded: Sequence[int]) -> Iterator[tuple[str, Pair]]:
        """Yield the pairs without a label that are called arms or wings, if there is another pair of that label."""
        for number, (label, shape) in enumerate(zip(labels, self.shapes, strict=True)):
            called = PAIR_LABELS[int(shape.names.argmax())]
            is_limb = shape.names.max() > 0 and shape.rest[0] > LIMB_SHARE and number not in excluded
            if label is None and is_limb and called in ("arm", "wing") and called in labels:
                yield called, self.pairs[number]

    def beyond(self, row: int) -> list[int]:
        """Return the pairs that hang on a branch in the middle; −1 for none."""
        below = self._nodes(row)
        return [number for number, pair in enumerate(self.pairs) if pair.one in below]

    def _nodes(self, row: int) -> set[int]:
        """Return the nodes of a branch in the middle and of what hangs on it; of the whole body, only the first."""
        if row < 0:
            return set()
        first = self.branches[row][0]
        return {*self.graph.subtrees[first]} if first else {first}

    def _is_head(self, row: int) -> bool:
        """Return whether the names on a branch do not say that it is something else."""
        return bool(self.single_measures[row, 0, SINGLE_MEASURES.index("name")] > -1)

    def _is_tail(self, row: int, head: int) -> bool:
        """Return whether a branch can be the tail: no long pair hangs on it, and it is apart from the head."""
        long = any(self.shapes[number].rest[0] > LIMB_SHARE for number in self.beyond(row))
        return not long and not self._nodes(row) & self._nodes(head)

    def orientation_measures(
        self, total: float, singles: Mapping[str, list[int]], labels: Sequence[str | None]
    ) -> NDArray[np.float64]:
        """Return `ORIENTATION_MEASURES` (13,) of a labelled body."""
        graph, box, middle = self.graph, self.high - self.low, (self.low + self.high) / 2
        chosen = [(label, shape) for label, shape in zip(labels, self.shapes, strict=True) if label]
        legs = [shape for label, shape in chosen if label == "leg"]
        stance = [max(-2.0 * float(shape.step @ self.up) - 1.0, 0.0) for shape in legs if shape.names[0] > 0]
        toes = np.concatenate([np.zeros((0, 3)), *(shape.feet for shape in legs)]) @ self.front
        knees = np.concatenate([np.zeros((0, 3)), *(shape.bends for shape in legs)]) @ self.front
        arms = [shape.bends for label, shape in chosen if label == "arm"]
        elbows = -np.concatenate([np.zeros((0, 3)), *arms]) @ self.front
        lies = len(legs) > 1 or (not arms and ("wing" in labels or not legs))  # the head is ahead, and not above
        marks, face = np.flatnonzero(graph.faces), self._named_ahead([shape for _, shape in chosen])
        if "head" in singles and len(marks):
            way = singles["head"]
            named = [node for node in way if graph.votes[node, LABELS.index("head")] and not graph.faces[node]]
            ahead = graph.tips[marks].mean(axis=0) - graph.places[named or way].mean(axis=0)
            face = float(np.clip(face + ahead @ self.front / (FACE_SHARE * graph.size), -1, 1))
        ends = {
            label: (graph.tips[way[-1]] @ self.front - middle[2]) / max(box[2], 1e-12) for label, way in singles.items()
        }
        return np.array(
            [
                total,
                float(self.up[1] > 0.5),
                float(self.up[1] > 0.5 and self.front[2] > 0.5),
                _mean([-shape.side if self.mirrored else shape.side for _, shape in chosen], 1.0),
                _mean(toes, 0.3),
                _mean(knees, 0.1),
                _mean(elbows, 0.1),
                face,
                ends.get("head", 0.0),
                -ends.get("tail", 0.0),
                float(sum(1 - shape.pair.unlikeness for _, shape in chosen)),
                ends.get("head", 0.0) if lies else 0.0,
                _mean(stance, 1.0),
            ]
        )

    def _named_ahead(self, pairs: Sequence[PairShape]) -> float:
        """Return how far pairs that are called front are ahead of those that are called hind, from −1 to 1."""
        named = np.array([self.graph.quarters[[shape.pair.one, shape.pair.other]].mean() for shape in pairs])
        at = np.array([(shape.roots + shape.ends).mean(axis=0) @ self.front for shape in pairs])
        ahead = named * (at - at.sum() / max(len(at), 1))
        return float(ahead.sum() / max(np.abs(ahead).sum(), 1e-12))


def _mean(values: Sequence[float] | NDArray[np.float64], limit: float) -> float:
    """Return the mean of values within a limit; 0 for none."""
    return float(np.clip(np.mean(values), -limit, limit)) if len(values) else 0.0


def _branches(graph: BodyGraph, pairs: Sequence[Pair], middle: Sequence[int]) -> list[list[int]]:
    """Return the branches in the middle: the longest way from the trunk to an end for each.

    The trunk is what is above long pairs, and above forks that are far from the ends. What forks beyond it, such as a
    head with hair, is one branch. A part of the trunk beyond a fork is one as well: it may be a head with long ears.
    The first node of a row of joints is an end as well.
    """
    beside = graph.faces | (graph.votes[:, LABELS.index("ear")] > 0)
    inside, limbs = set(middle), [node for pair in pairs for node in (pair.one, pair.other)]
    below = {node: [child for child in graph.children[node] if child in inside] for node in middle}
    trunk = {above for node in limbs if graph.reach[node] > LIMB_SHARE * graph.size for above in graph.ancestors(node)}
    longest = FORK_SHARE * graph.reach[0]
    for fork in middle:
        if len(below[fork]) > 1 and graph.reach[fork] > longest:
            trunk |= {fork, *graph.ancestors(fork)}
    trunk.add(0)
    forks = [node for node in trunk if len(graph.children[node]) > 1]
    found = []
    for top in middle:
        parent = int(graph.parents[top])
        if parent not in trunk or (top in trunk and parent not in forks):
            continue
        way = [top]
        while below[way[-1]]:
            way.append(max(below[way[-1]], key=lambda child: graph.reach[child] - graph.size * beside[child]))
        found.append(way)
    if not pairs and len(graph.children[0]) == 1:
        found.append([0])
    return found


def _assigned(scores: NDArray[np.float64]) -> tuple[list[str | None], float]:
    """Return the label of each pair, None for nothing, and the sum of their scores; all labels but legs are for one."""
    count = len(scores)
    if not count:
        return [], 0.0
    own = scores[:, 1:]
    table = np.hstack([own, np.repeat(np.maximum(scores[:, :1], 0.0), count, axis=1)])
    rows, columns = scipy.optimize.linear_sum_assignment(-table)
    labels: list[str | None] = [None] * count
    for row, column in zip(rows, columns, strict=True):
        if column < own.shape[1] and table[row, column] > 0:
            labels[row] = PAIR_LABELS[1 + column]
        elif column >= own.shape[1] and scores[row, 0] > 0:
            labels[row] = "leg"
    return labels, float(table[rows, columns].sum())
