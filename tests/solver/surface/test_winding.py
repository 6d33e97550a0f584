import igl
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from solver.surface.winding import edges_of, flipped_faces, pieces, wound_against


def strip(count):
    """A closed band of squares, each triangle wound at random."""
    low, high = 2 * np.arange(count), 2 * np.arange(count) + 1
    after, above = np.roll(low, -1), np.roll(high, -1)
    faces = np.concatenate([np.column_stack([low, after, high]), np.column_stack([high, after, above])])
    return shuffled(faces)


def shuffled(faces, seed=3):
    rng = np.random.default_rng(seed)
    faces = faces[rng.permutation(len(faces))]
    turned = rng.random(len(faces)) < 0.5
    return np.where(turned[:, None], faces[:, ::-1], faces)


def ball(first=0):
    vertices, faces = igl.icosahedron()
    vertices, faces = igl.upsample(vertices, faces, 2)
    return shuffled(faces.astype(np.int64) + first, seed=first)


def wound_consistently(faces):
    against, patch = wound_against(faces, *edges_of(faces)[1:])
    return flipped_faces(faces, against), patch


@pytest.mark.parametrize("make", [ball, lambda: strip(20)], ids=["ball", "band"])
def test_winding_is_the_same_as_libigls(make):
    faces = make()
    wound, patch = wound_consistently(faces)
    theirs, their_patch = igl.bfs_orient(faces)
    assert_array_equal(patch, their_patch)
    agree = [
        np.array_equal(np.roll(a, -int(a.argmin())), np.roll(b, -int(b.argmin())))
        for a, b in zip(wound, theirs, strict=True)
    ]
    assert len(set(agree)) == 1


def test_three_triangles_at_an_edge_are_three_patches():
    wound, patch = wound_consistently(np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]]))
    assert_array_equal(patch, [0, 1, 2])
    assert_array_equal(wound, [[0, 1, 2], [0, 1, 3], [1, 0, 4]])


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
