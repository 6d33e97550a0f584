"""Samples of a surface, and linear interpolation from them."""

import igl
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from solver.model import fields
from solver.surface.coarsening import SAMPLES_PER_SQUARE_RADIUS, coarse_surface
from solver.surface.mesh import SolverMesh

from ..shapes import joined, tube


def sheet(side, height=0.0):
    """A flat square of side² vertices, two edges of unit length a cell."""
    v, f = igl.triangulated_grid(side, side)
    return np.column_stack([(side - 1) * v, np.full(len(v), height)]), f


def coarse(vertices, faces, count):
    L, mass = fields.laplacian(SolverMesh(vertices, faces, np.arange(len(vertices))))
    radius = np.sqrt(SAMPLES_PER_SQUARE_RADIUS * mass.sum() / count)
    return coarse_surface(vertices, faces, L, mass.sum(), count), radius


def test_values_are_means_of_up_to_three_samples_which_keep_theirs(fine):
    found, _ = coarse(fine.vertices, fine.faces, 600)
    P = found.interpolation
    assert np.diff(P.indptr).max() == 3
    assert P.data.min() > 0
    assert_allclose(P.sum(axis=1), 1.0, rtol=0, atol=1e-14)
    assert_allclose(P[found.samples].toarray(), np.eye(len(found.samples)), rtol=0, atol=1e-12)


def test_samples_are_a_radius_apart_vertices_near_them_and_linear_functions_on_a_plane_exact_inside():
    vertices, faces = sheet(60)
    found, radius = coarse(vertices, faces, 120)
    inside = (np.abs(vertices[:, :2] - 29.5) < 29.5 - 2 * radius).all(axis=1)
    assert inside.sum() > 500
    again = found.interpolation @ vertices[found.samples]
    assert_allclose(again[inside], vertices[inside], rtol=0, atol=1e-9)
    away = np.linalg.norm(vertices[found.samples][:, None] - vertices[found.samples], axis=2)
    assert away[~np.eye(len(away), dtype=bool)].min() >= radius
    assert np.linalg.norm(vertices[:, None] - vertices[found.samples], axis=2).min(axis=1).max() < radius


def test_sheets_that_touch_in_space_only_do_not_mix():
    vertices, faces = joined(sheet(30), sheet(30, height=0.01))
    found, _ = coarse(vertices, faces, 60)
    upper = vertices[:, 2] > 0
    assert_allclose(found.interpolation @ upper[found.samples], upper, rtol=0, atol=1e-15)


def test_a_mesh_coarser_than_the_sample_is_its_own_sample(figure):
    found, _ = coarse(figure.vertices, figure.faces, 10**6 * len(figure.vertices))
    assert_array_equal(found.samples, np.arange(len(figure.vertices)))
    assert_allclose(found.interpolation.toarray(), np.eye(len(figure.vertices)), rtol=0, atol=1e-12)


def test_a_thin_tube_is_a_chain_of_samples():
    """Each cell goes all the way round: no three cells meet, and values are interpolated along the tube."""
    vertices, faces = tube(np.arange(400) * 0.5, 1.0, 8)
    along = vertices[:, 0]
    found, _ = coarse(vertices, faces, 25)
    assert np.diff(found.interpolation.indptr).max() == 2
    again = found.interpolation @ along[found.samples]
    ends = along[found.samples].min(), along[found.samples].max()
    inside = (along > ends[0]) & (along < ends[1])
    assert np.abs(again - along)[inside].max() < 2.0
