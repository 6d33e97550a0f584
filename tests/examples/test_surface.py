import igl
import numpy as np
from puppetline.examples import sdf
from puppetline.examples.surface import Focus, mesh


def test_a_focus_makes_triangles_smaller_around_its_centre_only():
    bar = sdf.round_cone((-2, 0, 0), (2, 0, 0), 0.4, 0.4)
    vertices, faces = mesh(bar.distance, bar.low, bar.high, 4000, [Focus((2.4, 0, 0), 0.5, 2.0)])
    x, lengths = vertices[faces].mean(axis=1)[:, 0], igl.edge_lengths(vertices, faces).mean(axis=1)
    assert lengths[x < 1].mean() > 1.7 * lengths[x > 2.37].mean()
    assert len(vertices) == 4000
    assert np.abs(bar.distance(vertices)).max() < 1e-3
