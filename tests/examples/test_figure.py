import numpy as np
from puppetline.examples.figure import Figure, Part, both
from puppetline.examples.sdf import mirror, sphere

RED, BLUE, GREEN = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
POINTS = np.random.default_rng(3).uniform(-2, 2, (500, 3))


def test_parts_add_carve_paint_and_recolour_in_order_and_each_surface_has_the_colour_of_what_made_it():
    body, ears, bite = sphere((0, 0, 0), 1.0), sphere((1.0, 0, 0), 0.3), sphere((0, 1, 0), 0.3)
    base = sphere((0, -2.5, 0), 1.0)

    def green_below(points, colors):
        return np.where(points[:, 1:2] < -0.5, GREEN, colors)

    carved, painted = Part(bite, GREEN, how="carve"), Part(sphere((0, 0, 1), 0.3), BLUE, how="paint")
    figure = Figure([Part(body, RED), both(ears, BLUE), carved, painted, green_below, Part(base, BLUE)])
    added = np.minimum(body.distance(POINTS), mirror(ears).distance(POINTS))
    expected = np.minimum(np.maximum(added, -bite.distance(POINTS)), base.distance(POINTS))
    assert np.array_equal(figure.distance(POINTS), expected)
    points = np.float64([[0, 0, -1], [0, -1, 0], [1.3, 0, 0], [-1.3, 0, 0], [0, 0.7, 0], [0, 0, 1], [0, -3.5, 0]])
    assert np.allclose(figure.distance(points), 0)
    assert np.array_equal(figure.colors(points), [RED, GREEN, BLUE, BLUE, GREEN, BLUE, BLUE])
