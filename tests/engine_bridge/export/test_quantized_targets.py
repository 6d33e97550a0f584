import numpy as np
import pytest

from engine_bridge.character.character import make_character
from engine_bridge.export import quantized_targets
from engine_bridge.export.animation import Keyframes
from engine_bridge.export.quantized_targets import MAX_WEIGHT, Grid, PartTargets, fit, stored_weights

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
TARGETS = np.random.default_rng(5).normal(size=(3, 4, 3)).astype(np.float32)
WEIGHTS = np.random.default_rng(6).uniform(size=(40, 3)).astype(np.float32)
WEIGHTS[0] = 0
CLIP = Keyframes("clip", np.arange(40, dtype=np.float32) / 30, WEIGHTS, None)


@pytest.fixture
def character():
    return make_character("tetrahedron", CORNERS, SIDES)


def solved(_part, frames):
    return np.einsum("fk,kvc->vcf", WEIGHTS[frames], TARGETS)


def test_weights_are_rounded_to_sixteen_bits():
    weights = np.linspace(0, 1, 1001)
    stored = stored_weights(weights)
    assert (stored[0], stored[-1]) == (0, 1)
    assert np.abs(stored - weights).max() <= 0.5 / MAX_WEIGHT + 1e-7


@pytest.mark.parametrize("is_scaled", [True, False])
def test_floats_have_steps_that_are_powers_of_two(character, is_scaled):
    if not is_scaled:
        character.document.gltf["nodes"][0]["extras"] = {}
        character.document.gltf["nodes"][0]["extensions"] = {"OTHER": {}}
    grid = fit(character, CLIP, lambda _: (TARGETS, None), solved, 0.01).grids[0]
    assert grid.is_scale is is_scaled
    assert (np.log2(grid.step) == round(np.log2(grid.step))) is not is_scaled


def test_the_last_target_is_the_sum_of_the_rounded_others(character):
    opposite = np.array([-0.5, -1.0])
    whole = TARGETS.copy()
    whole[2] = -0.5 * whole[0] - whole[1]
    integers = PartTargets(character, 0, lambda _: (whole, None), opposite).integers(Grid(0.1, is_scale=True))
    np.testing.assert_array_equal(integers[:2], np.round(whole[:2] / np.float32(0.1)))
    np.testing.assert_array_equal(integers[2], np.round(-0.5 * integers[0] - integers[1]))


@pytest.mark.parametrize("tolerance", [0.1, 0.01, 0.001])
def test_the_error_is_that_of_what_a_player_computes_and_within_the_tolerance(character, tolerance):
    made = fit(character, CLIP, lambda _: (TARGETS, None), solved, tolerance, thinning=0)
    (part,), grid = made.parts, made.grids[0]
    weights = stored_weights(made.keyframes.weights).astype(np.float64)
    rest = part.rest(grid).astype(np.float64) * grid.step - CORNERS
    shown = rest + np.einsum("fk,kvc->fvc", weights, part.integers(grid).astype(np.float64) * grid.step)
    exact = np.einsum("fk,kvc->fvc", WEIGHTS.astype(np.float64), TARGETS.astype(np.float64))
    error = np.linalg.norm(shown - exact, axis=2).max()
    assert error == pytest.approx(made.error, abs=1e-6)
    assert 0.8 * tolerance < made.error <= tolerance


def test_targets_of_omitted_keyframes_are_omitted(character):
    """A target for each of five frames, of which the third is halfway between its neighbours."""
    shapes = np.zeros((5, 4, 3), np.float32)
    shapes[:, :, 0] = np.array([0, 1, 2, 3, -4])[:, None]
    clip = Keyframes("clip", np.arange(5, dtype=np.float32), np.eye(5, dtype=np.float32), None)
    made = fit(
        character,
        clip,
        lambda _: (shapes, None),
        lambda _, frames: shapes[frames].transpose(1, 2, 0),
        0.01,
        thinning=0.5,
    )
    np.testing.assert_array_equal(made.keyframes.times, [0, 3, 4])
    np.testing.assert_array_equal(made.keyframes.weights, np.eye(3))
    assert made.parts[0].positions.shape == (3, 4, 3)


def test_fewer_keyframes_are_omitted_if_vertices_that_were_not_watched_move_more(character, monkeypatch):
    """Between keyframes, the watched vertex is 0.4 times as far from a line as the others are."""
    monkeypatch.setattr(quantized_targets, "THINNING_VERTICES", 1)
    shapes = np.zeros((41, 4, 3), np.float32)
    shapes[:, :, 0] = np.outer(np.linspace(0, 1, 41) ** 2, [0.4, 1, 1, 1])
    clip = Keyframes("clip", np.arange(41, dtype=np.float32), np.eye(41, dtype=np.float32), None)

    def moved(_part, frames):
        return shapes[frames].transpose(1, 2, 0)

    made = fit(character, clip, lambda _: (shapes, None), moved, 0.01, thinning=0.5)
    assert made.error <= 0.01
    assert 5 < len(made.keyframes.times) < 20
