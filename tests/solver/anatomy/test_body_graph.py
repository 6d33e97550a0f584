"""A body's tree: its lengths and ways by hand, and its pairs whatever the order, scale, place and direction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.anatomy.body_graph import find_pairs

from .bodies import person

PAIRS = {("left arm", "right arm"), ("left hip", "right hip")}


def named(pairs, names):
    return {(names[pair.one], names[pair.other]) for pair in pairs}


def test_lengths_ways_and_what_is_below_are_those_of_the_joints():
    graph, names = person()
    wrist, arm, chest = (names.index(name) for name in ("left wrist", "left arm", "chest"))
    assert graph.reach[wrist] == pytest.approx(0.18)
    assert graph.reach[arm] == pytest.approx(0.18 + np.sqrt(0.25**2 + 2 * 0.02**2) + np.hypot(0.25, 0.02))
    assert [names[node] for node in graph.ways[arm]] == ["left arm", "left elbow", "left wrist"]
    assert {names[node] for node in graph.subtrees[chest]} >= {"chest", "neck", "head", "left wrist", "right wrist"}
    assert [names[node] for node in graph.ancestors(arm)] == ["chest", "spine", "pelvis"]
    assert graph.size == pytest.approx(1.8)


def test_mirrored_branches_are_pairs_and_what_is_below_belongs_to_them():
    graph, names = person()
    pairs, singles = find_pairs(graph, 0)
    assert named(pairs, names) == PAIRS
    assert [pair.unlikeness for pair in pairs] == pytest.approx([0, 0])
    assert {names[node] for node in singles} == {"pelvis", "spine", "chest", "neck", "head"}
    for axis in (1, 2):
        assert find_pairs(graph, axis)[0] == []


@given(st.randoms(use_true_random=False), st.floats(0.01, 100), st.tuples(*[st.floats(-50, 50)] * 3))
def test_order_scale_and_place_do_not_matter(random, scale, shift):
    plain, names = person()
    order, waiting = [], ["pelvis"]
    while waiting:  # parents before their children
        order.append(waiting.pop(random.randrange(len(waiting))))
        waiting += [names[child] for child in plain.children[names.index(order[-1])]]
    graph, own = person(order=order, scale=scale, shift=shift)
    pairs, _ = find_pairs(graph, 0)
    assert named(pairs, own) == PAIRS
    np.testing.assert_allclose([pair.unlikeness for pair in pairs], 0, atol=1e-6)


def test_names_with_one_side_or_different_labels_speak_against_a_pair():
    plain = find_pairs(person()[0], 0)[0]
    both_left, _ = person(sides={"left arm": 1.0, "right arm": 1.0})
    different, _ = person(votes={"left arm": "arm", "right arm": "wing"})
    sides, _ = person(sides={"left arm": 1.0, "right arm": -1.0})

    def unlikeness(graph):
        return max(pair.unlikeness for pair in find_pairs(graph, 0)[0])

    assert unlikeness(sides) <= plain[0].unlikeness + 1e-12
    assert unlikeness(both_left) > 0.1
    assert {pair.one for pair in find_pairs(different, 0)[0]} == {person()[1].index("left hip")}


def test_what_is_within_a_limb_of_one_side_is_no_pair():
    """Two fingers of a hand in front of the chest are as alike as the limbs of a body."""
    fingers = {f"finger {x}": ("hand", (x, 1.3, 0.3), (x, 1.0, 0.3)) for x in (-0.1, 0.1)}
    hand = {"hand": ("chest", (0, 1.3, 0.3), (0, 1.3, 0.3))}
    graph, names = person(sides={"hand": 1.0}, more=hand | fingers)
    assert named(find_pairs(graph, 0)[0], names) == PAIRS


def test_halves_of_a_body_are_no_pair():
    """The farthest ends of the upper and the lower half are on different sides."""
    graph, names = person()
    halves = [names.index(name) for name in names if "left" not in name and "right" not in name]
    pairs = find_pairs(graph, 0)[0]
    assert not {node for pair in pairs for node in (pair.one, pair.other)} & {*halves}
