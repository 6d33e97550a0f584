from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import nnls

from engine_bridge.export import skin_weights


@pytest.fixture
def planted():
    """Errors and weights of 300 vertices that at most four of seven bones move exactly."""
    rng = np.random.default_rng(3)
    weights = np.zeros((300, 7))
    for row in weights:
        chosen = rng.choice(7, rng.integers(1, 5), replace=False)
        row[chosen] = rng.dirichlet(np.full(len(chosen), 3.0))
    missed = rng.normal(0, 0.2, (300, 7, 90))
    # what the others miss, the heaviest bone makes up for
    heaviest = weights.argmax(axis=1)
    rows = np.arange(300)
    missed[rows, heaviest] -= np.einsum("nk,nkf->nf", weights, missed) / weights[rows, heaviest, None]
    return missed, weights


def objective(missed, weights):
    return (np.einsum("nk,nkf->nf", weights, missed) ** 2).sum(axis=1)


def assert_on_the_simplex(weights):
    assert (weights >= 0).all()
    assert (weights > 0).sum(axis=1).max() <= 4
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-9)


def test_weights_that_carry_exactly_are_found(planted):
    missed, weights = planted
    found = skin_weights.solve(missed, np.full(weights.shape, 1 / 7))
    assert_on_the_simplex(found)
    np.testing.assert_allclose(found, weights, atol=1e-4)


def test_two_bones_share_a_vertex_between_them_as_by_hand():
    """Errors of +3 and −1 along x cancel with weights of a quarter and three quarters."""
    missed = np.array([[[3.0, 0, 0], [-1.0, 0, 0]]])
    np.testing.assert_allclose(skin_weights.solve(missed, np.full((1, 2), 0.5)), [[0.25, 0.75]], atol=1e-6)


def test_a_bone_that_would_get_less_than_nothing_gets_nothing():
    missed = np.array([[[1.0, 0, 0], [2.0, 0, 0]]])
    np.testing.assert_array_equal(skin_weights.solve(missed, np.full((1, 2), 0.5)), [[1, 0]])


def test_where_the_motion_leaves_them_open_the_weights_are_those_expected():
    expected = np.array([[0.1, 0.2, 0.3, 0.4]])
    np.testing.assert_allclose(skin_weights.solve(np.zeros((1, 4, 30)), expected), expected, atol=1e-12)


def test_four_of_many_are_nearly_as_good_as_the_best_four():
    """The reference is the best of all subsets by non-negative least squares, with a heavy row for Σ w = 1."""
    rng = np.random.default_rng(5)
    missed = rng.normal(0, 1, (40, 7, 12))
    found = skin_weights.solve(missed, np.full((40, 7), 1 / 7))
    assert_on_the_simplex(found)
    best = np.full(40, np.inf)
    for four in map(list, combinations(range(7), 4)):
        for v in range(40):
            weights, _ = nnls(np.vstack([missed[v, four].T, np.full(4, 1e4)]), np.append(np.zeros(12), 1e4))
            best[v] = min(best[v], ((weights @ missed[v, four]) ** 2).sum())
    ratio = np.sqrt(objective(missed, found) / best)
    assert np.median(ratio) < 1.01
    assert ratio.max() < 1.5


def test_packed_weights_sum_to_one_and_a_bone_without_weight_is_zero():
    rng = np.random.default_rng(1)
    weights = rng.dirichlet(np.ones(4), 1000)
    weights[::3, 2:] = 0
    weights /= weights.sum(axis=1, keepdims=True)
    bones = rng.permuted(np.tile(np.arange(200), (1000, 1)), axis=1)[:, :4]
    made, of = skin_weights.packed(weights, bones)
    assert (made.dtype, of.dtype) == (np.float32, np.uint8)
    np.testing.assert_allclose(made.astype(np.float64).sum(axis=1), 1, atol=1.2e-7)
    assert (np.diff(made, axis=1) <= 1e-7).all()
    assert (of[made == 0] == 0).all()
    for dense, packed_ in zip(
        skin_weights.sparse(weights, bones, 200), skin_weights.sparse(made, of, 200), strict=True
    ):
        np.testing.assert_allclose(dense.toarray(), packed_.toarray(), atol=2e-7)


def test_fewer_than_four_candidates_are_filled_up():
    made, of = skin_weights.packed(np.ones((2, 1)), np.array([[3], [5]]))
    np.testing.assert_array_equal(made, [[1, 0, 0, 0]] * 2)
    np.testing.assert_array_equal(of, [[3, 0, 0, 0], [5, 0, 0, 0]])
