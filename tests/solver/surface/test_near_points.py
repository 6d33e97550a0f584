import numpy as np
import pytest

from solver.surface.near_points import group_near


@pytest.mark.parametrize("seed", range(5))
def test_groups_are_the_clusters_of_points_within_the_tolerance(seed):
    tolerance = 0.01
    rng = np.random.default_rng(seed)
    cluster = rng.integers(0, 100, 300)
    centres = np.unravel_index(rng.choice(1000, 100, replace=False), (10, 10, 10))
    points = 4 * tolerance * np.column_stack(centres)[cluster]
    offsets = rng.normal(size=(300, 3))
    points += offsets * rng.uniform(0, 0.49 * tolerance, (300, 1)) / np.linalg.norm(offsets, axis=1, keepdims=True)
    first, place_of = group_near(points, tolerance)
    np.testing.assert_array_equal(first[place_of], (cluster[:, None] == cluster).argmax(axis=1))
    np.testing.assert_array_equal(place_of[first], np.arange(len(first)))
    assert (np.diff(first) > 0).all()
