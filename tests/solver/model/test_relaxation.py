"""Chebyshev iteration: what it leaves, and by how much it reduces what it removes."""

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from solver.model import fields
from solver.model.relaxation import ROUGH_EIGENVALUE_RATIO, STEPS, relaxed


@pytest.fixture(scope="module")
def operator(figure):
    return fields.laplacian(figure)


def test_solutions_stay_as_they_are(operator):
    L, mass = operator
    shifts, load = np.array([-3.0, -70.0]), np.random.default_rng(1).normal(size=(len(mass), 2))
    exact = np.column_stack(
        [np.linalg.solve(-L.toarray() - s * np.diag(mass), b) for s, b in zip(shifts, load.T, strict=True)]
    )
    assert_allclose(relaxed(L, mass, shifts, exact.copy(), load), exact, rtol=0, atol=1e-9)


def test_each_part_of_an_error_is_reduced_by_the_chebyshev_polynomial(operator):
    L, mass = operator
    diagonal = -L.diagonal()
    largest = np.asarray(np.abs(L).sum(axis=1)).ravel() / diagonal
    values, vectors = scipy.linalg.eigh(-L.toarray(), np.diag(diagonal))
    top = float(np.max(largest))
    low = top / ROUGH_EIGENVALUE_RATIO
    place = (top + low - 2 * values) / (top - low)
    T = np.polynomial.chebyshev.Chebyshev.basis(STEPS)
    expected = T(place) / T((top + low) / (top - low))
    found = relaxed(L, mass, np.zeros(len(values)), vectors.copy())
    assert_allclose(found, vectors * expected, rtol=0, atol=1e-10 * np.abs(vectors).max())
    assert np.abs(expected[values > low]).max() < 1 / 20
