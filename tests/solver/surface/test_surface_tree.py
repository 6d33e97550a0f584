import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.surface.surface_tree import SurfaceTree

FAR = np.full(400, np.inf)


def scattered(seed, count=300, size=0.2):
    """Random triangles, some of them needles, each with one of five labels."""
    rng = np.random.default_rng(seed)
    triangles = rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    triangles[::10, 2] = triangles[::10, :2].mean(axis=1) + 1e-9
    return triangles, rng.integers(0, 5, count), rng.normal(scale=1.5, size=(400, 3)), rng.integers(0, 5, 400)


def reference(triangles, of_triangle, points, of_point):
    """Query libigl for each label separately."""
    distance = np.empty(len(points))
    for label in np.unique(of_point):
        others = triangles[of_triangle != label]
        asking = of_point == label
        faces = np.arange(3 * len(others)).reshape(-1, 3)
        distance[asking] = np.sqrt(igl.point_mesh_squared_distance(points[asking], others.reshape(-1, 3), faces)[0])
    return distance


@pytest.mark.parametrize("count", [10, 256, 257, 3000])
def test_distances_to_other_labels_are_those_of_libigl(count):
    triangles, of_triangle, points, of_point = scattered(count, count)
    found, blend, distance = SurfaceTree(triangles).nearest(points, of_point, of_triangle, FAR)
    assert_allclose(distance, reference(triangles, of_triangle, points, of_point), rtol=0, atol=1e-9)
    assert np.all(of_triangle[found] != of_point)
    nearest = np.einsum("nc,ncx->nx", blend, triangles[found])
    assert_allclose(np.linalg.norm(nearest - points, axis=1), distance, rtol=0, atol=1e-9)
    assert blend.min() >= -1e-9
    assert_allclose(blend.sum(axis=1), 1, atol=1e-12)


def volume(a, b, c, d):
    """Signed volumes of tetrahedra, times 6."""
    return np.einsum("...x,...x->...", np.cross(b - a, c - a), d - a)


@pytest.mark.parametrize("count", [1, 256, 257])
@pytest.mark.parametrize("away", [0.0, 0.3])
def test_segments_cross_the_triangles_whose_plane_and_edges_they_pass(count, away):
    rng = np.random.default_rng(count)
    triangles = rng.normal(size=(count, 1, 3)) + 0.4 * rng.normal(size=(count, 3, 3))
    starts, ends = rng.normal(size=(2, 200, 3))

    found = SurfaceTree(triangles).crossed(starts, ends, np.full(200, away))

    length = np.linalg.norm(ends - starts, axis=1, keepdims=True)
    first = (starts + np.minimum(1, away / length) * (ends - starts))[:, None]
    (a, b, c), last = np.moveaxis(triangles, 1, 0)[:, None], ends[:, None]
    beside = np.sign(volume(a, b, c, first)) != np.sign(volume(a, b, c, last))
    through = np.sign([volume(first, last, *edge) for edge in ((a, b), (b, c), (c, a))])
    crossed = beside & (np.abs(through.sum(axis=0)) == 3)
    assert_array_equal(found, crossed.any(axis=1))
