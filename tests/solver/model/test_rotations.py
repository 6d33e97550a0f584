import numpy as np
import pytest

from solver.model import rotations
from solver.model.reduced_model import position_matrix
from solver.surface.mesh import SolverMesh


@pytest.fixture(scope="module")
def unit(creature, creature_model):
    """The creature in model units."""
    return SolverMesh(creature_model.to_model(creature.vertices), creature.faces, creature.of_render)


@pytest.fixture(scope="module")
def blend(unit, creature_model):
    isoline_coordinates = creature_model.isoline_coordinates.astype(np.float64)
    return position_matrix(unit.vertices, isoline_coordinates, creature_model.weights, creature_model.isolines)


@pytest.fixture(scope="module")
def strips(unit, creature_model):
    return rotations.crossed_triangles(creature_model.isoline_coordinates.astype(np.float64), unit.faces, 10)


@pytest.fixture(scope="module")
def any_controls(blend):
    return np.random.default_rng(0).normal(size=(blend.shape[1], 3))


# --- strips


def test_an_isoline_crosses_the_triangles_that_have_corners_on_both_sides(unit, strips, creature_model):
    isoline_coordinates = creature_model.isoline_coordinates.astype(np.float64)
    assert len(strips) == 80
    for number in (0, 9, 14, 37, 73):
        field, level = divmod(number, 10)
        low, *_, high = np.sort(isoline_coordinates[unit.faces, field], axis=1).T
        naive = np.flatnonzero((low <= level) & (level <= high) & (low < high)).tolist()
        assert strips[number].tolist() == naive != []


def test_an_isoline_in_the_gap_between_two_parts_gets_the_nearest_triangles():
    isoline_coordinates = np.array([[0.0], [0.1], [0.2], [0.3], [2.7], [2.8], [2.9], [3.0]])
    faces = np.array([[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7]])
    strips = rotations.crossed_triangles(isoline_coordinates, faces, 4)
    # Middles at 0.1, 0.2, 2.8, 2.9: every triangle is among the ten nearest of so few.
    assert [strip.tolist() for strip in strips] == [[0], [0, 1, 2, 3], [0, 1, 2, 3], [3]]
    strips = rotations.crossed_triangles(isoline_coordinates, np.repeat(faces, 8, axis=0), 4)
    assert set(range(8, 16)) < set(strips[1].tolist()) < set(range(16))
    assert set(range(16, 24)) < set(strips[2].tolist()) < set(range(16, 32))
    assert [len(strip) for strip in strips[1:3]] == [rotations.NEAREST_TRIANGLES] * 2


# --- linear maps


def test_covariance_map_is_the_plain_sum_over_strips_triangles_and_edges(
    unit, strips, blend, any_controls, creature_model
):
    isoline_coordinates = creature_model.isoline_coordinates.astype(np.float64)
    X = blend @ any_controls
    S = (rotations.covariance_map(unit, strips, isoline_coordinates, creature_model.weights) @ any_controls).reshape(
        -1, 3, 3
    )
    for number in range(0, 80, 7):
        naive = np.zeros((3, 3))
        for triangle in strips[number]:
            face = unit.faces[triangle]
            rest, now = unit.vertices[face], X[face]
            area = np.linalg.norm(np.cross(rest[1] - rest[0], rest[2] - rest[0])) / 2
            for i, j in ((0, 1), (1, 2), (2, 0)):
                naive += area * np.outer(rest[j] - rest[i], now[j] - now[i])
        np.testing.assert_allclose(S[number], naive, atol=1e-12 * np.abs(naive).max())
