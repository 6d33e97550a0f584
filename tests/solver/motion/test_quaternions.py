"""Unit quaternions, as plain Python functions: SciPy's rotations, and values by hand where SciPy has none."""

import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

ROTATIONS = Rotation.concatenate(
    [Rotation.random(20, random_state=3), Rotation.from_rotvec([*3.14159 * np.eye(3), [3e-10, -4e-10, 0], [0, 0, 0]])]
)
"""At random, nearly half turns, a tiny one and none."""

IDENTITY = (1.0, 0.0, 0.0, 0.0)
HALF = math.sqrt(0.5)
QUARTER_ABOUT_Z = (HALF, 0.0, 0.0, HALF)
"""It turns x to y."""


@pytest.fixture(scope="module")
def quat(interpreted):
    return interpreted("solver.motion.quaternions")


def ours(rotation):
    """Return a rotation of SciPy, whose scalar comes last, with the scalar first."""
    return tuple(np.roll(rotation.as_quat(canonical=True), 1))


def assert_same_rotation(q, rotation):
    assert abs(np.dot(q, ours(rotation))) == pytest.approx(1.0)  # q and -q are the same


def test_rotations_are_those_of_scipy(quat):
    v, rows = (0.3, -1.0, 2.0), np.empty((3, 3))
    for one, other in zip(ROTATIONS, ROTATIONS[::-1], strict=True):
        q, vector = ours(one), one.as_rotvec()
        assert_allclose(quat.rotated(q, v), one.apply(v))
        assert_allclose(quat.rotated(quat.inverse(q), v), one.inv().apply(v))
        assert_same_rotation(quat.product(q, ours(other)), one * other)
        assert_allclose(quat.from_vector(vector), q, rtol=1e-9, atol=1e-20)
        for same in (q, tuple(-each for each in q)):
            assert_allclose(quat.to_vector(same), vector, rtol=1e-9, atol=1e-20)
        quat.write_rows(q, rows)
        assert_allclose(rows, one.as_matrix().T, atol=1e-12)
        assert_same_rotation(quat.of_rows(rows), one)
    assert_allclose(quat.of_matrices(ROTATIONS.as_matrix()), ROTATIONS.as_quat(canonical=True), atol=1e-12)


def test_a_quarter_turn_about_an_axis_a_length_and_a_row_are_those_by_hand(quat):
    assert quat.about((0.0, 0.0, 1.0), math.pi / 2) == pytest.approx(QUARTER_ABOUT_Z)
    assert quat.normalised((2.0, 0.0, 0.0, 2.0)) == pytest.approx(QUARTER_ABOUT_Z)
    assert quat.row_of(np.array([IDENTITY, QUARTER_ABOUT_Z]), 1) == QUARTER_ABOUT_Z


def test_the_least_rotation_goes_from_one_direction_to_the_other_by_the_angle_between(quat):
    directions = [*ROTATIONS[:20].apply([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    for a, b in itertools.pairwise(directions):
        q = quat.least(tuple(a), tuple(b))
        assert_allclose(quat.rotated(q, a), b, atol=1e-12)
        assert np.linalg.norm(quat.to_vector(q)) == pytest.approx(math.acos(np.dot(a, b)))
    assert quat.least((0.0, 1.0, 0.0), (0.0, 1.0, 0.0)) == IDENTITY


@pytest.mark.parametrize("turns", [-2, 0, 1])
def test_the_nearest_vector_of_a_rotation_counts_full_turns_and_keeps_the_axis_where_it_has_none(quat, turns):
    before = (0.0, 0.0, 2 * math.pi * turns + 1.0)
    assert quat.near_vector(QUARTER_ABOUT_Z, before) == pytest.approx((0.0, 0.0, 2 * math.pi * turns + math.pi / 2))
    assert quat.near_vector(IDENTITY, before) == pytest.approx((0.0, 0.0, 2 * math.pi * turns))


@pytest.mark.parametrize("degrees", [-179.0, 0.0, 30.0, 180.0])
def test_the_twist_is_the_angle_about_the_axis_alone(quat, degrees):
    angle = math.radians(degrees)
    before, after = (1.0, 0.0, 5.0), (2 * math.cos(angle), 2 * math.sin(angle), -1.0)  # other lengths along the axis
    assert quat.twist(before, after, (0.0, 0.0, 1.0)) == pytest.approx(angle)
