import numpy as np

from engine_bridge.character.surfaces.corners import distinct_corners


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
