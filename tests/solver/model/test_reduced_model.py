import dataclasses

import igl
import numpy as np
import pytest

from puppetline.errors import MeshError
from solver.model import fields
from solver.model.reduced_model import ModelParameters, build
from solver.surface.mesh import SolverMesh, weld


def same(a, b):
    for field in dataclasses.fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if dataclasses.is_dataclass(x):
            assert same(x, y)
        else:
            assert x.dtype == y.dtype
            np.testing.assert_array_equal(x, y)
    return True


@pytest.fixture(scope="module")
def dense(creature, creature_model):
    return creature_model.position_matrix(creature.vertices).toarray()


# --- what it holds


def test_model_units_are_those_of_the_bounding_box(creature, creature_model):
    points = creature_model.to_model(creature.vertices)
    np.testing.assert_allclose(points.min(axis=0), -points.max(axis=0), atol=1e-12)
    assert np.linalg.norm(np.ptp(points, axis=0)) == pytest.approx(1.0)


def test_positions_are_the_blend_written_out(creature, creature_model, dense, naive_interpolation):
    rest = creature_model.to_model(creature.vertices)
    naive, _ = naive_interpolation(
        rest, creature_model.isoline_coordinates, creature_model.weights, 10, np.zeros_like(rest)
    )
    np.testing.assert_allclose(dense, naive, atol=1e-6)


def test_identity_transforms_give_the_rest_positions(creature, creature_model, dense):
    rest = creature_model.to_model(creature.vertices)
    np.testing.assert_allclose(dense @ creature_model.rest_controls, rest, atol=1e-12)


def test_any_affine_map_on_all_isolines_is_that_map(creature, creature_model, dense):
    affine = np.random.default_rng(0).normal(size=(4, 3))
    expected = creature_model.to_model(creature.vertices) @ affine[:3] + affine[3]
    np.testing.assert_allclose(dense @ np.tile(affine, (80, 1)), expected, atol=1e-12)


def test_energy_matrices_are_those_of_the_dense_operators(creature, creature_model, naive_interpolation):
    rest = creature_model.to_model(creature.vertices)
    L, mass = fields.laplacian(SolverMesh(rest, creature.faces, creature.of_render))
    L = L.toarray()
    W, W_delta = naive_interpolation(rest, creature_model.isoline_coordinates, creature_model.weights, 10, L @ rest)
    KW = np.diag(mass**-0.5) @ L @ W
    A, B = KW.T @ KW, KW.T @ np.diag(mass**-0.5) @ W_delta
    np.testing.assert_allclose(creature_model.A, A, atol=1e-6 * np.abs(A).max())
    np.testing.assert_allclose(creature_model.B, B, atol=1e-6 * np.abs(B).max())
    np.testing.assert_allclose(creature_model.gram, W.T @ W, atol=1e-6 * np.abs(W.T @ W).max())


def test_rigid_rotation_of_all_isolines_costs_no_energy(creature_model, turn):
    rotation = turn(0, 100)
    R = creature_model.rest_controls @ rotation + np.tile([[0.0] * 3] * 3 + [[0.3, -0.2, 0.5]], (80, 1))
    gradient = creature_model.A @ R - creature_model.B @ np.tile(rotation, (80, 1))
    assert np.abs(gradient).max() < 1e-9 * np.abs(creature_model.B).max()


# --- null space


def test_null_space_is_at_least_28_wide_and_moves_no_vertex(creature_model, dense):
    projector = creature_model.null_space
    np.testing.assert_allclose(projector, projector.T, atol=1e-12)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-9)
    nullity = round(np.trace(projector))
    assert nullity >= 4 * (8 - 1)
    assert np.abs(dense @ projector).max() < 1e-6
    assert np.linalg.matrix_rank(dense, tol=1e-7 * np.linalg.norm(dense, 2)) == 320 - nullity


def test_null_space_holds_the_exchange_of_an_affine_map_between_fields(creature_model, dense):
    rng = np.random.default_rng(1)
    for first, second in ((0, 1), (2, 7)):
        affine = rng.normal(size=4)
        z = np.zeros((8, 10, 4))
        z[first], z[second] = affine / creature_model.weights[first], -affine / creature_model.weights[second]
        z = z.reshape(-1) / np.linalg.norm(z)
        assert np.abs(dense @ z).max() < 1e-12
        np.testing.assert_allclose(creature_model.null_space @ z, z, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["armadillo.obj", "dinosaur_14k.obj"])
def test_rank_on_real_meshes_is_292(real_mesh, name):
    assert round(np.trace(build(real_mesh(name)).null_space)) == 28


# --- rows of surface points


def test_rows_of_a_vertex_are_its_rows_of_the_blend(creature, creature_model, dense):
    chosen = [0, 17, 400]
    found = creature_model.rows(creature, creature.vertices[chosen])
    np.testing.assert_allclose(found, dense[chosen], atol=1e-9)


def test_rows_of_a_point_in_a_face_blend_those_of_its_corners(creature, creature_model, dense):
    face = creature.faces[123]
    point = np.array([0.2, 0.5, 0.3]) @ creature.vertices[face]
    found = creature_model.rows(creature, point[None])
    np.testing.assert_allclose(found[0], np.array([0.2, 0.5, 0.3]) @ dense[face], atol=1e-9)


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
    with pytest.raises(MeshError) as caught:
        build(closed_strip(17))
    assert caught.value.found == "19 vertices"
    assert "at least 20 for 8" in caught.value.expected
    assert "fewer fields" in caught.value.fix


@pytest.mark.parametrize(("count", "parameters"), [(18, ModelParameters()), (4, ModelParameters(fields=1))])
def test_the_smallest_mesh_allowed_reproduces_its_rest_pose(count, parameters, surface):
    mesh = closed_strip(count)
    model = build(mesh, parameters)
    np.testing.assert_allclose(surface(model, mesh, model.rest_controls), mesh.vertices, atol=1e-12)


def test_building_twice_gives_the_same_bits():
    mesh, parameters = closed_strip(40), ModelParameters(fields=2, isolines=3)
    assert same(build(mesh, parameters), build(mesh, parameters))


def test_parts_a_world_apart_still_have_a_model_that_keeps_the_rest_pose():
    ball, faces = igl.icosahedron()
    ball, faces = igl.upsample(ball, faces, 2)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    apart = np.concatenate([ball + step for step in 1e4 * np.arange(5)])
    mesh = weld(apart, np.concatenate([faces + number * len(ball) for number in range(5)]))
    model = build(mesh)
    rest = model.position_matrix(mesh.vertices) @ model.rest_controls
    np.testing.assert_allclose(rest, model.to_model(mesh.vertices), atol=1e-12)
