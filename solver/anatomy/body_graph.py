"""Body graph: a tree of nodes in the middle of a character's limbs, whatever it was built from, and its pairs."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

LABELS = ("head", "arm", "leg", "wing", "tail", "ear", "trunk")
"""What a branch of a body can be."""

MAX_UNLIKENESS = 0.6
"""Maximum unlikeness of two branches that are a pair."""

TIP_WEIGHT, SIDE_WEIGHT, LABEL_WEIGHT = 0.3, 0.5, 0.3
"""Weights, in the unlikeness of two branches, of the distance between one's end and the mirror image of the other's,
which a held pose moves, of named sides, and of different labels by name; those of root and length are 1."""

MAX_SAME_SIDE = 0.3
"""What two names with the same side say against a pair, as a share of what different sides say for it: names that were
copied may be wrong."""

LIMB_SHARE = 0.15
"""Minimum length of the branches of a pair that hangs on the trunk, as a share of the body's size; ears are shorter."""

GIRDLE_SHARE = 0.6
"""Minimum length of a limb that hangs on a girdle, as a share of that of the girdle with its limbs."""

MIN_BRANCH_SHARE = 0.02
"""Minimum length of the branches of a pair, and minimum distance between them from left to right, as a share of the
body's size."""


@dataclass(frozen=True, eq=False)
class BodyGraph:
    """A tree of nodes.

    Attributes
    ----------
    places : (n, 3) float64
    parents : (n,) int64
        Parents before their children; −1 for the root.
    tips : (n, 3) float64
        End of what follows each node, or its place if nothing does.
    radii : (n,) float64
        Distance of the surface from each node.
    masses : (n,) float64
        Share of the surface, or of the volume, that follows each node.
    votes : (n, 7) float64
        1 for the label that a node's name says.
    sides : (n,) float64
        Side that a node's name says: 1 for left, −1 for right, 0 for none.
    quarters : (n,) float64
        Pair of limbs that a node's name says: 1 for one in front, −1 for one behind, 0 for none.
    faces : (n,) bool
        Whether a node's name says that it is at the front of the head, as eyes and a jaw are.
    box : (2, 3) float64
        Lowest and highest coordinates of the character.
    """

    places: NDArray[np.float64]
    parents: NDArray[np.int64]
    tips: NDArray[np.float64]
    radii: NDArray[np.float64]
    masses: NDArray[np.float64]
    votes: NDArray[np.float64]
    sides: NDArray[np.float64]
    quarters: NDArray[np.float64]
    faces: NDArray[np.bool_]
    box: NDArray[np.float64]

    @cached_property
    def children(self) -> list[list[int]]:
        """Children of each node."""
        found: list[list[int]] = [[] for _ in self.parents]
        for node, parent in enumerate(self.parents.tolist()):
            if parent >= 0:
                found[parent].append(node)
        return found

    @cached_property
    def reach(self) -> NDArray[np.float64]:
        """Length (n,) of the longest way from each node to an end below it."""
        found = np.linalg.norm(self.tips - self.places, axis=1)
        for node in range(len(self.parents) - 1, 0, -1):
            parent = self.parents[node]
            found[parent] = max(found[parent], found[node] + np.linalg.norm(self.places[node] - self.places[parent]))
        return found

    @cached_property
    def size(self) -> float:
        """Largest extent of the character."""
        return max(float(np.ptp(self.box, axis=0).max()), 1e-12)

    @cached_property
    def ways(self) -> list[list[int]]:
        """Nodes on the longest way from each node to an end below it."""
        return [self._longest(node) for node in range(len(self.parents))]

    @cached_property
    def subtrees(self) -> list[list[int]]:
        """Each node and all nodes below it, parents before their children."""
        return [self._below(node) for node in range(len(self.parents))]

    @cached_property
    def centers(self) -> NDArray[np.float64]:
        """Middle (n, 3) of what each node and those below it move, or of their ends."""
        masses = self.masses + 1e-9
        return np.array([np.average(self.tips[nodes], axis=0, weights=masses[nodes]) for nodes in self.subtrees])

    def _longest(self, node: int) -> list[int]:
        way = [node]
        while self.children[way[-1]]:
            here = way[-1]
            best = max(self.children[here], key=lambda child: self._length(here, child))
            if self._length(here, best) < np.linalg.norm(self.tips[here] - self.places[here]) * (1 - 1e-9):
                break
            way.append(best)
        return way

    def _length(self, parent: int, child: int) -> float:
        return float(self.reach[child] + np.linalg.norm(self.places[child] - self.places[parent]))

    def _below(self, node: int) -> list[int]:
        found = [node]
        for each in found:
            found += self.children[each]
        return found

    def ancestors(self, node: int) -> list[int]:
        """Return the nodes above a node, the nearest first."""
        found = []
        while (node := int(self.parents[node])) >= 0:
            found.append(node)
        return found

    def vote(self, nodes: Sequence[int]) -> NDArray[np.float64]:
        """Return the shares (7,) of labels among those nodes that names tell; zeros if they tell none."""
        votes = self.votes[list(nodes)].sum(axis=0)
        return np.asarray(votes / max(float(votes.sum()), 1.0))


@dataclass(frozen=True)
class Pair:
    """Two branches that are one limb on both sides.

    Attributes
    ----------
    one, other : int
        Their first nodes; the first is farther along the axis from side to side.
    unlikeness : float
        0 for mirror images of each other.
    """

    one: int
    other: int
    unlikeness: float


def find_pairs(graph: BodyGraph, axis: int) -> tuple[list[Pair], list[int]]:
    """Return the pairs of branches of a body, and the nodes in none of them, parents before their children.

    Branches of one node are compared first, then the others. What is below a branch of a pair belongs to it.

    Parameters
    ----------
    graph : BodyGraph
    axis : int
        Coordinate from side to side.
    """
    pairs: list[Pair] = []
    singles: list[int] = []
    waiting, left_over = [0], list[int]()
    for node in waiting:
        below, sides = graph.children[node], graph.sides[graph.subtrees[node]]
        of_limb = bool((sides[0] * sides > 0).any() and (sides[0] * sides >= 0).all())  # what is below are fingers
        matched, others = ([], below) if of_limb else _matched(graph, axis, below)
        pairs += [limb for pair in matched for limb in _limbs(graph, axis, pair)]
        singles.append(node)
        waiting += others
        left_over += others if len(below) > 1 and not of_limb else []
    late, _ = _matched(graph, axis, left_over, nested=True)
    inside = {node for pair in late for first in (pair.one, pair.other) for node in graph.subtrees[first]}
    pairs = [pair for pair in pairs if pair.one not in inside and pair.other not in inside]
    return pairs + late, [node for node in singles if node not in inside]


def _limbs(graph: BodyGraph, axis: int, pair: Pair) -> list[Pair]:
    """Return a pair, or the pairs of limbs that hang on it, if it is a girdle: both sides fork into long branches."""
    sides = [_long_branches(graph, node) for node in (pair.one, pair.other)]
    if min(map(len, sides)) < 2:
        return [pair]
    found, _ = _matched(graph, axis, sides[0] + sides[1], one_side=set(sides[0]))
    return [limb for each in found for limb in _limbs(graph, axis, each)] or [pair]


def _long_branches(graph: BodyGraph, node: int) -> list[int]:
    """Return the branches at the first fork of a limb that are nearly as long as it is."""
    least = max(GIRDLE_SHARE * graph.reach[node], LIMB_SHARE * graph.size)
    while len(graph.children[node]) == 1:
        node = graph.children[node][0]
    return [child for child in graph.children[node] if graph.reach[child] > least]


def _matched(
    graph: BodyGraph, axis: int, nodes: Sequence[int], nested: bool = False, one_side: Collection[int] = ()
) -> tuple[list[Pair], list[int]]:
    """Return pairs among branches, the likest first, and the branches without a counterpart.

    If the branches of one side are given, a pair has one of them and one of the others.
    """
    long = [node for node in nodes if graph.reach[node] > MIN_BRANCH_SHARE * graph.size]
    found = sorted(
        (_unlikeness(graph, axis, one, other), one, other)
        for place, one in enumerate(long)
        for other in long[:place]
        if not nested or not ({one, other} & {*graph.ancestors(one), *graph.ancestors(other)})
        if not one_side or (one in one_side) != (other in one_side)
    )
    pairs, used = [], set[int]()
    for unlikeness, one, other in found:
        if unlikeness < MAX_UNLIKENESS and not {one, other} & used:
            below = {node for first in (one, other) for node in graph.subtrees[first]} if nested else {one, other}
            if below & used:
                continue
            used |= below
            ahead = _aside(graph, axis, one) >= _aside(graph, axis, other)
            pairs.append(Pair(one, other, unlikeness) if ahead else Pair(other, one, unlikeness))
    return pairs, [node for node in nodes if node not in used]


def _aside(graph: BodyGraph, axis: int, node: int) -> float:
    """Return how far along an axis a branch is: its root and the node after it, for limbs may cross."""
    way = graph.ways[node]
    return float(graph.places[way[:2], axis].sum() + (graph.tips[node, axis] if len(way) < 2 else 0.0))


def _unlikeness(graph: BodyGraph, axis: int, one: int, other: int) -> float:
    """Return how far two branches are from mirroring each other, in lengths of the longer one."""
    ends = [graph.tips[graph.ways[node][-1]] for node in (one, other)]
    roots = graph.places[[one, other]]
    apart = max(abs(roots[0, axis] - roots[1, axis]), abs(ends[0][axis] - ends[1][axis]))
    halves = abs(graph.centers[one, axis] - graph.centers[other, axis])  # none between two halves of a body
    if min(apart, halves) < MIN_BRANCH_SHARE * graph.size:
        return np.inf
    lengths = graph.reach[[one, other]]
    longer = float(lengths.max())
    middle = float(np.median(graph.places[:, axis]))
    away = [roots[0] - _mirrored(roots[1], axis, middle), ends[0] - _mirrored(ends[1], axis, middle)]
    root, tip = (min(float(np.linalg.norm(vector)) / longer, 1.0) for vector in away)
    named = min(float(graph.sides[one] * graph.sides[other]), MAX_SAME_SIDE)
    labels = graph.vote(graph.ways[one]) - graph.vote(graph.ways[other])
    return float(
        root
        + TIP_WEIGHT * tip
        + float(np.ptp(lengths)) / longer
        + SIDE_WEIGHT * named
        + LABEL_WEIGHT * np.abs(labels).sum()
    )


def _mirrored(point: NDArray[np.float64], axis: int, middle: float) -> NDArray[np.float64]:
    image = point.copy()
    image[axis] = 2 * middle - image[axis]
    return image
