import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from solver.skinning.symmetry import mirror_images, symmetric
from solver.skinning.weights import Weights, as_matrix

LEFT = np.array([1.0, 0.0, 0.0])


def test_each_vertex_finds_its_mirror_image_and_only_that():
    points = np.array([[1.0, 2, 3], [5.0, 2, 3], [3.0, 0, 0], [4.0, 1, 1], [2.0, 1, 1.1], [5.0, 9, 9], [1.0, 9, 9]])
    assert_array_equal(mirror_images(points, LEFT), [1, 0, 2, -1, -1, 6, 5])


def test_images_do_not_depend_on_where_the_surface_is_or_how_it_is_turned():
    rng = np.random.default_rng(0)
    half = rng.uniform(0.1, 1, (50, 3))
    points = np.concatenate([half, half * [-1, 1, 1]])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    images = mirror_images(points @ turn.T + [10, -5, 3], turn @ LEFT)
    assert_array_equal(images, np.roll(np.arange(100), 50))


def test_symmetric_weights_are_means_with_left_and_right_exchanged():
    weights = np.array([[0.6, 0.4], [1.0, 0.0], [0.5, 0.5], [0.9, 0.1]], dtype=np.float32)
    bones = np.array([[1, 0], [2, 0], [1, 2], [1, 0]], dtype=np.uint16)  # 0 is in the middle, 1 and 2 are a pair
    found = symmetric(Weights(weights, bones), np.array([1, 0, 2, -1]), np.array([0, 2, 1]))
    assert_allclose(
        as_matrix(found, 3).toarray(), [[0.2, 0.8, 0], [0.2, 0, 0.8], [0, 0.5, 0.5], [0.1, 0.9, 0]], atol=1e-7
    )


def test_a_mean_of_more_bones_than_allowed_keeps_the_largest_on_both_sides():
    weights = np.array([[0.7, 0.3], [0.8, 0.2]], dtype=np.float32)
    bones = np.array([[1, 0], [2, 3]], dtype=np.uint16)
    found = as_matrix(symmetric(Weights(weights, bones), np.array([1, 0]), np.array([0, 2, 1, 3])), 4).toarray()
    assert_allclose(found[0], found[1][[0, 2, 1, 3]], atol=1e-7)
    assert_allclose(found[0], [0.15 / 0.9, 0.75 / 0.9, 0, 0], atol=1e-7)
