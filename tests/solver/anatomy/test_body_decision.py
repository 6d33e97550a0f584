"""Up, front and limbs of a person are found from the graph, in any coordinates, and as far as they are known."""

from dataclasses import replace

import numpy as np
import pytest

from solver.anatomy.body_decision import ORIENTATION_MEASURES, decide, load_weights

from ..shapes import TURNS
from .bodies import person
from .test_inside_evidence import said

NAMED = {f"{side} {joint}": "leg" for side in ("left", "right") for joint in ("hip", "knee", "ankle", "toes")}
"""Names of the legs, and of nothing else."""

UP, FRONT = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])

WEIGHTS = load_weights("joints")

OTHERS = np.array([name not in ("up", "front") for name in ORIENTATION_MEASURES])
"""Measures that do not depend on the file's axes."""

WITHOUT_AXES = WEIGHTS | {"orientation": WEIGHTS["orientation"] * OTHERS}
"""Weights that do not know in which direction most files have up and front."""


def limbs(body, names):
    return {(label, names[pair.one], names[pair.other]) for label, pair in body.pairs}


PERSON = {("arm", "left arm", "right arm"), ("leg", "left hip", "right hip")}


def test_a_person_stands_and_looks_to_the_front_with_left_on_the_left():
    graph, names = person()
    ways = decide(graph, WEIGHTS)
    chances = [chance for chance, _ in ways]
    assert len(ways) == 24
    assert sum(chances) == pytest.approx(1)
    assert chances == sorted(chances, reverse=True)
    best = ways[0][1]
    np.testing.assert_array_equal([best.up, best.front, best.left], [UP, FRONT, [1, 0, 0]])
    assert limbs(best, names) == PERSON
    assert [names[node] for node in best.singles["head"]][-1] == "head"


@pytest.mark.parametrize("turn", TURNS)
def test_a_turned_person_is_seen_in_the_same_way(turn):
    graph, names = person(turn=turn, scale=3.0, shift=(5, -2, 1))
    chance, best = decide(graph, WITHOUT_AXES)[0]
    plain, upright = decide(person()[0], WITHOUT_AXES)[0]
    np.testing.assert_allclose([best.up, best.front], [turn @ UP, turn @ FRONT], atol=1e-12)
    assert limbs(best, names) == limbs(upright, names) == PERSON
    assert chance == pytest.approx(plain)
    np.testing.assert_allclose(best.measures[OTHERS], upright.measures[OTHERS], atol=1e-9)


def test_known_directions_are_kept_and_the_rest_is_decided():
    graph, names = person()
    ways = decide(graph, WEIGHTS, up=-UP)
    assert len(ways) == 4
    assert all(np.array_equal(body.up, -UP) for _, body in ways)
    [(chance, body)] = decide(graph, WEIGHTS, UP, -FRONT)
    assert chance == 1
    assert limbs(body, names) == {(label, other, one) for label, one, other in PERSON}


def test_names_say_what_a_pair_is_and_which_side_is_left():
    sides = (("left", 1), ("right", -1))
    graph, names = person(votes={f"{side} {joint}": "wing" for side, _ in sides for joint in ("arm", "elbow", "wrist")})
    assert ("wing", "left arm", "right arm") in limbs(decide(graph, WEIGHTS)[0][1], names)
    for sign in (1.0, -1.0):
        said = {f"{side} {joint}": sign * own for side, own in sides for joint in ("arm", "hip")}
        parts = {f"{side} {joint}": label for side, _ in sides for joint, label in (("arm", "arm"), ("hip", "leg"))}
        for votes, expected in ((parts, sign), ({}, 0.0)):  # of joints that are only numbered, sides may be a viewer's
            [(_, body)] = decide(person(votes=votes, sides=said)[0], WEIGHTS, UP, FRONT)
            assert dict(zip(ORIENTATION_MEASURES, body.measures, strict=True))["sides"] == expected


def test_names_of_front_and_hind_limbs_say_where_the_front_is():
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # it lies, with the arms at −z
    for sign in (1.0, -1.0):
        named = {f"{side} {joint}": own for side in ("left", "right") for joint, own in (("arm", sign), ("hip", -sign))}
        [(_, body)] = decide(person(quarters=named, turn=turn)[0], WEIGHTS, UP, FRONT)
        assert dict(zip(ORIENTATION_MEASURES, body.measures, strict=True))["face"] == pytest.approx(-sign)


def test_wings_and_ears_by_name_are_neither_arms_nor_legs():
    for label in ("wing", "ear"):
        told = {f"{side} {joint}": label for side in ("left", "right") for joint in ("hip", "knee", "ankle")}
        found = limbs(decide(person(votes=told)[0], WEIGHTS, UP, FRONT)[0][1], person()[1])
        assert not {(kind, "left hip", "right hip") for kind in ("leg", "arm")} & found


def asked(votes, **chances):
    """Decide with what points in the arms say; return what was found, and about which fronts they were asked."""
    graph, names = person(votes=votes)
    fronts = []

    def ask(axes):
        fronts.append(axes[2].tolist())
        return replace(said(graph, names, 5, **chances), stands=-9.0 * axes[2, 2])

    return decide(graph, WEIGHTS, UP, ask=ask), names, fronts


def test_points_inside_tell_what_a_pair_without_a_name_is():
    found, names, _ = asked(NAMED, wing=1.0)
    assert limbs(found[0][1], names) == {("wing", "left arm", "right arm"), ("leg", "left hip", "right hip")}


def test_half_of_the_logit_that_it_stands_so_is_added_to_the_likely_ways_and_others_are_left_out():
    before = {tuple(body.front): chance for chance, body in decide(person()[0], WEIGHTS, UP)}
    found, _, fronts = asked({})
    after = {tuple(body.front): chance for chance, body in found}
    assert set(after) == set(map(tuple, fronts)) == {(0, 0, 1), (1, 0, 0)}
    ratios = [chances[0, 0, 1] / chances[1, 0, 0] for chances in (before, after)]
    assert np.log(ratios[1]) == pytest.approx(np.log(ratios[0]) - 4.5)


def test_points_inside_are_not_asked_if_names_tell_all_pairs():
    votes = NAMED | {f"{side} {joint}": "arm" for side in ("left", "right") for joint in ("arm", "elbow", "wrist")}
    assert asked(votes, wing=1.0)[2] == []
