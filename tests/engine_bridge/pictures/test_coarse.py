"""Fewer triangles for the same surface."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree

from engine_bridge.pictures.coarse import coarse_triangles

DIRECTIONS = np.random.default_rng(3).normal(size=(3000, 3))
VERTICES = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
HULL = ConvexHull(VERTICES).simplices.astype(np.int64)


def facing(triangles):
    a, b, c = np.moveaxis(VERTICES[triangles], 1, 0)
    return np.cross(b - a, c - a)


INWARDS = np.einsum("tx,tx->t", facing(HULL), VERTICES[HULL].mean(axis=1)) < 0
SPHERE = np.where(INWARDS[:, None], HULL[:, ::-1], HULL)
"""Triangles of a unit sphere that face outwards."""


def volume(triangles):
    return np.einsum("tx,tx->", facing(triangles), VERTICES[triangles[:, 0]]) / 6


@pytest.mark.parametrize("cell", [0.08, 0.3])
def test_a_coarse_sphere_is_near_the_sphere_everywhere_and_nearly_as_large(cell):
    coarse = coarse_triangles(VERTICES, SPHERE, cell)

    assert len(coarse) < 0.8 * len(SPHERE)
    farthest, _ = cKDTree(VERTICES[np.unique(coarse)]).query(VERTICES)
    assert farthest.max() <= np.sqrt(3) * cell
    assert len({frozenset(each) for each in coarse.tolist()}) == len(coarse)
    assert 1 - cell / 2 < volume(coarse) / volume(SPHERE) < 1


def test_nothing_goes_that_is_larger_than_a_cell():
    assert np.array_equal(coarse_triangles(VERTICES, SPHERE, 1e-6), SPHERE)


def test_vertices_that_no_triangle_uses_are_not_chosen():
    apart = np.concatenate([np.zeros((1, 3)), VERTICES])

    assert np.array_equal(coarse_triangles(apart, SPHERE + 1, 0.2), coarse_triangles(VERTICES, SPHERE, 0.2) + 1)


def test_a_surface_without_triangles_stays_empty():
    assert coarse_triangles(VERTICES, np.zeros((0, 3), np.int64), 0.1).shape == (0, 3)
