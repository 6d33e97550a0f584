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


def test_a_ring_keeps_its_hole():
    ring = sdf.torus((0, 0, 0), (0, 1, 0), 1.0, 0.2)
    vertices, faces = mesh(ring.distance, ring.low, ring.high, 3000)
    assert (len(vertices), len(faces)) == (3000, 2 * 3000)
    assert volume(vertices, faces) == pytest.approx(2 * np.pi**2 * 0.2**2, rel=2e-2)


def test_a_focus_makes_triangles_smaller_around_its_centre_only():
    bar = sdf.round_cone((-2, 0, 0), (2, 0, 0), 0.4, 0.4)
    vertices, faces = mesh(bar.distance, bar.low, bar.high, 4000, [Focus((2.4, 0, 0), 0.5, 2.0)])
    edges = vertices[faces] - vertices[np.roll(faces, -1, axis=1)]
    x, lengths = vertices[faces].mean(axis=1)[:, 0], np.linalg.norm(edges, axis=2).mean(axis=1)
    assert lengths[x < 1].mean() > 1.7 * lengths[x > 2.37].mean()
    assert len(vertices) == 4000
    assert np.abs(bar.distance(vertices)).max() < 1e-3


def test_focus_divides_lengths_by_its_zoom_at_the_centre_and_moves_nothing_further_than_swell():
    focus = Focus((1.0, 2.0, 3.0), 0.5, 2.0)
    near = np.array([[1.0, 2.0, 3.0], [1.001, 2.0, 3.0]])
    assert np.ptp(focus.apply(near)[:, 0]) == pytest.approx(0.0005, rel=1e-4)
    ray = np.array([1.0, 2.0, 3.0]) + np.linspace(0, 5, 2001)[:, None] * (0.6, 0.8, 0.0)
    assert np.linalg.norm(focus.apply(ray) - ray, axis=1).max() == pytest.approx(focus.swell(), rel=1e-4)
