import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.surfaces.surface import linear, upper_left


def test_srgb_becomes_linear_opacity_stays_and_no_numbers_are_white():
    given = np.array([[0.0, 0.04045, 1.0, 0.25], [0.5, 0.5, 0.5, 1.0], [np.nan, 0.0, -1.0, 1.0]])
    half = 0.21404114
    expected = [[0, 0.04045 / 12.92, 1, 0.25], [half, half, half, 1], [1, 0, 0, 1]]
    assert_allclose(linear(given), expected, atol=1e-8)


def test_texture_coordinates_are_turned_upside_down():
    assert_array_equal(
        upper_left(np.array([[0.25, 0.0], [3.0, 1.5], [np.nan, np.inf]])), [[0.25, 1], [3, -0.5], [0, 0]]
    )
