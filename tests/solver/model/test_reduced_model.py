import numpy as np
import pytest
from numpy.testing import assert_allclose

from puppetline.errors import MeshError
from solver.model import energy_matrices
from solver.model.fields import energy_operator, laplacian
from solver.model.reduced_model import ModelParameters, build
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh, weld

from ..shapes import joined, sphere, tube


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


@pytest.mark.parametrize(("fields", "isolines", "rows"), [(8, 10, 37), (1, 2, 1), (3, 4, 10**6)])
def test_energy_matrices_are_those_of_the_dense_operators_with_the_ties_between_parts(
    two_parts, naive_interpolation, monkeypatch, fields, isolines, rows
):
    monkeypatch.setattr(energy_matrices, "MAX_CHUNK_ROWS", rows)
    model = build(two_parts, ModelParameters(fields, isolines))
    rest = model.to_model(two_parts.vertices)
    unit = SolverMesh(rest, two_parts.faces, two_parts.of_render)
    L, mass = laplacian(unit)
    L = energy_operator(L, contacts(unit), mass, 1.0).toarray()
    W, W_delta = naive_interpolation(rest, model.isoline_coordinates, model.weights, isolines, L @ rest)
    KW = np.diag(mass**-0.5) @ L @ W
    A, B = KW.T @ KW, KW.T @ np.diag(mass**-0.5) @ W_delta
    assert_allclose(model.A, A, atol=1e-6 * np.abs(A).max())
    assert_allclose(model.B, B, atol=1e-6 * np.abs(B).max())
    assert_allclose(model.gram, W.T @ W, atol=1e-6 * np.abs(W.T @ W).max())


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


def prism(rings, sides):
    vertices, faces = tube(np.arange(rings), 1 + 0.1 * np.arange(rings), sides, closed=True)
    return SolverMesh(vertices + np.sin(vertices[:, ::-1]), faces, np.arange(rings * sides))


def test_a_mesh_with_too_few_vertices_is_refused():
    with pytest.raises(MeshError):
        build(prism(5, 4), ModelParameters(fields=9))


@pytest.mark.parametrize(("size", "parameters"), [((5, 4), ModelParameters()), ((2, 3), ModelParameters(fields=1))])
def test_the_smallest_mesh_allowed_reproduces_its_rest_pose(size, parameters, surface):
    mesh = prism(*size)
    model = build(mesh, parameters)
    assert_allclose(surface(model, mesh, model.rest_controls), mesh.vertices, atol=1e-12)


def test_parts_a_world_apart_still_have_a_model_that_keeps_the_rest_pose():
    mesh = weld(*joined(*(sphere(center=step) for step in 1e4 * np.arange(5))))
    model = build(mesh)
    rest = model.position_matrix(mesh.vertices) @ model.rest_controls
    assert_allclose(rest, model.to_model(mesh.vertices), atol=1e-12)
