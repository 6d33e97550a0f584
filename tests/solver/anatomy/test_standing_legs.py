"""Legs of bodies that lie, and bodies with an odd number of legs, made of capsules."""

from itertools import pairwise

import numpy as np
import pytest

from solver.anatomy.limb_finding import find_limbs

from .test_limb_finding import IMAGE, both, found

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


def of_right(limbs):
    return both(*limbs)[len(limbs) :]


def away(points, joints):
    return np.linalg.norm(np.asarray(points) - np.asarray(joints), axis=-1)


def test_a_hind_leg_has_a_knee_and_a_hock_and_a_front_leg_none(solver_mesh):
    limbs = found(solver_mesh([*TRUNK, *both(*HIND, *FRONT)]))
    for side, sign in FEET.items():
        hind, front = limbs[f"{side} hind leg"], limbs[f"{side} front leg"]
        assert (away(hind, sign * [HIP, STIFLE, HOCK, FETLOCK, TOE]) < [0.25, 0.12, 0.12, 0.12, 0.12]).all()
        assert len(front) == 4
        assert away(front[2:], sign * [FRONT_ANKLE, FRONT_TOE]).max() < 0.1
        assert np.abs(front[:2, [0, 2]] - (sign * (0.25, 0, 0.9))[[0, 2]]).max() < 0.1


@pytest.mark.parametrize(
    ("legs", "names"),
    [
        ([*MIDDLE, *both(*FRONT)], {"hind leg", "left front leg", "right front leg"}),
        ([*both(*HIND), *of_right(FRONT)], {"left hind leg", "right hind leg", "right front leg"}),
    ],
    ids=["in the middle", "on one side"],
)
def test_a_third_leg_of_a_body_that_lies_is_a_limb(solver_mesh, legs, names):
    limbs = found(solver_mesh([*TRUNK, *legs]))
    assert {name for name in limbs if "leg" in name} == names
    assert {"trunk", "head", "tail"} <= limbs.keys()
    ends = [end for start, end, _ in legs]
    for name in names:
        assert away(ends, limbs[name][-1]).min() < 0.15
        assert limbs[name][0, 1] > 0.8


def test_a_flamingo_on_one_leg_has_a_leg(solver_mesh):
    body = [((0.0, 1.5, -0.5), (0.0, 1.6, 0.4), 0.28)]
    neck = [((0.0, 1.7, 0.5), (0.0, 2.2, 0.8), 0.09), ((0.0, 2.2, 0.8), (0.0, 2.6, 0.8), 0.1)]
    leg = [((0.08, 1.4, 0.0), (0.08, 0.05, 0.0), 0.06)]
    limbs = found(solver_mesh([*body, *neck, *leg]))
    (name,) = (name for name in limbs if "leg" in name)
    assert away(limbs[name][-1], leg[0][1]) < 0.1
    assert away(limbs[name][0], (0.08, 1.4, 0.0)) < 0.2
    assert limbs["head"][-1, 1] > 2.3


def test_a_body_that_lies_without_legs_has_its_trunk_along_it(solver_mesh):
    points = [(0.35 * np.sin(2.2 * z), 0.12, z) for z in np.linspace(-2.5, 2.0, 10)]
    snake = [(start, end, 0.12) for start, end in pairwise(points)]
    limbs = found(solver_mesh([*snake, (points[-1], (0.0, 0.25, 2.4), 0.15)]))
    assert list(limbs) == ["trunk", "neck", "head", "tail"]
    way = np.concatenate([limbs["tail"][::-1], limbs["trunk"], limbs["neck"], limbs["head"]])
    assert (np.diff(way[:, 2]) > -0.1).all()
    assert (way[0, 2], way[-1, 2]) == pytest.approx((-2.6, 2.5), abs=0.15)


def test_legs_of_a_centipede_that_stand_close_together_are_not_one(solver_mesh):
    rows = np.linspace(1.5, -1.5, 8)
    legs = [((0.1, 0.4, z), (0.5, 0.06, z), 0.06) for z in rows]
    limbs = found(solver_mesh([((0.0, 0.4, -1.8), (0.0, 0.4, 2.0), 0.2), *both(*legs)]))
    assert sum("leg" in name for name in limbs) == 2 * len(rows)
    for row, z in enumerate(rows, 1):
        assert away(limbs[f"left leg {row}"][-1], (0.5, 0.06, z)) < 0.15


def test_nothing_is_unclear_about_a_third_leg_of_a_body_that_lies(solver_mesh):
    assert find_limbs(solver_mesh([*TRUNK, *MIDDLE, *both(*FRONT)]), np.eye(3)).notes == ()
