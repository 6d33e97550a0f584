"""Rotation clusters: their vertices, and the energy of their rotations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from solver.model import clusters, energy_matrices, fields
from solver.model.clusters import CLUSTER_COUNT, EDGE_WEIGHT, rotation_clusters
from solver.model.reduced_model import build
from solver.surface.contacts import contacts
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


def test_energy_is_the_bending_of_the_surface_with_its_ties_and_the_stretch_of_its_edges(
    two_parts, surface, monkeypatch
):
    """Written out for all vertices and edges, at three surfaces with three sets of rotations."""
    monkeypatch.setattr(energy_matrices, "MAX_CHUNK_ROWS", 5)  # several chunks of each cluster
    model = build(two_parts)
    rest = model.to_model(two_parts.vertices)
    unit = SolverMesh(rest, two_parts.faces, two_parts.of_render)
    L, mass = fields.laplacian(unit)
    tied, L = fields.energy_operator(L, contacts(unit), mass, 1.0), L.toarray()
    i, j = np.nonzero(L - np.diag(np.diag(L)))
    W = model.position_matrix(two_parts.vertices).toarray()
    gamma = EDGE_WEIGHT * np.trace(model.A) / (2 * np.trace(-W.T @ L @ W))
    rng, constant = np.random.default_rng(1), []
    for turns in Rotation.random(3 * CLUSTER_COUNT, random_state=0).as_matrix().reshape(3, -1, 3, 3):
        R = model.rest_controls + 0.1 * rng.normal(size=model.rest_controls.shape)
        moved, each = model.to_model(surface(model, two_parts, R)), turns[model.cluster]
        bending = np.sum((tied @ moved - np.einsum("vi,vij->vj", tied @ rest, each)) ** 2 / mass[:, None])
        edges = (moved[i] - moved[j]) - np.einsum("ei,eij->ej", rest[i] - rest[j], each[i])
        plain = bending + gamma * np.sum(L[i, j][:, None] * edges**2)
        reduced = np.sum(R * (model.A_clusters @ R)) - 2 * np.sum(R * (model.B_clusters @ turns.reshape(-1, 3)))
        constant.append(plain - reduced)
    assert_allclose(constant, constant[0], rtol=1e-9)
