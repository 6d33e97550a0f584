import numpy as np

from engine_bridge.character.surfaces.corners import distinct_corners, unique_rows


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


def test_equal_rows_are_found_in_the_order_of_their_entries():
    rows = np.random.default_rng(3).integers(-1, 5, (400, 2))
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    found = unique_rows(rows)
    np.testing.assert_array_equal(found[0], first)
    np.testing.assert_array_equal(found[1], kind.ravel())
    assert [len(part) for part in unique_rows(rows[:0])] == [0, 0]
