import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.character.surfaces.polygons import triangulate

ARROW = [(0, 0), (2, 2), (0, 1), (-2, 2)]
COMB = [(0, 0), *((7 - k // 2, 3 - 2 * ((k + 1) // 2 % 2) if k else 0) for k in range(16)), (0, 3)][:16]

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


def test_convex_polygons_become_fans_around_their_first_corner_and_fewer_than_three_corners_nothing():
    shapes = [[(0, 0), (1, 0), (1, 1), (0, 1)], [(5, 5)], [], ARROW[:3], [(2, 0), (3, 0), (4, 1), (3, 2), (2, 1)]]
    triangles, polygon = triangulate(
        lifted([corner for shape in shapes for corner in shape]), np.array(list(map(len, shapes)))
    )
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [5, 6, 7], [8, 9, 10], [8, 10, 11], [8, 11, 12]]
    assert polygon.tolist() == [0, 0, 3, 4, 4, 4]


@pytest.mark.parametrize("shift", range(2))
@pytest.mark.parametrize("turn", [None, [1.0, 2.0, 3.0], [np.pi, 0.0, 0.0]])
def test_concave_polygons_are_covered_once_and_nothing_else_is(turn, shift):
    """All shapes are in one mesh, and do not disturb each other."""
    shapes = [np.roll(shape, shift, axis=0) for shape in (ARROW, COMB, COMB[::-1], SPIRAL, COMB[:4])]
    sizes = np.array(list(map(len, shapes)))
    triangles, polygon = triangulate(np.concatenate([lifted(shape, turn) for shape in shapes]), sizes)
    for number, (shape, start) in enumerate(zip(shapes, np.cumsum(sizes) - sizes, strict=True)):
        own = triangles[polygon == number] - start
        assert len(own) == len(shape) - 2
        found = areas(lifted(shape), own)[:, 2]
        assert found.sum() == pytest.approx(shoelace(shape))
        assert (found * np.sign(shoelace(shape)) > -1e-12).all()


@pytest.mark.parametrize("size", [5, 50, 2000])
def test_a_polygon_that_crosses_itself_or_has_no_area_still_becomes_its_number_of_triangles(size):
    for points in (np.random.default_rng(size).normal(size=(size, 3)), np.ones((size, 3))):
        triangles, _ = triangulate(points, np.array([size]))
        assert triangles.shape == (size - 2, 3)
        assert set(triangles.ravel()) == set(range(size))
