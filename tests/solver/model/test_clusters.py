"""Rotation clusters: their vertices, and the energy of their rotations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from solver.model import clusters, fields
from solver.model.clusters import CLUSTER_COUNT, EDGE_WEIGHT, rotation_clusters
from solver.surface.mesh import SolverMesh


def same_groups(a, b):
    """Return whether two labellings are equal up to renumbering."""
    pairs = np.unique(np.column_stack([a, b]), axis=0)
    return len(pairs) == len(np.unique(a)) == len(np.unique(b))


@pytest.fixture
def two(monkeypatch):
    monkeypatch.setattr(clusters, "CLUSTER_COUNT", 2)


# --- which vertices


def test_clusters_are_groups_of_vertices_on_other_isolines_of_a_field_that_has_some_weight(two):
    isoline_coordinates = np.array([[0.0, 0], [0, 9], [8, 0], [9, 9]]).repeat(3, axis=0)
    found = rotation_clusters(isoline_coordinates, np.array([0.99, 0.01]), np.ones(12))
    assert same_groups(found, np.repeat([0, 0, 1, 1], 3))


def test_vertices_count_by_their_area(two):
    """Subdividing every triangle on one side does not change the clusters."""
    isoline_coordinates, area = np.linspace(0, 9, 40)[:, None], np.ones(40)
    found = rotation_clusters(isoline_coordinates, np.ones(1), area)
    dense = np.concatenate([isoline_coordinates, isoline_coordinates[20:], isoline_coordinates[20:]])
    weighed = rotation_clusters(dense, np.ones(1), np.concatenate([np.ones(20), np.full(60, 1 / 3)]))
    assert_array_equal(weighed[:40], found)


def test_a_small_mesh_has_fewer_and_equal_vertices_share_one():
    found = rotation_clusters(np.tile(np.eye(3), (100, 1)), np.ones(3), np.ones(300))
    assert same_groups(found, np.tile([0, 1, 2], 100))
    assert len(np.unique(rotation_clusters(np.arange(41.0)[:, None], np.ones(1), np.ones(41)))) == 10


# --- the energy


@pytest.fixture(scope="module")
def operator(creature, creature_model):
    unit = SolverMesh(creature_model.to_model(creature.vertices), creature.faces, creature.of_render)
    L, mass = fields.laplacian(unit)
    return L.toarray(), mass, unit.vertices


def edges_of(L):
    i, j = np.nonzero(np.triu(L, 1))
    return np.concatenate([i, j]), np.concatenate([j, i])


def test_energy_is_the_bending_of_the_surface_and_the_stretch_of_its_edges(creature_model, operator, surface, creature):
    """Written out for all vertices and edges, at two surfaces with two sets of rotations."""
    model, (L, mass, rest) = creature_model, operator
    i, j = edges_of(L)
    gamma = EDGE_WEIGHT * np.trace(model.A) / (2 * sum(_dirichlet(model, L, rest)))
    rng, constant = np.random.default_rng(1), []
    for turns in Rotation.random(3 * CLUSTER_COUNT, random_state=0).as_matrix().reshape(3, -1, 3, 3):
        R = model.rest_controls + 0.1 * rng.normal(size=model.rest_controls.shape)
        moved, each = model.to_model(surface(model, creature, R)), turns[model.cluster]
        bending = np.sum((L @ moved - np.einsum("vi,vij->vj", L @ rest, each)) ** 2 / mass[:, None])
        edges = (moved[i] - moved[j]) - np.einsum("ei,eij->ej", rest[i] - rest[j], each[i])
        plain = bending + gamma * np.sum(L[i, j][:, None] * edges**2)
        reduced = np.sum(R * (model.A_clusters @ R)) - 2 * np.sum(R * (model.B_clusters @ turns.reshape(-1, 3)))
        constant.append(plain - reduced)
    assert_allclose(constant, constant[0], rtol=1e-9)


def _dirichlet(model, L, rest):
    """The trace of −WᵀLW, column by column."""
    for field, weight in enumerate(model.weights):
        for k in range(10):
            phi = weight * np.maximum(0, 1 - np.abs(model.isoline_coordinates[:, field].astype(np.float64) - k))
            for column in (*rest.T, np.ones(len(rest))):
                yield -(phi * column) @ L @ (phi * column)
