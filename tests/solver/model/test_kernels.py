import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.model import kernels
from solver.model.simd_vector import LENGTH

FIELDS, ISOLINES, COUNT = 8, 10, 500


@pytest.fixture(scope="module")
def scene():
    """Rest positions, tangents, slopes, isoline coordinates that reach both ends, field weights, controls."""
    rng = np.random.default_rng(0)
    rest = rng.normal(size=(COUNT, 3)).astype(np.float32)
    tangents = rng.normal(size=(COUNT, 2, 3)).astype(np.float32)
    slopes = rng.normal(size=(COUNT, FIELDS, 2)).astype(np.float32)
    isoline_coordinates = np.clip(rng.uniform(-1, ISOLINES, (COUNT, FIELDS)), 0, ISOLINES - 1).astype(np.float32)
    isoline_coordinates[0], isoline_coordinates[1] = 0, ISOLINES - 1
    isoline_coordinates[2] = np.arange(FIELDS)
    weights = rng.dirichlet(np.ones(FIELDS))
    controls = (np.eye(3, 4) + 0.4 * rng.normal(size=(FIELDS * ISOLINES, 3, 4))).astype(np.float32)
    return rest, tangents, slopes, isoline_coordinates, weights, controls


def blended(isoline_coordinates, weights, controls):
    """(n, 3, 4) float64: Σ_i w_i Σ_k max(0, 1 − |t_i − k|) T_ik."""
    hats = np.maximum(0, 1 - np.abs(isoline_coordinates[:, :, None].astype(np.float64) - np.arange(ISOLINES)))
    shares = (hats * weights[:, None]).reshape(len(isoline_coordinates), -1)
    return np.einsum("nm,mrc->nrc", shares, controls.astype(np.float64))


def applied(transforms, points):
    return np.einsum("nrc,nc->nr", transforms[:, :, :3], points) + transforms[:, :, 3]


def table(rows):
    return np.zeros((rows, LENGTH), dtype=np.float32)


def positions_and_normals(scene, controls=None):
    rest, tangents, slopes, isoline_coordinates, weights, own = scene
    out, normals = np.empty_like(rest), np.empty_like(rest)
    controls = own if controls is None else controls
    kernels.blend_normals(rest, tangents, slopes, isoline_coordinates, controls, weights, table(80), out, normals)
    return out, normals


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def everywhere(linear):
    transform = np.column_stack([linear, np.zeros(3)])
    return np.tile(transform, (FIELDS * ISOLINES, 1, 1)).astype(np.float32)


def test_a_normal_is_across_the_tangents_that_the_surface_carries(scene):
    """By difference quotients: a vertex that goes along a tangent takes its isoline coordinates with it."""
    rest, tangents, slopes, isoline_coordinates, weights, controls = scene
    size = 1e-4
    inside = ((isoline_coordinates % 1 > 0.01) & (isoline_coordinates % 1 < 0.99)).all(axis=1)
    carried = []
    for k in range(2):
        ends = [
            applied(
                blended(isoline_coordinates + sign * size * slopes[:, :, k].astype(np.float64), weights, controls),
                rest + sign * size * tangents[:, k].astype(np.float64),
            )
            for sign in (-1, 1)
        ]
        carried.append(ends[1] - ends[0])
    expected = unit(np.cross(*carried))
    assert np.count_nonzero(inside) > 50
    assert_allclose(positions_and_normals(scene)[1][inside], expected[inside], rtol=0, atol=2e-4)


def test_a_normal_of_a_surface_squashed_to_a_line_is_zero_and_not_nan(scene):
    assert_array_equal(positions_and_normals(scene, everywhere(np.diag([1.0, 0.0, 0.0])))[1], 0.0)
