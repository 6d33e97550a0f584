import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from solver.surface.tangents import slopes, tangents

from ..shapes import sphere


def measured(rest, triangles, isoline_coordinates, normals, follows=None):
    along = tangents(normals)
    follows = np.arange(len(rest)) if follows is None else follows
    return slopes(rest, triangles, isoline_coordinates.astype(np.float32), follows, normals, along), along


def test_tangents_and_normal_are_a_right_handed_frame():
    normals = np.random.default_rng(0).normal(size=(1000, 3))
    normals[:3] = np.eye(3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    frames = np.concatenate([tangents(normals), normals[:, None].astype(np.float32)], axis=1)
    assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (1000, 1, 1)), atol=1e-6)
    assert_allclose(np.linalg.det(frames), 1, atol=1e-6)
    assert_array_equal(tangents(np.zeros((2, 3))), 0)


def test_vertices_split_for_a_texture_have_one_slope_and_those_at_a_hard_edge_their_own():
    vertices, faces = sphere(3)
    rest, split = vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    isoline_coordinates = np.sin(3 * rest)
    whole, _ = measured(vertices, faces, np.sin(3 * vertices), vertices)
    smooth, _ = measured(rest, split, isoline_coordinates, rest, faces.ravel())
    assert_allclose(smooth, whole[faces.ravel()], atol=1e-5)

    flat = np.cross(rest[1::3] - rest[::3], rest[2::3] - rest[::3])
    flat = np.repeat(flat / np.linalg.norm(flat, axis=1, keepdims=True), 3, axis=0)
    hard, along = measured(rest, split, isoline_coordinates, flat, faces.ravel())
    corners, t = rest.reshape(-1, 3, 3), isoline_coordinates.reshape(-1, 3, 3)
    for corner in range(3):
        for edge in (1, 2):
            step = corners[:, edge] - corners[:, 0]
            components = np.einsum("nkx,nx->nk", along[corner::3].astype(np.float64), step)
            rise = np.einsum("nik,nk->ni", hard[corner::3], components)
            assert_allclose(rise, t[:, edge] - t[:, 0], atol=1e-5)


def test_a_vertex_without_an_area_around_it_has_no_slope():
    rest = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 5, 5]])
    found, _ = measured(rest, np.array([[0, 1, 2]]), rest[:, :2], np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert_array_equal(found, 0)
