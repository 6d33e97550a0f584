import numpy as np
import pytest
from puppetline.examples import sdf
from puppetline.examples.surface import Focus, mesh


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_a_ball_gets_its_vertices_its_radius_and_its_volume():
    ball = sdf.sphere((0.1, 0.2, 0.3), 0.5)
    vertices, faces = mesh(ball.distance, ball.low, ball.high, 2000)
    assert vertices.shape == (2000, 3)
    assert faces.shape == (2 * 2000 - 4, 3)
    assert np.allclose(np.linalg.norm(vertices - (0.1, 0.2, 0.3), axis=1), 0.5, atol=1e-5)
    assert volume(vertices, faces) == pytest.approx(np.pi / 6, rel=5e-3)


def test_a_focus_makes_triangles_smaller_around_its_centre_only():
    bar = sdf.round_cone((-2, 0, 0), (2, 0, 0), 0.4, 0.4)
    vertices, faces = mesh(bar.distance, bar.low, bar.high, 4000, [Focus((2.4, 0, 0), 0.5, 2.0)])
    edges = vertices[faces] - vertices[np.roll(faces, -1, axis=1)]
    x, lengths = vertices[faces].mean(axis=1)[:, 0], np.linalg.norm(edges, axis=2).mean(axis=1)
    assert lengths[x < 1].mean() > 1.7 * lengths[x > 2.37].mean()
    assert len(vertices) == 4000
    assert np.abs(bar.distance(vertices)).max() < 1e-3
