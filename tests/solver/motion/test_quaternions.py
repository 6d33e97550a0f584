"""Unit quaternions, as plain Python functions: hand-computed values, and SciPy's rotations."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

ROTATIONS = Rotation.random(20, random_state=3)
IDENTITY = (1.0, 0.0, 0.0, 0.0)
HALF = math.sqrt(0.5)
QUARTER_ABOUT_Z = (HALF, 0.0, 0.0, HALF)
"""It turns x to y."""


@pytest.fixture(scope="module")
def quat(interpreted):
    return interpreted("solver.motion.quaternions")


def ours(rotation):
    """Return a rotation of SciPy, whose scalar comes last, with the scalar first."""
    x, y, z, w = rotation.as_quat()
    return w, x, y, z


def assert_same_rotation(q, rotation):
    assert abs(np.dot(q, ours(rotation))) == pytest.approx(1.0)  # q and -q are the same


def test_a_quarter_turn_is_the_one_computed_by_hand(quat):
    assert quat.rotated(QUARTER_ABOUT_Z, (1.0, 2.0, 3.0)) == pytest.approx((-2.0, 1.0, 3.0))
    assert quat.rotated(quat.inverse(QUARTER_ABOUT_Z), (1.0, 2.0, 3.0)) == pytest.approx((2.0, -1.0, 3.0))
    assert quat.product(QUARTER_ABOUT_Z, QUARTER_ABOUT_Z) == pytest.approx((0.0, 0.0, 0.0, 1.0))
    assert quat.about((0.0, 0.0, 1.0), math.pi / 2) == pytest.approx(QUARTER_ABOUT_Z)
    assert quat.from_vector((0.0, 0.0, math.pi / 2)) == pytest.approx(QUARTER_ABOUT_Z)
    assert quat.to_vector(QUARTER_ABOUT_Z) == pytest.approx((0.0, 0.0, math.pi / 2))
    assert quat.normalised((2.0, 0.0, 0.0, 2.0)) == pytest.approx(QUARTER_ABOUT_Z)
    assert quat.row_of(np.array([IDENTITY, QUARTER_ABOUT_Z]), 1) == QUARTER_ABOUT_Z


@pytest.mark.parametrize("k", range(19))
def test_products_and_vectors_are_those_of_scipy(quat, k):
    one, other = ROTATIONS[k], ROTATIONS[k + 1]
    a, b, v = ours(one), ours(other), (0.3, -1.0, 2.0)
    assert_allclose(quat.rotated(a, v), one.apply(v))
    assert_same_rotation(quat.product(a, b), one * other)
    assert quat.rotated(quat.product(a, b), v) == pytest.approx(quat.rotated(a, quat.rotated(b, v)))
    assert quat.product(a, quat.inverse(a)) == pytest.approx(IDENTITY)
    assert_allclose(quat.to_vector(a), one.as_rotvec(), atol=1e-12)
    assert_allclose(quat.to_vector(tuple(-each for each in a)), one.as_rotvec(), atol=1e-12)
    assert_same_rotation(quat.from_vector(one.as_rotvec()), one)


@pytest.mark.parametrize("rotation", [*ROTATIONS, *(Rotation.from_rotvec(v) for v in np.pi * np.eye(3))])
def test_rows_of_a_matrix_are_the_turned_axes_and_give_the_rotation_back(quat, rotation):
    rows = np.empty((3, 3))
    quat.write_rows(ours(rotation), rows)
    assert_allclose(rows, rotation.as_matrix().T, atol=1e-12)
    assert_same_rotation(quat.of_rows(rows), rotation)


@pytest.mark.parametrize("k", range(10))
def test_the_least_rotation_goes_from_one_direction_to_the_other_by_the_angle_between(quat, k):
    a, b = (rotation.apply([1.0, 0.0, 0.0]) for rotation in (ROTATIONS[k], ROTATIONS[k + 10]))
    q = quat.least(tuple(a), tuple(b))
    assert_allclose(quat.rotated(q, a), b, atol=1e-12)
    assert np.linalg.norm(quat.to_vector(q)) == pytest.approx(math.acos(a @ b))


def test_the_least_rotation_between_opposite_directions_is_half_a_turn(quat):
    q = quat.least((0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
    assert quat.rotated(q, (0.0, 1.0, 0.0)) == pytest.approx((0.0, -1.0, 0.0))
    assert np.linalg.norm(quat.to_vector(q)) == pytest.approx(math.pi)
    assert quat.least((0.0, 1.0, 0.0), (0.0, 1.0, 0.0)) == IDENTITY


def test_a_tiny_rotation_loses_no_precision(quat):
    vector = (3e-10, -4e-10, 0.0)
    assert quat.to_vector(quat.from_vector(vector)) == pytest.approx(vector, rel=1e-12)
    assert quat.to_vector(IDENTITY) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
def test_the_nearest_vector_of_a_rotation_counts_full_turns(quat, turns):
    before = (0.0, 0.0, 2 * math.pi * turns + 1.0)
    assert quat.near_vector(QUARTER_ABOUT_Z, before) == pytest.approx((0.0, 0.0, 2 * math.pi * turns + math.pi / 2))


def test_the_nearest_vector_of_no_rotation_keeps_the_axis_of_the_one_before(quat):
    assert quat.near_vector(IDENTITY, (6.0, 0.0, 0.0)) == pytest.approx((2 * math.pi, 0.0, 0.0))


@pytest.mark.parametrize("degrees", [-179.0, -90.0, 0.0, 30.0, 180.0])
def test_the_twist_is_the_angle_about_the_axis_alone(quat, degrees):
    angle = math.radians(degrees)
    before, after = (1.0, 0.0, 5.0), (2 * math.cos(angle), 2 * math.sin(angle), -1.0)  # other lengths along the axis
    assert quat.twist(before, after, (0.0, 0.0, 1.0)) == pytest.approx(angle)


def test_quaternions_of_matrices_are_those_of_scipy(quat):
    found = quat.of_matrices(ROTATIONS.as_matrix())
    assert_allclose(found, ROTATIONS.as_quat(canonical=True), atol=1e-12)
