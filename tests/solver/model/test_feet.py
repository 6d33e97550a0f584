"""Which bones move the surface of a foot that stands."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from solver.model.bones import Bones
from solver.model.feet import feet_held

from ..shapes import points

HANGING = Bones(
    points("0 2 0, 0 1 0, 0 0.2 0"), points("0 1 0, 0 0.2 0, 0 0 0.4"), np.array([-1, 0, 1]), np.zeros(3, int)
)
LEG = replace(HANGING, feet=np.array([2]))
FLOOR = "0 0 0.4, 0 0 -0.05, 0 0.1 0"


def held(shares, places, leg=LEG, plates=()):
    """The shares of a leg's bones in vertices at these places, of which some are on rigid plates."""
    return feet_held(np.array(shares), points(places), leg, np.isin(np.arange(len(shares)), plates))


def test_soles_follow_their_foot_alone():
    shares = [[0.1, 0.3, 0.6], [0.1, 0.8, 0.1], [0.2, 0.5, 0.3], *3 * [[0.1, 0.9, 0.0]]]
    found = held(shares, f"{FLOOR}, 0 0.5 0, 0 1 0, 0 1.5 0")
    assert_array_equal(found, [*3 * [[0, 0, 1]], *shares[3:]])


def test_shares_keep_their_sum_between_sole_and_shin():
    """At 1.25 ankle heights, half way from sole to shin."""
    found = held([[0.2, 0.8, 0], [0, 0.8, 0.2], [0, 0, 1]], "0 0.25 0, 0 0.25 0.1, 0 0 0.4")
    assert_allclose(found[:2], [[0.1, 0.4, 0.5], [0, 0.4, 0.6]])


def test_other_limbs_and_feet_that_do_not_stand_keep_their_shares():
    shares = [[0.1, 0.3, 0.6], [0.5, 0.4, 0.1], [0.0, 0.0, 0.0]]
    assert_array_equal(held(shares, FLOOR, HANGING), shares)
    apart = replace(LEG, limbs=np.array([-1, 0, 0]))
    assert_array_equal(held(shares, FLOOR, apart)[1:], shares[1:])


def test_a_leg_that_lies_on_the_floor_and_a_rigid_plate_keep_their_shares():
    shares = [[0.0, 0.8, 0.2], [0.0, 0.8, 0.2], [0, 1, 0]]
    found = held(shares, "0 0 -0.7, 0 0 -1.2, 0 0.1 0", plates=[2])
    assert 0.2 < found[0, 2] < 1  # between heel and leg
    assert_array_equal(found[1:], shares[1:])


def test_the_sole_of_a_stout_leg_is_wider_than_its_foot_is_long():
    stout = replace(LEG, tails=points("0 1 0, 0 0.2 0, 0 0.1 0.05"))
    assert_array_equal(held([[0.2, 0.7, 0.1]], "0 0 -0.2", stout), [[0, 0, 1]])
