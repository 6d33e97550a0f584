"""Which bones move the surface of a foot that stands."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from solver.model.bones import Bones
from solver.model.feet import feet_held

LEG = Bones(
    heads=np.array([[0.0, 2, 0], [0, 1, 0], [0, 0.2, 0]]),
    tails=np.array([[0.0, 1, 0], [0, 0.2, 0], [0, 0, 0.4]]),
    parents=np.array([-1, 0, 1]),
    limbs=np.array([0, 0, 0]),
    feet=np.array([2]),
)
FLOOR = [[0, 0, 0.4], [0, 0, -0.05], [0, 0.1, 0.0]]
NO_PLATES = np.zeros(6, dtype=bool)
SHIN = [[0, 0.5, 0], [0, 1.0, 0], [0, 1.5, 0]]


def test_soles_follow_their_foot_alone():
    shares = np.array([[0.1, 0.3, 0.6], [0.1, 0.8, 0.1], [0.2, 0.5, 0.3]] + 3 * [[0.1, 0.9, 0.0]])
    held = feet_held(shares, np.array(FLOOR + SHIN), LEG, NO_PLATES[:6])
    assert_array_equal(held[:3], [[0, 0, 1]] * 3)
    assert_array_equal(held[3:], shares[3:])


def test_shares_keep_their_sum_between_sole_and_shin():
    between = np.array([[0, 0.25, 0.0], [0, 0.25, 0.1]])  # 1.25 ankle heights: half way from sole to shin
    held = feet_held(
        np.array([[0.2, 0.8, 0], [0, 0.8, 0.2], [0, 0, 1]]), np.vstack([between, [[0, 0, 0.4]]]), LEG, NO_PLATES[:3]
    )
    assert_allclose(held[:2], [[0.1, 0.4, 0.5], [0, 0.4, 0.6]])


def test_other_limbs_and_feet_that_do_not_stand_keep_their_shares():
    shares = np.array([[0.1, 0.3, 0.6], [0.5, 0.4, 0.1], [0.0, 0.0, 0.0]])
    hanging = Bones(LEG.heads, LEG.tails, LEG.parents, LEG.limbs)
    assert_array_equal(feet_held(shares, np.array(FLOOR), hanging, NO_PLATES[:3]), shares)
    apart = Bones(LEG.heads, LEG.tails, LEG.parents, np.array([-1, 0, 0]), LEG.feet)
    assert_array_equal(feet_held(shares, np.array(FLOOR), apart, NO_PLATES[:3])[1:], shares[1:])


def test_a_leg_that_lies_on_the_floor_and_a_rigid_plate_keep_their_shares():
    far_and_rigid = np.array([[0, 0, -0.7], [0, 0, -1.2], [0, 0.1, 0]])
    shares = np.array([[0.0, 0.8, 0.2], [0.0, 0.8, 0.2], [0, 1, 0]])
    held = feet_held(shares, far_and_rigid, LEG, np.array([False, False, True]))
    assert 0.2 < held[0, 2] < 1  # between heel and leg
    assert_array_equal(held[1:], shares[1:])


def test_the_sole_of_a_stout_leg_is_wider_than_its_foot_is_long():
    stout = Bones(LEG.heads, np.array([*LEG.tails[:2], [0, 0.1, 0.05]]), LEG.parents, LEG.limbs, LEG.feet)
    held = feet_held(np.array([[0.2, 0.7, 0.1]]), np.array([[0, 0, -0.2]]), stout, NO_PLATES[:1])
    assert_array_equal(held, [[0, 0, 1]])
