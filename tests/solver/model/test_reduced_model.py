import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose

from puppetline.errors import MeshError
from solver.model import fields
from solver.model.reduced_model import ModelParameters, build
from solver.surface.mesh import SolverMesh, weld


@pytest.fixture(scope="module")
def dense(creature, creature_model):
    return creature_model.position_matrix(creature.vertices).toarray()


# --- what it holds


def test_model_units_are_those_of_the_bounding_box(creature, creature_model):
    points = creature_model.to_model(creature.vertices)
    assert_allclose(points.min(axis=0), -points.max(axis=0), atol=1e-12)
    assert np.linalg.norm(np.ptp(points, axis=0)) == pytest.approx(1.0)


def test_positions_are_the_blend_written_out(creature, creature_model, dense, naive_interpolation):
    rest = creature_model.to_model(creature.vertices)
    naive, _ = naive_interpolation(
        rest, creature_model.isoline_coordinates, creature_model.weights, 10, np.zeros_like(rest)
    )
    assert_allclose(dense, naive, atol=1e-6)


def test_any_affine_map_on_all_isolines_is_that_map(creature, creature_model, dense):
    affine = np.random.default_rng(0).normal(size=(4, 3))
    expected = creature_model.to_model(creature.vertices) @ affine[:3] + affine[3]
    assert_allclose(dense @ np.tile(affine, (80, 1)), expected, atol=1e-12)


def test_energy_matrices_are_those_of_the_dense_operators(creature, creature_model, naive_interpolation):
    rest = creature_model.to_model(creature.vertices)
    L, mass = fields.laplacian(SolverMesh(rest, creature.faces, creature.of_render))
    L = L.toarray()
    W, W_delta = naive_interpolation(rest, creature_model.isoline_coordinates, creature_model.weights, 10, L @ rest)
    KW = np.diag(mass**-0.5) @ L @ W
    A, B = KW.T @ KW, KW.T @ np.diag(mass**-0.5) @ W_delta
    assert_allclose(creature_model.A, A, atol=1e-6 * np.abs(A).max())
    assert_allclose(creature_model.B, B, atol=1e-6 * np.abs(B).max())
    assert_allclose(creature_model.gram, W.T @ W, atol=1e-6 * np.abs(W.T @ W).max())


# --- null space


def test_null_space_is_at_least_28_wide_and_moves_no_vertex(creature_model, dense):
    projector = creature_model.null_space
    assert_allclose(projector, projector.T, atol=1e-12)
    assert_allclose(projector @ projector, projector, atol=1e-9)
    nullity = round(np.trace(projector))
    assert nullity >= 4 * (8 - 1)
    assert np.abs(dense @ projector).max() < 1e-6
    assert np.linalg.matrix_rank(dense, tol=1e-7 * np.linalg.norm(dense, 2)) == 320 - nullity


# --- rows of surface points


def test_rows_of_a_surface_point_blend_those_of_the_corners_around(creature, creature_model, dense):
    face = creature.faces[123]
    for blend in ([0.2, 0.5, 0.3], [1.0, 0.0, 0.0]):
        found = creature_model.rows(creature, np.array([blend]) @ creature.vertices[face])
        assert_allclose(found[0], blend @ dense[face], atol=1e-9)


# --- too small, and just large enough


def closed_strip(count):
    """A double cone with this many vertices round its equator."""
    angles = np.linspace(0, 2 * np.pi, count + 1)[:-1]
    ring = np.column_stack([np.cos(angles), 0.1 * np.sin(3 * angles), 0.7 * np.sin(angles)])
    vertices = np.concatenate([ring, [[0.1, 1, 0], [0, -1, 0.2]]])
    here, there = np.arange(count), (np.arange(count) + 1) % count
    top, bottom = np.full(count, count), np.full(count, count + 1)
    faces = np.concatenate([np.column_stack([here, there, bottom]), np.column_stack([there, here, top])])
    return SolverMesh(vertices, faces, np.arange(count + 2))


def test_a_mesh_with_too_few_vertices_is_refused():
    with pytest.raises(MeshError):
        build(closed_strip(17))


@pytest.mark.parametrize(("count", "parameters"), [(18, ModelParameters()), (4, ModelParameters(fields=1))])
def test_the_smallest_mesh_allowed_reproduces_its_rest_pose(count, parameters, surface):
    mesh = closed_strip(count)
    model = build(mesh, parameters)
    assert_allclose(surface(model, mesh, model.rest_controls), mesh.vertices, atol=1e-12)


def test_parts_a_world_apart_still_have_a_model_that_keeps_the_rest_pose():
    ball, faces = igl.icosahedron()
    ball, faces = igl.upsample(ball, faces, 2)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    apart = np.concatenate([ball + step for step in 1e4 * np.arange(5)])
    mesh = weld(apart, np.concatenate([faces + number * len(ball) for number in range(5)]))
    model = build(mesh)
    rest = model.position_matrix(mesh.vertices) @ model.rest_controls
    assert_allclose(rest, model.to_model(mesh.vertices), atol=1e-12)
