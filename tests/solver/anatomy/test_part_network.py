"""The network beside its formulas, computed point by point, and beside PyTorch."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from solver.anatomy import part_network
from solver.anatomy.part_network import COARSE, MIDDLE, NEIGHBORS, POINTS, _Layers, load_weights, parts_of

RNG = np.random.default_rng(8)
CLOUD = RNG.normal(size=(POINTS, 3)) * [0.4, 1.0, 0.3]
DEPTHS = RNG.uniform(0.01, 0.2, POINTS)


@pytest.fixture(scope="module")
def answer():
    return parts_of(CLOUD, DEPTHS)


def test_the_answer_moves_and_grows_with_the_points(answer):
    place = np.array([3.0, -2.0, 0.5])
    moved = parts_of(10 * CLOUD + place, 10 * DEPTHS)
    assert_allclose(moved.chances, answer.chances, atol=2e-3)
    assert_allclose((moved.joints - place) / 10, answer.joints, atol=2e-3)
    assert_allclose(moved.stands, answer.stands, atol=2e-2)


def test_probabilities_sum_to_one_and_the_weights_are_as_the_layers_need_them(answer):
    assert_allclose(answer.chances.sum(axis=1), 1, atol=1e-5)
    assert answer.joints.shape == (POINTS, 4, 3)
    assert load_weights() is load_weights()
    assert all(value.dtype == np.float32 for value in load_weights().values())


def test_the_order_of_points_within_a_set_does_not_matter(answer):
    order = np.concatenate(
        [
            RNG.permutation(COARSE),
            RNG.permutation(np.arange(COARSE, MIDDLE)),
            RNG.permutation(np.arange(MIDDLE, POINTS)),
        ]
    )
    other = parts_of(CLOUD[order], DEPTHS[order])
    assert_allclose(other.chances, answer.chances[order], atol=2e-3)
    assert_allclose(other.joints, answer.joints[order], atol=2e-3)


def test_neighbors_say_the_largest_of_their_values_and_ways():
    layers, width = _Layers(load_weights()), len(load_weights()["e1b.a.weight"])
    x, values = CLOUD[:MIDDLE].astype(np.float32), RNG.normal(size=(MIDDLE, width)).astype(np.float32)
    found = layers._edges("e1b", x, x, values, values)
    count, unit = NEIGHBORS["e1b"]
    weights = {key.removeprefix("e1b."): value for key, value in load_weights().items() if key.startswith("e1b.")}
    for point in (0, 7, MIDDLE - 1):
        away = np.linalg.norm(x - x[point], axis=1)
        said = [
            weights["a.weight"] @ values[other]
            + weights["p.weight"] @ np.append(x[other] - x[point], away[other]) / unit
            + weights["p.bias"]
            for other in away.argsort()[:count]
        ]
        own = np.maximum(np.max(said, axis=0) + weights["q.weight"] @ values[point] + weights["q.bias"], 0)
        out = weights["m.weight"] @ own + weights["m.bias"]
        normed = (out - out.mean()) / np.sqrt(out.var() + 1e-5) * weights["n.weight"] + weights["n.bias"]
        assert_allclose(found[point], normed, atol=1e-4)


def test_values_at_a_place_are_those_of_the_three_nearest_weighted_by_closeness():
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [9, 9, 9]], np.float32)
    values = np.array([[1.0], [2.0], [4.0], [100.0]], np.float32)
    shares = np.array([1 / 0.5001, 1 / 0.5001, 1 / (np.hypot(0.5, 2) + 1e-4)])
    expected = shares @ values[:3, 0] / shares.sum()
    assert_allclose(part_network._spread(np.array([[0.5, 0, 0]], np.float32), x, values), [[expected]], rtol=1e-5)
