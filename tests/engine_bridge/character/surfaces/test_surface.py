import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.surfaces.surface import DEFAULT_MATERIAL, linear, material_for, outside, upper_left


def test_srgb_becomes_linear_opacity_stays_and_no_numbers_are_white():
    given = np.array([[0.0, 0.04045, 1.0, 0.25], [0.5, 0.5, 0.5, 1.0], [np.nan, 0.0, -1.0, 1.0]])
    half = 0.21404114
    expected = [[0, 0.04045 / 12.92, 1, 0.25], [half, half, half, 1], [1, 0, 0, 1]]
    assert_allclose(linear(given), expected, atol=1e-8)


def test_colours_up_to_255_are_the_same_as_up_to_1():
    rgb = np.random.default_rng(1).integers(0, 256, (20, 3)).astype(float)
    assert_allclose(linear(rgb), linear(rgb / 255))
    assert (linear(rgb)[:, 3] == 1).all()


def test_texture_coordinates_are_turned_upside_down():
    assert_array_equal(
        upper_left(np.array([[0.25, 0.0], [3.0, 1.5], [np.nan, np.inf]])), [[0.25, 1], [3, -0.5], [0, 0]]
    )


def test_positions_that_are_no_mesh_s_are_marked():
    bad = [np.nan, np.inf, -np.inf, 1e19, -2e18]
    assert outside(np.pad(np.array(bad)[:, None], [(1, 1), (1, 1)])).tolist() == [False, *[True] * 5, False]


def test_a_piece_without_material_shows_its_colours_as_they_are():
    solid, glassy = np.ones((2, 4)), np.array([[1, 1, 1, 1], [1, 1, 1, 0.5]])
    assert material_for(None) is DEFAULT_MATERIAL
    assert [material_for(colors).alpha_mode for colors in (solid, glassy)] == ["OPAQUE", "BLEND"]
    assert material_for(solid).base_color == (1, 1, 1, 1)
