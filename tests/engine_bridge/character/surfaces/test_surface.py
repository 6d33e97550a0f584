import numpy as np
import pytest

from engine_bridge.character.surfaces.surface import DEFAULT_MATERIAL, count, linear, material_for, outside, upper_left


def test_srgb_becomes_linear_and_opacity_stays():
    np.testing.assert_allclose(
        linear(np.array([[0.0, 0.04045, 1.0, 0.25], [0.5, 0.5, 0.5, 1.0]])),
        [[0, 0.04045 / 12.92, 1, 0.25], [0.21404114, 0.21404114, 0.21404114, 1]],
        atol=1e-8,
    )


def test_colours_up_to_255_are_the_same_as_up_to_1():
    rgb = np.random.default_rng(1).integers(0, 256, (20, 3)).astype(float)
    np.testing.assert_allclose(linear(rgb), linear(rgb / 255))
    assert (linear(rgb)[:, 3] == 1).all()


def test_colours_that_are_no_numbers_are_white():
    np.testing.assert_array_equal(linear(np.array([[np.nan, 0.0, -1.0]])), [[1, 0, 0, 1]])


def test_texture_coordinates_are_turned_upside_down():
    np.testing.assert_array_equal(
        upper_left(np.array([[0.25, 0.0], [3.0, 1.5], [np.nan, np.inf]])), [[0.25, 1], [3, -0.5], [0, 0]]
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e19, -2e18])
def test_positions_that_are_no_mesh_s_are_marked(bad):
    positions = np.zeros((4, 3))
    positions[2, 1] = bad
    assert outside(positions).tolist() == [False, False, True, False]


def test_a_piece_without_material_shows_its_colours_as_they_are():
    solid, glassy = np.ones((2, 4)), np.array([[1, 1, 1, 1], [1, 1, 1, 0.5]])
    assert material_for(None) is DEFAULT_MATERIAL
    assert [material_for(colors).alpha_mode for colors in (solid, glassy)] == ["OPAQUE", "BLEND"]
    assert material_for(solid).base_color == (1, 1, 1, 1)


def test_counts_have_separators_and_the_right_plural():
    assert [count(1, "face"), count(2000, "face"), count(2, "vertex", "vertices")] == [
        "1 face",
        "2,000 faces",
        "2 vertices",
    ]
