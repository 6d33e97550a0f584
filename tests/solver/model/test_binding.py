from concurrent.futures import ThreadPoolExecutor

import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.model.binding import Binding, ShadedBinding
from solver.motion.deformer import Deformer, to_file_units


@pytest.fixture(scope="module")
def pose(creature, creature_model, creature_handles):
    deformer = Deformer(creature_model, creature, creature_handles, iterations=10)
    return deformer.solve(deformer.handles + np.random.default_rng(0).normal(scale=0.2, size=creature_handles.shape))


@pytest.fixture(scope="module")
def controls(creature_model, pose):
    return to_file_units(pose, creature_model)


@pytest.fixture(scope="module")
def normals(creature):
    """Any normals of the creature."""
    normals = np.random.default_rng(1).normal(size=creature.vertices.shape)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def shaded(creature, creature_model, normals):
    return ShadedBinding(creature_model, creature.vertices, np.arange(len(normals)), normals, creature.faces)


def test_rest_controls_leave_vertices_and_normals_and_are_written_where_they_are_wanted(
    creature, creature_model, shaded, normals
):
    controls = to_file_units(creature_model.rest_controls, creature_model)
    own = tuple(np.zeros((2, *normals.shape), dtype=np.float32))
    for wanted in ((), own):
        positions, found = shaded.vertices_and_normals(controls, *wanted)
        for each in (positions, shaded.vertices(controls)):
            assert_allclose(each, creature.vertices, rtol=0, atol=1e-6 * creature.diagonal)
        assert_allclose(found, normals, atol=1e-5)
    assert (positions is own[0], found is own[1]) == (True, True)
    assert shaded.vertices(controls, own[0]) is own[0]


def test_vertices_are_the_blend_of_those_that_they_follow(creature, creature_model, pose, controls, surface):
    follows = np.random.default_rng(1).integers(0, len(creature.vertices), 400)
    binding = Binding(creature_model, creature.vertices[follows], follows)
    found = binding.vertices(controls)
    assert found.dtype == np.float32
    expected = surface(creature_model, creature, pose)[follows]
    assert_allclose(found, expected, rtol=0, atol=1e-5 * creature.diagonal)
    for wrong in ((controls[:40],), (controls, found[:7])):
        with pytest.raises(ValueError, match="expected"):
            binding.vertices(*wrong)


def test_normals_are_those_of_the_deformed_surface(figure, figure_model):
    """Close to the area-weighted normals of the deformed triangles, for normals that were so at rest."""

    handles = np.array([[1.55, 1.3, 0.0], [-1.55, 1.3, 0.0], [0.0, 0.0, 0.35]])
    deformer = Deformer(figure_model, figure, handles, iterations=20)
    controls = deformer.step(deformer.handles + np.array([[-0.3, 0.5, 0.2], [0, 0, 0], [0, 0, 0]]))
    count = len(figure.vertices)
    rest = figure.vertices
    binding = ShadedBinding(
        figure_model, rest, np.arange(count), igl.per_vertex_normals(rest, figure.faces), figure.faces
    )
    positions, found = binding.vertices_and_normals(controls)
    assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-5)
    expected = igl.per_vertex_normals(positions.astype(np.float64), figure.faces)
    angles = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", found, expected), -1, 1)))
    assert np.median(angles) < 0.1
    assert np.percentile(angles, 99) < 2


def test_a_part_moves_as_it_does_in_the_whole(shaded, controls):
    chosen = np.array([5, 3, 300, 41])
    part = shaded.only(chosen)
    assert_array_equal(part.vertices(controls), shaded.vertices(controls)[chosen])
    for found, whole in zip(part.vertices_and_normals(controls), shaded.vertices_and_normals(controls), strict=True):
        assert_array_equal(found, whole[chosen])


def test_one_binding_serves_several_threads(creature, creature_model, pose):
    binding = Binding.of_solver_mesh(creature_model, creature)
    poses = [to_file_units(R, creature_model) for R in (creature_model.rest_controls, pose)]
    expected = [binding.vertices(controls) for controls in poses]

    def play(index):
        return all(np.array_equal(binding.vertices(poses[index]), expected[index]) for _ in range(300))

    with ThreadPoolExecutor(2) as pool:
        assert all(pool.map(play, range(2)))


def test_a_normal_of_a_surface_squashed_to_a_line_is_zero_and_not_nan(shaded, controls):
    assert_array_equal(shaded.vertices_and_normals(controls * (np.arange(3) == 0)[:, None])[1], 0.0)
