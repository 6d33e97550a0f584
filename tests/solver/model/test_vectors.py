"""Vectors of three numbers, as plain Python functions: hand-computed values, and NumPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

RANDOM = np.random.default_rng(2).normal(size=(9, 3))


@pytest.fixture(scope="module")
def vectors(interpreted):
    return interpreted("solver.model.vectors")


def test_products_sums_and_blends_are_those_computed_by_hand(vectors):
    a, b = (1.0, 2.0, 3.0), (4.0, -5.0, 6.0)
    assert vectors.dot(a, b) == 12.0
    assert vectors.cross(a, b) == (27.0, 6.0, -13.0)
    assert vectors.scaled(a, -2.0) == (-2.0, -4.0, -6.0)
    assert vectors.minus(a, b) == (-3.0, 7.0, -3.0)
    assert vectors.plus(a, b, 0.5) == (3.0, -0.5, 6.0)
    assert vectors.length((2.0, -3.0, 6.0)) == 7.0
    assert vectors.blend(a, b, 0.25) == (1.75, 0.25, 3.75)
    assert (vectors.blend(a, b, 0.0), vectors.blend(a, b, 1.0)) == (a, b)


def test_rows_and_axes_of_arrays_are_those_of_numpy(vectors):
    rows = RANDOM[:3]
    assert vectors.row_of(rows, 1) == tuple(rows[1])
    assert vectors.between(rows, 2, 0) == tuple(rows[0] - rows[2])
    assert_allclose(vectors.in_axes((1.0, 2.0, 3.0), rows), np.array([1.0, 2.0, 3.0]) @ rows)


@pytest.mark.parametrize("vector", [*RANDOM, (3.0, 0.0, 0.0), (0.0, 1e-9, 0.0), (1e9, -1e9, 1.0)])
def test_a_direction_has_length_one_and_its_perpendicular_a_right_angle(vectors, vector):
    direction, across = vectors.unit(vector), vectors.perpendicular(vector)
    assert_allclose(np.multiply(direction, np.linalg.norm(vector)), vector, rtol=1e-12)
    assert vectors.length(across) == pytest.approx(1.0)
    assert vectors.dot(across, direction) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("short", [(0.0, 0.0, 0.0), (0.0, 1e-12, 0.0), (np.nan, 1.0, 0.0)], ids=str)
def test_a_vector_that_is_too_short_or_unknown_has_no_direction(vectors, short):
    assert vectors.unit(short) == (0.0, 0.0, 0.0)


def test_a_perpendicular_is_computed_from_the_smallest_coordinate(vectors):
    assert vectors.perpendicular((0.0, 3.0, 4.0)) == pytest.approx((0.0, 0.8, -0.6))
    assert vectors.perpendicular((3.0, 0.0, 4.0)) == pytest.approx((-0.8, 0.0, 0.6))
    assert vectors.perpendicular((3.0, 4.0, 0.0)) == pytest.approx((0.8, -0.6, 0.0))
