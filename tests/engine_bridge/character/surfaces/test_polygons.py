import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.character.surfaces.polygons import distinct_corners, triangulate

ARROW = [(0, 0), (2, 2), (0, 1), (-2, 2)]
HEIGHTS = [0, 0, 3, 3, 1, 1, 3, 3, 1, 1, 3, 3, 1, 1, 3, 3]
COMB = list(zip([0, 7, 7, 6, 6, 5, 5, 4, 4, 3, 3, 2, 2, 1, 1, 0], HEIGHTS, strict=True))

ANGLES = np.linspace(0, 8 * np.pi, 60)
SPIRAL = [(r * np.cos(a), r * np.sin(a)) for a, r in zip(ANGLES, 2 + ANGLES / np.pi, strict=True)]
SPIRAL += [(r * np.cos(a), r * np.sin(a)) for a, r in zip(ANGLES[::-1], 1 + ANGLES[::-1] / np.pi, strict=True)]


def lifted(polygon, turn=None):
    flat = np.column_stack([np.array(polygon, dtype=float), np.zeros(len(polygon))])
    return flat if turn is None else Rotation.from_rotvec(turn).apply(flat) + np.array([3, -1, 2])


def areas(points, triangles):
    a, b, c = points[triangles].swapaxes(0, 1)
    return np.cross(b - a, c - a) / 2


def shoelace(polygon):
    x, y = np.array(polygon, dtype=float).T
    return (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2


def test_convex_polygons_become_fans_around_their_first_corner():
    corners = lifted([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0), (0, 1), (2, 0), (3, 0), (4, 1), (3, 2), (2, 1)])
    triangles, polygon = triangulate(corners, np.array([4, 3, 5]))
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [7, 8, 9], [7, 9, 10], [7, 10, 11]]
    assert polygon.tolist() == [0, 0, 1, 2, 2, 2]


def test_a_polygon_with_fewer_than_three_corners_gives_no_triangle():
    triangles, polygon = triangulate(np.zeros((6, 3)), np.array([0, 2, 1, 3, 0]))
    assert (triangles.tolist(), polygon.tolist()) == ([[3, 4, 5]], [3])


@pytest.mark.parametrize("shift", range(4))
@pytest.mark.parametrize("turn", [None, [1.0, 2.0, 3.0], [np.pi, 0.0, 0.0], [0.0, -1.5, 0.0]])
@pytest.mark.parametrize("shape", [ARROW, COMB, COMB[::-1], SPIRAL], ids=["arrow", "comb", "clockwise comb", "spiral"])
def test_concave_polygons_are_covered_once_and_nothing_else_is(shape, turn, shift):
    polygon = np.roll(shape, shift, axis=0)
    triangles, _ = triangulate(lifted(polygon, turn), np.array([len(polygon)]))
    assert len(triangles) == len(polygon) - 2
    found = areas(lifted(polygon), triangles)[:, 2]
    assert found.sum() == pytest.approx(shoelace(polygon))
    assert (found * np.sign(shoelace(polygon)) > -1e-12).all()


def test_concave_and_convex_polygons_of_one_mesh_do_not_disturb_each_other():
    points = np.concatenate([lifted(COMB), lifted(ARROW, [1, 0, 0]), lifted(COMB[:4])])
    triangles, polygon = triangulate(points, np.array([16, 4, 4]))
    for part, (start, size) in enumerate(((0, 16), (16, 4), (20, 4))):
        alone, _ = triangulate(points[start : start + size], np.array([size]))
        np.testing.assert_array_equal(triangles[polygon == part] - start, alone)


@pytest.mark.parametrize("size", [5, 50, 2000])
def test_a_polygon_that_crosses_itself_still_becomes_its_number_of_triangles(size):
    triangles, _ = triangulate(np.random.default_rng(size).normal(size=(size, 3)), np.array([size]))
    assert triangles.shape == (size - 2, 3)
    assert set(triangles.ravel()) == set(range(size))


def test_a_polygon_without_area_still_becomes_its_number_of_triangles():
    assert triangulate(np.ones((6, 3)), np.array([6]))[0].shape == (4, 3)


def test_distinct_corners_come_in_the_order_in_which_they_first_appear():
    corners = np.array([[5, -1, 2], [0, 0, 0], [5, -1, 2], [5, 0, 2], [0, 0, 0]])
    first, vertex_of = distinct_corners(corners)
    assert (first.tolist(), vertex_of.tolist()) == ([0, 1, 3], [0, 1, 0, 2, 1])


def test_corners_are_put_together_again_from_their_vertices():
    corners = np.random.default_rng(2).integers(-1, 6, (500, 3))
    first, vertex_of = distinct_corners(corners)
    np.testing.assert_array_equal(corners[first][vertex_of], corners)
    assert len(first) == len(np.unique(corners, axis=0))
    assert (np.diff(first) > 0).all()
