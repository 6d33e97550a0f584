import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.model.polar import of_matrices as nearest


def by_svd(S):
    U, _, Vt = np.linalg.svd(S)
    U[:, :, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))[:, None]
    return U @ Vt


@pytest.fixture
def matrices():
    """Matrices of every handedness, turned so that nothing lies along an axis."""
    return np.random.default_rng(5).normal(size=(2_000, 3, 3))


def assert_rotations(R):
    assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-13)
    assert_allclose(np.linalg.det(R), 1, atol=1e-13)


@pytest.mark.parametrize("stretch", [(1, 1, 1), (1, 1e-2, 1e-3), (1e3, 1, 1), (1e-9, 1e-9, 1e-9), (1e9, 1e9, 1e8)])
def test_the_nearest_rotation_is_the_polar_factor_of_the_singular_value_decomposition(matrices, stretch):
    S = matrices * np.array(stretch)
    R = nearest(S)
    assert_rotations(R)
    assert_allclose(R, by_svd(S), atol=1e-10)


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_a_singular_matrix_gives_a_rotation_that_fits_what_it_determines(matrices, rank):
    U, sigma, Vt = np.linalg.svd(matrices)
    sigma[:, rank:] = 0
    flat = U * sigma[:, None] @ Vt
    R = nearest(flat)
    assert_rotations(R)
    # tr(Rᵀ S) is at its maximum, the sum of the singular values
    assert_allclose(np.einsum("kij,kij->k", R, flat), sigma.sum(axis=1), atol=1e-7)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 80])
def test_a_matrix_gives_the_same_rotation_whatever_lies_beside_it(matrices, count):
    assert_array_equal(nearest(matrices[:count]), nearest(matrices)[:count])
