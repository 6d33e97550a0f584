"""What points inside a character say of a pair of branches that has no name."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.anatomy.body_graph import BodyGraph
from solver.anatomy.pair_shape import PAIR_LABELS, PairShape
from solver.anatomy.part_network import PARTS

ASKED = [PARTS.index(label) for label in PAIR_LABELS[:3]]
"""Parts that the points inside know, in the order of the labels: legs, arms and wings. They know no ears."""

MIN_ASKED = 0.05
"""Minimum length of a pair about which the points inside are asked, as a share of the body's size."""

MIN_POINTS = 4
"""Minimum number of points that tell what a pair is."""

LEAST_CHANCE, USUAL_CHANCE, MAX_EVIDENCE = 0.02, 0.3, 3.0
"""What is added to probabilities, the probability of a label that says nothing about it, and the most that points say
for or against it, in logits."""


@dataclass(frozen=True, eq=False)
class Inside:
    """What points inside a character say of the nodes of its graph.

    Attributes
    ----------
    chances : (n, 6) float64
        Sums of the probabilities of `solver.anatomy.part_network.PARTS` over the points that are nearest to what
        follows each node.
    counts : (n,) float64
        Numbers of these points.
    stands : float
        Logit of the probability that the character stands in the way that was asked about.
    """

    chances: NDArray[np.float64]
    counts: NDArray[np.float64]
    stands: float


def evidence(inside: Inside, graph: BodyGraph, shape: PairShape) -> NDArray[np.float64]:
    """Return what is added to the scores (4,) of `PAIR_LABELS`, in logits; nothing for a pair that has a name."""
    found = np.zeros(len(PAIR_LABELS))
    below = [node for top in (shape.pair.one, shape.pair.other) for node in graph.subtrees[top]]
    count = float(inside.counts[below].sum())
    if shape.names.any() or count < MIN_POINTS:
        return found
    chances = inside.chances[below].sum(axis=0)[ASKED] / count
    odds = np.log((chances + LEAST_CHANCE) / (1 + LEAST_CHANCE - chances)) - np.log(USUAL_CHANCE / (1 - USUAL_CHANCE))
    found[: len(ASKED)] = np.clip(odds, -MAX_EVIDENCE, MAX_EVIDENCE)
    return found
