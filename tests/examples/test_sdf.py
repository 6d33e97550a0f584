import numpy as np
import pytest
from puppetline.examples import sdf

POINTS = np.random.default_rng(7).uniform(-2, 2, (4000, 3))

EXACT = {
    "sphere": sdf.sphere((0.2, -0.1, 0.3), 0.7),
    "round cone": sdf.round_cone((-0.6, 0, 0.1), (0.7, 0.4, 0), 0.5, 0.15),
    "torus": sdf.torus((0.1, 0, 0), (1, 2, 3), 0.9, 0.2),
    "rounded box": sdf.rounded_box((0, 0.2, 0), (0.6, 0.3, 0.8), 0.1, sdf.turn(x=20, y=30, z=40)),
    "tube": sdf.tube([(-1, 0, 0, 0.2), (0, 0.6, 0, 0.4), (1, 0, 0.5, 0.1)]),
    "blade": sdf.blade((-0.8, 0, 0), (0.9, 0.3, 0), 0.4, 0.2, (0, 0.2, 1), 0.2, 0.05),
    "moved": sdf.move(sdf.rounded_box((0.3, 0, 0), (0.6, 0.3, 0.8), 0.1), sdf.turn(y=35), (0, 1, 0), (0.1, 0.2, 0.3)),
    "mirrored": sdf.mirror(sdf.sphere((0.6, 0, 0), 0.4)),
}
ROUGH = {
    "ellipsoid": sdf.ellipsoid((0.1, 0, 0), (0.9, 0.4, 0.2), sdf.turn(z=30)),
    "stretched": sdf.stretch(sdf.sphere((0.3, 0, 0), 0.5), (1.5, 1, 0.5), (0, 0, 0)),
    "blended": sdf.union([sdf.sphere((0, 0, 0), 0.7), sdf.sphere((0.9, 0, 0), 0.5)], 0.3),
    "cut": sdf.subtract(sdf.sphere((0, 0, 0), 0.9), sdf.sphere((0.7, 0, 0), 0.5), 0.1),
    "common": sdf.intersect(sdf.sphere((0, 0, 0), 0.9), sdf.half_space((0.2, 0, 0), (1, 0, 0)), 0.1),
    "displaced": sdf.displace(sdf.sphere((0, 0, 0), 0.9), lambda p: 0.05 * np.sin(9 * p[:, 0]), 0.05),
}


def gradient(shape, points, width=1e-6):
    steps = width * np.eye(3)
    return np.stack([(shape.distance(points + e) - shape.distance(points - e)) / (2 * width) for e in steps], axis=1)


@pytest.mark.parametrize("name", [*EXACT, *ROUGH])
def test_the_box_encloses_the_solid_and_an_exact_distance_leads_to_the_surface_in_one_step(name):
    shape = (EXACT | ROUGH)[name]
    distance = shape.distance(POINTS)
    inside, outside = POINTS[distance < 0], POINTS[distance > 0.01]
    assert len(inside) > 5
    assert np.all(inside >= shape.low - 1e-12)
    assert np.all(inside <= shape.high + 1e-12)
    if name in EXACT:
        landed = outside - shape.distance(outside)[:, None] * gradient(shape, outside)
        # The gradient jumps where two places of the surface are equally near: a few points lie there.
        assert np.quantile(np.abs(shape.distance(landed)), 0.995) < 1e-6


def test_round_cone_is_the_hull_of_its_balls():
    a, b = np.array([-0.6, 0, 0.1]), np.array([0.7, 0.4, 0])
    t = np.linspace(0, 1, 2001)
    balls = np.min(
        [np.linalg.norm(POINTS[:200] - (a + s * (b - a)), axis=1) - (0.5 + s * (0.15 - 0.5)) for s in t], axis=0
    )
    assert np.allclose(EXACT["round cone"].distance(POINTS[:200]), balls, atol=1e-5)


def test_ellipsoid_is_zero_on_its_surface_and_has_unit_slope_there():
    shape, rotation = ROUGH["ellipsoid"], sdf.turn(z=30)
    unit = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    surface = (unit * (0.9, 0.4, 0.2)) @ rotation.T + (0.1, 0, 0)
    assert np.allclose(shape.distance(surface), 0, atol=1e-12)
    assert np.allclose(np.linalg.norm(gradient(shape, surface), axis=1), 1, atol=1e-5)


def test_a_smooth_union_differs_from_the_sharp_one_only_where_both_are_near():
    one, two, blend = sdf.sphere((0, 0, 0), 0.7), sdf.sphere((0.9, 0, 0), 0.5), 0.3
    a, b = one.distance(POINTS), two.distance(POINTS)
    sharp, smooth = np.minimum(a, b), sdf.union([one, two], blend).distance(POINTS)
    far = np.abs(a - b) >= blend
    assert np.array_equal(smooth[far], sharp[far])
    assert np.all((smooth[~far] < sharp[~far]) & (smooth[~far] >= sharp[~far] - blend / 4))
