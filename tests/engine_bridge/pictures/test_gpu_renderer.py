"""The renderer on OpenGL: what is where, which side is seen, shadows, textures, opacity."""

from dataclasses import replace

import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.character.character import Part
from engine_bridge.character.materials import Appearance
from engine_bridge.pictures.camera import Camera
from engine_bridge.pictures.gpu_renderer import GpuRenderer
from engine_bridge.pictures.gpu_scene import Overlay, StageExtent, Surroundings

from ..film.conftest import in_picture

pytest.importorskip("moderngl", reason="the extra film is not installed")

SIZE = (160, 120)
STAGE = StageExtent(np.zeros(3), 2.0, 2.0, 1.0)
CAMERA = Camera(np.array([0.0, 0.8, 6.0]), np.array([0.0, 0.8, 0.0]), 30)
ABOVE = Camera(np.array([0.0, 2.5, 5.0]), np.array([0.0, 0.4, 0.0]), 40)
PLAIN = Appearance(np.float32([1, 0, 0, 1]), None, None, None, "OPAQUE", 0.5, True, True)
RED, GREEN, BLUE = np.diag([255, 255, 255]).tolist()
LIT = replace(PLAIN, unlit=False, color=np.ones(4, np.float32))
FLOOR = (217, 217, 217)
FRONT = np.array([[0, 1, 2], [0, 2, 3]])


def lying(corners):
    """Corners, and normals that point up."""
    return corners, np.tile([0.0, 1.0, 0.0], (len(corners), 1))


def square(side, x=0.0, y=0.8, z=0.0):
    """A square that faces the camera, and its normals."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side / 2 + [x, y, z]
    return corners, np.tile([0.0, 0.0, 1.0], (4, 1))


def on_screen(camera, points):
    """Return the pixels (n, 2) right and down of points."""
    return in_picture(camera, points, SIZE) * SIZE


@pytest.fixture
def picture(opengl):
    """Draw squares (material, corners, normals, triangles) and return the pixels (h, w, 3)."""

    def draw(*squares, floor=None, shadows=False, background=(0, 0, 255), camera=CAMERA, samples=4, overlays=()):
        with GpuRenderer(SIZE, samples) as renderer:
            behind = renderer.picture(np.full((2, 2, 4), (*background, 255), np.uint8))
            drawn = []
            for material, (corners, normals), triangles in squares:
                own = replace(material, uv=np.zeros((len(corners), 2), np.float32)) if material.uv is None else material
                part = Part(0, 0, np.eye(4)[None], corners, triangles, normals)
                drawn.append(renderer.add([part], [own]))
                drawn[-1].move(np.float32(corners), np.float32(normals))
            over = [Overlay(renderer.picture(pixels), opacity) for pixels, opacity in overlays]
            tile = None if floor is None else renderer.tile(np.full((1, 1, 4), (*floor, 255), np.uint8))
            around = Surroundings(behind, tile, has_floor=floor is not None or shadows)
            return renderer.draw(camera, STAGE, drawn, around, over)[..., :3].astype(int)

    return draw


def test_points_are_where_the_camera_projects_them(picture):
    shown = square(0.5, x=0.4, y=1.2)
    pixels = picture((PLAIN, shown, FRONT))
    places = np.argwhere((pixels == RED).all(axis=2))[:, ::-1]
    expected = on_screen(CAMERA, shown[0])
    assert_allclose(places.min(axis=0), expected.min(axis=0), atol=1)
    assert_allclose(places.max(axis=0) + 1, expected.max(axis=0), atol=1)
    assert pixels[0, 0].tolist() == BLUE


def test_edges_are_smooth(picture):
    turned, normals = square(0.7, y=0)
    turned = turned @ [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]] + [0, 0.8, 0]
    smooth, rough = (picture((PLAIN, (turned, normals), FRONT), samples=samples) for samples in (4, 1))
    mixed = [(pixels[..., [0, 2]] > 20).all(axis=2).sum() for pixels in (smooth, rough)]
    assert mixed[0] > 40
    assert mixed[1] == 0


@pytest.mark.parametrize(
    ("two_sided", "triangles", "color"),
    [(False, FRONT, RED), (False, FRONT[:, ::-1], BLUE), (True, FRONT[:, ::-1], RED)],
)
def test_one_sided_triangles_are_seen_from_the_front_only(picture, two_sided, triangles, color):
    assert picture((replace(PLAIN, two_sided=two_sided), square(0.5), triangles))[60, 80].tolist() == color


def test_the_nearer_surface_hides_the_other(picture):
    green = replace(PLAIN, color=np.float32([0, 1, 0, 1]))
    pixels = picture((PLAIN, square(0.5, z=0.5), FRONT), (green, square(1.0), FRONT))
    assert pixels[[60, 45], 80].tolist() == [RED, GREEN]


def test_transparent_surfaces_mix_with_what_is_behind_them(picture):
    glass = replace(PLAIN, color=np.float32([0, 1, 0, 0.5]), opacity="BLEND")
    pixels = picture((glass, square(0.5, z=0.5), FRONT), (PLAIN, square(1.0), FRONT))
    assert pixels[60, 80] == pytest.approx([128, 128, 0], abs=2)


def test_textures_repeat_and_masks_have_holes(picture):
    image = np.zeros((2, 2, 4), np.uint8)
    image[0, 0] = image[1, 1] = [255, 255, 255, 255]
    uv = np.array([[0, 4], [4, 4], [4, 0], [0, 0]], np.float32)
    white = replace(PLAIN, color=np.ones(4, np.float32), image=image, uv=uv, opacity="MASK")
    pixels = picture((white, square(1.6), FRONT))
    inside = pixels[30:90, 50:110].reshape(-1, 3)
    assert (inside == [0, 0, 255]).all(axis=1).mean() == pytest.approx(0.5, abs=0.15)
    # the image's first row is at v = 0, the top of the square
    once = replace(white, uv=uv / 4, opacity="OPAQUE")
    corners = picture((once, square(1.6), FRONT))
    assert corners[45, 65].min() > 240
    assert corners[45, 95].max() < 60


@pytest.mark.parametrize("splits", [0, 7], ids=["at pixels", "at vertices"])
def test_a_square_over_the_floor_casts_a_soft_shadow(picture, splits):
    """The same square as two triangles, and as many small ones, which are lit at their vertices."""
    corners, triangles = square(1.0, y=0)[0][:, [0, 2, 1]] + [0, 0.6, 0], FRONT[:, ::-1]
    if splits:
        corners, triangles = igl.upsample(corners, triangles, splits)
    pixels, alone = (
        picture(*shown, floor=FLOOR, camera=ABOVE)[..., 0] for shown in ([(LIT, lying(corners), triangles)], [])
    )
    darker = alone - pixels
    assert (darker > 40).sum() > 300  # the core of the shadow
    assert ((darker > 5) & (darker < 35)).sum() > 60  # its soft edge
    assert pixels.max() > alone.max()  # the upper side is not in its own shadow


def test_a_shadow_begins_at_the_foot_that_casts_it(picture):
    """A low slab on the floor, as low as a paw: the floor beside it, away from the light, is dark."""
    corners = np.array([[x, y, z] for y in (0.0, 0.02) for z in (-0.1, 0.1) for x in (-0.5, 0.5)])
    faces = np.array([[4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5], [2, 3, 7], [2, 7, 6], [1, 7, 3], [1, 5, 7]])
    camera = Camera(np.array([0.0, 1.2, -0.3]), np.array([0.0, 0.0, -0.1]), 20)  # from above
    alone, pixels = (picture(*shown, floor=FLOOR, camera=camera) for shown in ([], [(LIT, lying(corners), faces)]))
    columns, rows = np.floor(on_screen(camera, [[0, 0, -0.105], [0, 0, 0.3]])).astype(int).T
    beside, far = (alone - pixels)[rows, columns, 0]
    assert beside > 30
    assert abs(far) < 8


def test_a_floor_without_a_colour_shows_shadows_only(picture):
    behind = (200, 220, 240)
    pixels = picture((PLAIN, square(0.8), FRONT), shadows=True, camera=ABOVE, background=behind)
    assert pixels[5, 5].tolist() == list(behind)
    darker = pixels.sum(axis=2) < sum(behind) - 60
    assert (darker & (pixels[..., 0] <= 250)).sum() > 100


def test_pictures_lie_over_the_frame_with_their_opacity(picture):
    over = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    over[:20] = [255, 255, 255, 255]
    pixels = picture(overlays=[(over, 0.5)])
    assert pixels[10, 80] == pytest.approx([128, 128, 255], abs=2)
    assert pixels[30, 80].tolist() == [0, 0, 255]
