"""Legs of bodies that lie, and bodies with an odd number of legs, made of capsules."""

from itertools import pairwise

import numpy as np
import pytest

from solver.anatomy.limb_finding import find_limbs

from ..shapes import body_of
from .test_limb_finding import ARM, BODY, IMAGE, KNEE, SKULL, both, found
from .test_limb_finding import HIP as HIP_OF_A_PERSON

HIP, STIFLE, HOCK, FETLOCK, TOE = (
    (0.2, 1.0, -0.9),
    (0.25, 0.72, -0.62),
    (0.25, 0.4, -1.1),
    (0.25, 0.08, -1.0),
    (0.25, 0.05, -0.8),
)
FRONT_ANKLE, FRONT_TOE = (0.25, 0.07, 0.92), (0.25, 0.05, 1.1)
TRUNK = [
    ((0.0, 1.0, -1.0), (0.0, 1.0, 1.0), 0.30),
    ((0.0, 1.0, 1.0), (0.0, 1.7, 1.5), 0.16),
    ((0.0, 1.7, 1.5), (0.0, 1.65, 1.9), 0.19),
    ((0.0, 1.0, -1.0), (0.0, 1.5, -1.9), 0.09),
]
HIND = [(HIP, STIFLE, 0.17), (STIFLE, HOCK, 0.1), (HOCK, FETLOCK, 0.08), (FETLOCK, TOE, 0.07)]
FRONT = [((0.2, 1.0, 0.9), FRONT_ANKLE, 0.1), (FRONT_ANKLE, FRONT_TOE, 0.07)]
MIDDLE = [((0.0, 1.0, -0.9), (0.0, 0.07, -0.95), 0.11)]
FEET = {"left": np.ones(3), "right": IMAGE}


def away(points, joints):
    return np.linalg.norm(np.asarray(points) - np.asarray(joints), axis=-1)


def test_a_hind_leg_has_a_knee_and_a_hock_and_a_front_leg_none():
    limbs = found(body_of([*TRUNK, *both(*HIND, *FRONT)]))
    for side, sign in FEET.items():
        hind, front = limbs[f"{side} hind leg"], limbs[f"{side} front leg"]
        assert (away(hind, sign * [HIP, STIFLE, HOCK, FETLOCK, TOE]) < [0.25, 0.12, 0.12, 0.12, 0.12]).all()
        assert len(front) == 4
        assert away(front[2:], sign * [FRONT_ANKLE, FRONT_TOE]).max() < 0.1
        assert np.abs(front[:2, [0, 2]] - (sign * (0.25, 0, 0.9))[[0, 2]]).max() < 0.1


def test_a_rump_that_sticks_out_is_no_hock():
    straight = [((0.2, 1.0, -0.8), (0.25, 0.07, -0.8), 0.1), ((0.25, 0.07, -0.8), (0.25, 0.05, -0.62), 0.07)]
    rump = [((0.12, 0.85, -1.05), (0.14, 0.62, -0.9), 0.17)]
    limbs = found(body_of([*TRUNK, *both(*straight, *rump, *FRONT)]))
    heights = limbs["left hind leg"][1:-1, 1]
    assert (np.diff(heights) < -0.2).all()
    assert heights[-1] < 0.35


def test_a_tail_that_hangs_between_the_hind_legs_is_a_limb():
    tail = [((0.0, 1.05, -1.2), (0.0, 0.9, -1.35), 0.09), ((0.0, 0.9, -1.35), (0.0, 0.3, -1.35), 0.09)]
    limbs = found(body_of([*TRUNK[:3], *tail, *both(*HIND, *FRONT)]))
    assert away(limbs["tail"][-1], (0.0, 0.25, -1.35)) < 0.1


@pytest.mark.parametrize(
    ("legs", "names"),
    [
        ([*MIDDLE, *both(*FRONT)], {"hind leg", "left front leg", "right front leg"}),
        ([*both(*HIND), *both(*FRONT)[len(FRONT) :]], {"left hind leg", "right hind leg", "right front leg"}),
    ],
    ids=["in the middle", "on one side"],
)
def test_a_third_leg_of_a_body_that_lies_is_a_limb(legs, names):
    limbs = found(body_of([*TRUNK, *legs]))
    assert {name for name in limbs if "leg" in name} == names
    assert {"trunk", "head", "tail"} <= limbs.keys()
    ends = [end for start, end, _ in legs]
    for name in names:
        assert away(ends, limbs[name][-1]).min() < 0.15
        assert limbs[name][0, 1] > 0.8


def test_a_flamingo_on_one_leg_has_a_leg():
    body = [((0.0, 1.5, -0.5), (0.0, 1.6, 0.4), 0.28)]
    neck = [((0.0, 1.7, 0.5), (0.0, 2.2, 0.8), 0.09), ((0.0, 2.2, 0.8), (0.0, 2.6, 0.8), 0.1)]
    leg = [((0.08, 1.4, 0.0), (0.08, 0.05, 0.0), 0.06)]
    limbs = found(body_of([*body, *neck, *leg]))
    (name,) = (name for name in limbs if "leg" in name)
    assert away(limbs[name][-1], leg[0][1]) < 0.1
    assert away(limbs[name][0], (0.08, 1.4, 0.0)) < 0.2
    assert limbs["head"][-1, 1] > 2.3


def test_a_body_that_lies_without_legs_has_its_trunk_along_it():
    points = [(0.35 * np.sin(2.2 * z), 0.12, z) for z in np.linspace(-2.5, 2.0, 10)]
    snake = [(start, end, 0.12) for start, end in pairwise(points)]
    limbs = found(body_of([*snake, (points[-1], (0.0, 0.25, 2.4), 0.15)]))
    assert list(limbs) == ["trunk", "neck", "head", "tail"]
    way = np.concatenate([limbs["tail"][::-1], limbs["trunk"], limbs["neck"], limbs["head"]])
    assert (np.diff(way[:, 2]) > -0.1).all()
    assert (way[0, 2], way[-1, 2]) == pytest.approx((-2.6, 2.5), abs=0.15)


FROG_HIND = [(0.3, 0.5, -1.0), (0.95, 0.42, -0.2), (0.9, 0.12, -1.3), (1.25, 0.08, -0.2)]
FROG_FRONT = [(0.45, 0.7, 0.5), (0.95, 0.4, 0.1), (1.0, 0.1, 0.7), (1.0, 0.08, 1.1)]
FROG_TOES = [((1.0, 0.1, 0.7), (0.75, 0.08, 1.0), 0.06), ((1.0, 0.1, 0.7), (1.3, 0.08, 0.95), 0.06)]


def test_a_frog_sits_on_folded_legs_with_their_joints_at_the_corners_and_one_foot_with_its_toes():
    body = [((0.0, 0.6, -1.0), (0.0, 0.75, 0.9), 0.42), ((0.0, 0.8, 0.9), (0.0, 0.8, 1.3), 0.36)]
    legs = [(*bone, 0.1) for joints in (FROG_HIND, FROG_FRONT) for bone in pairwise(joints)]
    limbs = found(body_of([*body, *both(*legs, *FROG_TOES)], 0.04))
    assert sum("leg" in name for name in limbs) == 4
    for side, sign in FEET.items():
        assert away(limbs[f"{side} hind leg"][1:], sign * FROG_HIND[1:]).max() < 0.2
        assert away(limbs[f"{side} front leg"][:3], sign * FROG_FRONT[:3]).max() < 0.25


def test_a_straight_leg_has_its_joints_at_the_usual_places():
    limbs = found(body_of([*TRUNK, *both(*HIND, ((0.25, 1.0, 0.9), (0.25, 0.06, 0.9), 0.1))]))
    for side in FEET:
        np.testing.assert_allclose(limbs[f"{side} front leg"][1:3, 1], np.multiply(0.7, (0.65, 0.22)), atol=0.08)


def pillars(*feet):
    return [((x, 0.9, z), (x, y, z), 0.1) for x, y, z in feet]


@pytest.mark.parametrize(
    ("limbs", "feet"),
    [
        (
            [((x, 0.9, -0.8), (x, 0.9, 0.8), 0.1) for x in np.linspace(-0.6, 0.6, 9)],
            [(x, 0.0, z) for x in (0.6, -0.6) for z in (-0.8, 0.8)],
        ),
        (TRUNK, [(0.25, 0.0, -0.9), (-0.25, 0.0, -0.9), (0.25, 0.0, 0.9), (-0.25, 0.25, 0.9)]),
        (TRUNK, [(0.25, -0.3, -0.9), (-0.25, -0.3, -0.9), (0.25, -0.3, 0.9), (-0.25, -0.3, 0.9), (0.0, -0.3, 0.0)]),
    ],
    ids=["a table", "one leg is too short", "a fifth leg in the middle"],
)
def test_each_leg_of_an_odd_body_is_a_limb_with_its_own_foot_or_is_named(limbs, feet):
    result = find_limbs(body_of([*limbs, *pillars(*feet)], 0.045), np.eye(3))
    ends = [points[-1] for name, points in result.points.items() if "leg" in name]
    said = [note.split(" at ")[1].split(". ")[0] for note in result.notes if note.startswith("Something else")]
    ends += [np.array(place.split(","), dtype=float) for place in said]
    assert len(ends) == len(feet)
    for foot in feet:
        assert away(ends, foot).min() < 0.2, (foot, result.notes)


def test_a_person_who_stands_on_the_toes_has_ankles_above_them():
    toes = (0.18, 0.06, 0.12)
    leg = [(HIP_OF_A_PERSON, KNEE, 0.08), (KNEE, (0.18, 0.28, 0.0), 0.06), ((0.18, 0.28, 0.0), toes, 0.05)]
    limbs = found(body_of([*BODY, SKULL, *both(*ARM, *leg)]))
    for side, sign in FEET.items():
        np.testing.assert_allclose(limbs[f"{side} leg"][2:], sign * np.array([(0.18, 0.28, 0.0), toes]), atol=0.12)


def test_a_ghost_with_arms_and_no_legs_glides():
    robe = [((0.0, 1.4, 0.0), (0.0, 0.9, 0.0), 0.22), ((0.0, 0.9, 0.0), (0.05, 0.3, -0.2), 0.12)]
    result = find_limbs(body_of([*robe, SKULL, *BODY[1:], *both(*ARM)]), np.eye(3))
    assert {"left arm", "right arm"} <= result.points.keys()
    assert not any("leg" in name for name in result.points)
    assert [note.split(".")[0] for note in result.notes] == ["No legs were found"]
