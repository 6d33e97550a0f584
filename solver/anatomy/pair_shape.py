"""Shapes of pairs of branches, for the measures of `solver.anatomy.body_decision`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.anatomy.body_graph import LABELS, BodyGraph, Pair

PAIR_LABELS = ("leg", "arm", "wing", "ear")
"""What a pair can be."""

FOOT_BEGIN = 0.85
"""Length of a leg without the foot, or of an arm without the hand, as a share of the whole; joints beyond it are of
the foot or the hand."""


@dataclass(frozen=True, eq=False)
class PairShape:
    """What the measures of a pair need, in the coordinates of the graph.

    Attributes
    ----------
    pair : Pair
    roots, ends, runs, feet, bends : (2, 3) float64
        First and last points; from first to last, the end beyond the last inner joint, and how far the middle is
        beside the line from the first to the last inner joint, in lengths.
    step : (3,) float64
        Mean of the directions from the first points to the last joints, or to the ends of limbs with two joints.
    rest : tuple of float
        Length, thickness, number of fingers, mass and unlikeness.
    names : (4,) float64
        How far names speak for `PAIR_LABELS`.
    side : float
        1 if names say that the first branch is left, −1 if right; 0 if they do not say what it is either.
    """

    pair: Pair
    roots: NDArray[np.float64]
    ends: NDArray[np.float64]
    runs: NDArray[np.float64]
    feet: NDArray[np.float64]
    bends: NDArray[np.float64]
    step: NDArray[np.float64]
    rest: tuple[float, ...]
    names: NDArray[np.float64]
    side: float

    @classmethod
    def of(cls, graph: BodyGraph, pair: Pair) -> "PairShape":
        """Measure a pair."""
        sides = (pair.one, pair.other)
        ways, below = [graph.ways[node] for node in sides], [graph.subtrees[node] for node in sides]
        lengths = np.maximum(graph.reach[list(sides)], 1e-3 * graph.size)[:, None]
        lines = [np.vstack([graph.places[way], graph.tips[way[-1:]]]) for way in ways]
        roots, ends = np.array([line[0] for line in lines]), np.array([line[-1] for line in lines])
        inner = [_without_end(line) for line in lines]
        steps = np.array([line[-2 if len(line) > 3 else -1] - line[0] for line in lines])
        leaves = np.mean([sum(not graph.children[node] for node in nodes) for nodes in below])
        radius = np.mean([np.median(graph.radii[way]) for way in ways])
        rest = (
            float(lengths.mean()) / graph.size,
            float(radius / lengths.mean()),
            min(float(leaves) - 1, 4.0) / 4,
            float(sum(graph.masses[nodes].sum() for nodes in below)),
            max(pair.unlikeness, 0.0),
        )
        return cls(
            pair,
            roots,
            ends,
            (ends - roots) / lengths,
            (ends - [line[-1] for line in inner]) / lengths,
            np.array([_bend(line) for line in inner]) / lengths,
            np.mean(steps / np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-12), axis=0),
            rest,
            np.array([said(graph, ways[0] + ways[1], label) for label in PAIR_LABELS]),
            float(
                np.sign(graph.sides[pair.one] - graph.sides[pair.other]) * graph.votes[list(sides)].any(axis=1).all()
            ),
        )


def said(graph: BodyGraph, nodes: Sequence[int], label: str, beyond: bool = False) -> float:
    """Return how far names of nodes speak for a label, 1, or for others, −1; 0 if they say nothing.

    Parameters
    ----------
    graph : BodyGraph
    nodes : sequence of int
    label : str
        One of `LABELS`.
    beyond : bool
        Whether they are beyond the trunk, whose names say nothing there: a spine leads on into the neck and the tail.
    """
    votes = graph.votes[list(nodes)].sum(axis=0)
    if beyond:
        votes = votes * (np.array(LABELS) != "trunk")
    return float((2 * votes[LABELS.index(label)] - votes.sum()) / max(float(votes.sum()), 1.0))


def _without_end(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a limb's points without the foot or the hand."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return points[: max(int(np.count_nonzero(along <= FOOT_BEGIN * along[-1])), min(len(points), 2))]


def _bend(inner: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the middle of a limb is beside the line from its root to its last joint."""
    line, beside = inner[-1] - inner[0], inner - inner[0]
    beside = beside - np.outer(beside @ line / max(float(line @ line), 1e-12), line)
    return np.asarray(beside[np.linalg.norm(beside, axis=1).argmax()])
