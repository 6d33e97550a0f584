import numpy as np
import pytest

from engine_bridge.export.key_thinning import interpolated, thin


def test_only_the_ends_of_straight_motion_are_kept():
    """One point stands for 10 frames, moves straight for 10, turns, and moves on for 10."""
    x = np.concatenate([np.zeros(10), np.arange(11), np.full(10, 10)])
    z = np.concatenate([np.zeros(20), np.arange(11)])
    points = np.stack([x, np.zeros(31), z], axis=1)[:, None]
    np.testing.assert_array_equal(thin(points, 1e-6), [0, 10, 20, 30])
    np.testing.assert_array_equal(thin(points, 0), np.arange(31))
    np.testing.assert_array_equal(thin(points[:2], 1.0), [0, 1])


@pytest.mark.parametrize("tolerance", [0.02, 0.05, 0.1])
def test_every_point_stays_within_the_tolerance(tolerance):
    points = np.cumsum(np.random.default_rng(3).normal(size=(200, 5, 3)) * 0.01, axis=0)
    kept = thin(points, tolerance)
    shown = interpolated(points.reshape(200, -1)[kept], kept).reshape(points.shape)
    assert np.linalg.norm(shown - points, axis=2).max() <= tolerance * (1 + 1e-5)
    assert (kept[0], kept[-1]) == (0, 199)
    assert (np.diff(kept) > 0).all()
    assert len(kept) < 200


def test_values_between_kept_frames_are_on_straight_lines():
    values = np.array([[0.0, 1.0], [4.0, 1.0], [4.0, 0.0]])
    expected = [[0, 1], [1, 1], [2, 1], [3, 1], [4, 1], [4, 0.5], [4, 0]]
    np.testing.assert_array_equal(interpolated(values, np.array([0, 4, 6])), expected)
