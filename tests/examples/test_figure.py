import numpy as np
from puppetline.examples.figure import Figure, Part, both
from puppetline.examples.sdf import sphere

RED, BLUE, GREEN = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
POINTS = np.random.default_rng(3).uniform(-2, 2, (500, 3))


def test_parts_add_and_carve_in_order():
    big, bite, bead = sphere((0, 0, 0), 1.0), sphere((1, 0, 0), 0.5), sphere((0.8, 0, 0), 0.2)
    figure = Figure([Part(big, RED), Part(bite, BLUE, how="carve"), Part(bead, GREEN)])
    expected = np.minimum(np.maximum(big.distance(POINTS), -bite.distance(POINTS)), bead.distance(POINTS))
    assert np.array_equal(figure.distance(POINTS), expected)


def test_each_surface_takes_the_colour_of_what_made_it():
    figure = Figure(
        [
            Part(sphere((0, 0, 0), 1.0), RED),
            both(sphere((1.0, 0, 0), 0.3), BLUE),
            Part(sphere((0, 1, 0), 0.3), GREEN, how="carve"),
            Part(sphere((0, 0, 1), 0.3), BLUE, how="paint"),
        ]
    )
    points = np.array([[0, -1, 0], [1.3, 0, 0], [-1.3, 0, 0], [0, 0.7, 0], [0, 0, 1]], float)
    assert np.allclose(figure.distance(points), 0)
    assert np.array_equal(figure.colors(points), [RED, BLUE, BLUE, GREEN, BLUE])


def test_a_pattern_recolours_what_came_before_it_only():
    def to_green(points, colors):
        return np.where(points[:, :1] > -2, GREEN, colors)

    figure = Figure([Part(sphere((0, 0, 0), 1.0), RED), to_green, Part(sphere((2, 0, 0), 1.0), BLUE)])
    assert np.array_equal(figure.colors(np.array([[-1.0, 0, 0], [3.0, 0, 0]])), [GREEN, BLUE])
