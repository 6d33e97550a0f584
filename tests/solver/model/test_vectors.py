"""Vectors of three numbers, as plain Python functions: hand-computed values, and NumPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

RANDOM = np.random.default_rng(2).normal(size=(9, 3))


@pytest.fixture(scope="module")
def vectors(interpreted):
    return interpreted("solver.model.vectors")


@pytest.mark.parametrize("vector", [*RANDOM, (3.0, 0.0, 0.0), (0.0, 1e-9, 0.0), (1e9, -1e9, 1.0)])
def test_a_direction_has_length_one_and_its_perpendicular_a_right_angle(vectors, vector):
    direction, across = vectors.unit(vector), vectors.perpendicular(vector)
    assert_allclose(np.multiply(direction, np.linalg.norm(vector)), vector, rtol=1e-12)
    assert vectors.length(across) == pytest.approx(1.0)
    assert vectors.dot(across, direction) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("short", [(0.0, 0.0, 0.0), (0.0, 1e-12, 0.0), (np.nan, 1.0, 0.0)], ids=str)
def test_a_vector_that_is_too_short_or_unknown_has_no_direction(vectors, short):
    assert vectors.unit(short) == (0.0, 0.0, 0.0)
