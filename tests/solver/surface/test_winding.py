import numpy as np
import pytest
from numpy.testing import assert_array_equal

from solver.surface.winding import edges_of, pieces

# --- edges


@pytest.mark.parametrize("count", [3, 30, 5000])
def test_edges_are_those_that_sorting_finds(count):
    faces = np.random.default_rng(count).integers(0, count, (400, 3))
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    expected = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    for found, numpys in zip(edges_of(faces), expected, strict=True):
        assert_array_equal(found, numpys.reshape(found.shape))


def test_pieces_hang_together_at_edges_and_not_at_points():
    faces = np.array([[0, 1, 2], [5, 6, 7], [2, 3, 4], [1, 2, 8], [6, 5, 9], [2, 1, 9], [3, 10, 4]])
    edges, of_side, _ = edges_of(faces)
    assert pieces(of_side, len(edges)).tolist() == [0, 1, 2, 0, 1, 0, 2]


def test_no_faces_have_no_edges_and_no_pieces():
    edges, of_side, faces_of_edge = edges_of(np.zeros((0, 3), dtype=np.int64))
    assert (edges.shape, len(of_side), len(faces_of_edge)) == ((0, 2), 0, 0)
    assert len(pieces(of_side, 0)) == 0
