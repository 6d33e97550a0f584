import numpy as np
import pytest

from solver.anatomy.body_graph import Pair
from solver.anatomy.inside_evidence import Inside, evidence
from solver.anatomy.pair_shape import PAIR_LABELS, PairShape
from solver.anatomy.part_network import PARTS

from .bodies import person


def said(graph, names, count, **chances):
    """What points say of each node below the arms; nothing of others."""
    arms = [names.index(f"{side} {joint}") for side in ("left", "right") for joint in ("arm", "elbow", "wrist")]
    sums, counts = np.zeros((len(names), len(PARTS))), np.zeros(len(names))
    for part, chance in chances.items():
        sums[arms, PARTS.index(part)] = count * chance
    counts[arms] = count
    return Inside(sums, counts, 0.0)


def of_arms(count, votes=None, **chances):
    graph, names = person(votes=votes)
    shape = PairShape.of(graph, Pair(names.index("left arm"), names.index("right arm"), 0.0))
    return dict(zip(PAIR_LABELS, evidence(said(graph, names, count, **chances), graph, shape), strict=True))


def test_a_probability_becomes_a_logit_within_limits_and_ears_are_not_known():
    even = np.log(0.7 / 0.3)
    assert of_arms(5, arm=0.5, wing=1.0) == pytest.approx({"leg": -3, "arm": even, "wing": 3, "ear": 0})


def test_few_points_and_points_in_a_pair_with_a_name_say_nothing():
    assert not any(of_arms(0.5, wing=1.0).values())
    assert not any(of_arms(5, votes={"left arm": "arm"}, wing=1.0).values())
