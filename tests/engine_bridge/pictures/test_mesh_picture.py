import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.pictures.mesh_picture import KEY_AZIMUTH, KEY_ELEVATION, render
from engine_bridge.pictures.surroundings import KEY, SKY
from engine_bridge.pictures.view import View

from ..character.conftest import CORNERS, SIDES

FRONT = View(azimuth=0, elevation=0, center=(0, 0, 0), radius=1.5)
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
"""Vertices and faces."""


def sphere(center=(0.0, 0.0, 0.0), radius=1.0):
    """A sphere of 5,120 faces."""
    points, faces = igl.upsample(*igl.icosahedron(), 4)
    return np.array(center) + radius * points / np.linalg.norm(points, axis=1, keepdims=True), faces


def linear(image):
    encoded = image / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def coverage(vertices, faces, view, size):
    """Return the share of each pixel that a mesh covers: a black one darkens the background, as sRGB, by it."""
    black = render(vertices, faces, view, size, colors=np.zeros_like(vertices))
    away = View(view.azimuth, view.elevation, (1000.0, 0.0, 0.0), view.radius)
    return 1 - black[..., 1] / render(vertices, faces, away, size)[..., 1]


@pytest.mark.parametrize("angles", [(70, 35), (-130, 90), (10, -40)])
def test_a_sphere_covers_its_area_around_the_centre_from_all_sides(angles):
    center = (3.0, -1.0, 2.0)
    covered = coverage(*sphere(center), View(*angles, center, radius=1.25), (120, 100))
    scale = 100 / 2.5
    assert covered.sum() == pytest.approx(np.pi * scale**2, rel=0.01)
    y, x = np.indices(covered.shape) + 0.5
    assert (covered * x).sum() / covered.sum() == pytest.approx(60, abs=0.1)
    assert (covered * y).sum() / covered.sum() == pytest.approx(50, abs=0.1)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "left", "right"),
    [
        (0, 0, "001", "001"),
        (45, 0, "001", "100"),
        (135, 0, "100", "110"),
        (-45, 0, "011", "001"),
        (0, 90, "010", "010"),
    ],
)
def test_each_side_of_a_cube_shows_where_the_camera_sees_it(azimuth, elevation, left, right):
    """The sides at +x, +y and +z are red, green and blue, and the opposite ones have the other two colours."""
    corners, faces = igl.bounding_box(np.array([[-1.0, -1, -1], [1, 1, 1]]))
    sides = np.trunc(corners[faces].mean(axis=1))
    colors = (sides + (sides.min(axis=1, keepdims=True) < 0)).repeat(3, axis=0)
    view = View(azimuth, elevation, (0, 0, 0), 2.0)
    image = render(corners[faces].reshape(-1, 3), np.arange(36).reshape(-1, 3), view, (80, 80), colors)
    for side, column in ((left, 30), (right, 50)):
        assert [value > 40 for value in image[40, column]] == [digit == "1" for digit in side]


def test_a_common_edge_through_pixel_centres_leaves_no_gap():
    covered = coverage(*SQUARE, FRONT, (60, 60))
    assert_allclose(covered[10:50, 10:50], 1, atol=1e-9)
    assert covered.sum() == pytest.approx(1600, abs=1e-6)


def test_a_sphere_casts_the_key_lights_shadow_on_the_floor():
    view = View(0, 20, (0, 0, 0), 3.0, ground=-1.0)
    image, bare = (linear(render(*sphere(), v, (120, 120))) for v in (view, View(0, 20, (0, 0, 0), 3.0)))
    light = (image / bare)[..., 1]
    # The shadow is an ellipse of 1 by 1 / sin e. At 0.8 behind its centre, the floor is in it and not hidden.
    azimuth, elevation, tilt = np.radians([KEY_AZIMUTH, KEY_ELEVATION, 20])
    away = 1 / np.tan(elevation) + 0.8
    x, z = -away * np.sin(azimuth), -away * np.cos(azimuth)
    column, row = int(60 + 20 * x), int(60 - 20 * (-np.cos(tilt) - z * np.sin(tilt)))
    sky_alone = SKY[1] / (SKY[1] + KEY[1] * np.sin(elevation))
    assert 0.5 * sky_alone < light[row, column] < 1.01 * sky_alone
    assert light[row, 120 - column] > 0.9  # on the other side, towards the light
    assert light[115, 5] > 0.98  # far away


def test_colors_are_interpolated_between_vertices():
    colors = np.array([[0, 0.2, 0], [1, 0.2, 0], [1, 0.2, 0], [0, 0.2, 0]])
    image, grey = (linear(render(*SQUARE, FRONT, (60, 60), each))[30, 11:49] for each in (colors, np.full((4, 3), 0.2)))
    assert_allclose(image[:, 0] / grey[:, 0], (np.arange(11, 49) - 9.5) / 40 / 0.2, rtol=0.05)
    assert_array_equal(image[:, 1], grey[:, 1])


@pytest.mark.parametrize("angles", [(0, 0), (25, 12), (200, 60)])
def test_a_view_around_a_clip_frames_every_pose_with_a_margin(angles):
    vertices, faces = CORNERS.astype(float), SIDES.astype(int)
    clip = np.stack([vertices, vertices + np.array([2, 0, 0]), vertices - np.array([0, 1.5, 0])])
    view = View.around(clip, *angles)
    assert view.ground == -1.5
    covered = np.max(
        [coverage(pose, faces, View(*angles, view.center, view.radius), (100, 100)) for pose in clip], axis=0
    )
    rows, columns = np.nonzero(covered > 1e-6)
    extents = [(rows.min(), rows.max()), (columns.min(), columns.max())]
    assert max(last - first for first, last in extents) == pytest.approx(100 / 1.12, abs=2)
    for first, last in extents:
        assert first + last == pytest.approx(99, abs=2)


def test_texture_seams_do_not_show():
    """A sphere whose triangles share no vertices looks like one whose triangles do."""
    vertices, faces = sphere()
    view = View.around(vertices)
    whole = render(vertices, faces, view, (90, 90))
    assert_array_equal(render(vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3), view, (90, 90)), whole)


@pytest.mark.parametrize("kind", ["turned", "doubled", "doubled and turned"])
def test_flipped_and_doubled_triangles_do_not_darken_a_surface(kind):
    vertices, faces = sphere()
    view = View.around(vertices)
    whole = render(vertices, faces, view, (90, 90)).astype(int)
    odd = {
        "turned": np.where(np.arange(len(faces))[:, None] % 3 == 0, faces[:, ::-1], faces),
        "doubled": np.concatenate([faces, faces]),
        "doubled and turned": np.concatenate([faces, faces[:, ::-1]]),
    }[kind]
    assert np.abs(render(vertices, odd, view, (90, 90)).astype(int) - whole).max() <= 2
