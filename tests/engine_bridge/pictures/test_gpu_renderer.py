"""The renderer on OpenGL: what is where, which side is seen, shadows, textures, opacity."""

from dataclasses import replace

import igl
import numpy as np
import pytest

from engine_bridge.character.character import Part
from engine_bridge.character.materials import Appearance
from engine_bridge.pictures.camera import Camera
from engine_bridge.pictures.gpu_renderer import GpuRenderer
from engine_bridge.pictures.gpu_scene import Overlay, StageExtent, Surroundings

pytest.importorskip("moderngl", reason="the extra film is not installed")

SIZE = (160, 120)
STAGE = StageExtent(np.zeros(3), 2.0, 2.0, 1.0)
CAMERA = Camera(np.array([0.0, 0.8, 6.0]), np.array([0.0, 0.8, 0.0]), 30)
PLAIN = Appearance(
    np.array([1, 0, 0, 1], np.float32), None, None, np.zeros((4, 2), np.float32), "OPAQUE", 0.5, True, True
)
FRONT = np.array([[0, 1, 2], [0, 2, 3]])


def square(side, x=0.0, y=0.8, z=0.0):
    """A square that faces the camera, and its normals."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side / 2 + [x, y, z]
    return corners, np.tile([0.0, 0.0, 1.0], (4, 1))


@pytest.fixture
def picture(opengl):
    """Draw squares (material, corners, normals, triangles) and return the pixels (h, w, 3)."""

    def draw(*squares, floor=None, shadows=False, background=(0, 0, 255), camera=CAMERA, samples=4, overlays=()):
        with GpuRenderer(SIZE, samples) as renderer:
            behind = renderer.picture(np.full((2, 2, 4), (*background, 255), np.uint8))
            drawn = []
            for material, (corners, normals), triangles in squares:
                part = Part(0, 0, np.eye(4)[None], corners, triangles, normals)
                drawn.append(renderer.add([part], [material]))
                drawn[-1].move(corners.astype(np.float32), normals.astype(np.float32))
            over = [Overlay(renderer.picture(pixels), opacity) for pixels, opacity in overlays]
            tile = None if floor is None else renderer.tile(np.full((1, 1, 4), (*floor, 255), np.uint8))
            around = Surroundings(behind, tile, has_floor=floor is not None or shadows)
            return renderer.draw(camera, STAGE, drawn, around, over)[..., :3].copy()

    return draw


def test_points_are_where_the_camera_projects_them(picture):
    pixels = picture((PLAIN, square(0.5, x=0.4, y=1.2), FRONT))
    rows, columns = np.nonzero((pixels == [255, 0, 0]).all(axis=2))
    corners = np.column_stack([square(0.5, x=0.4, y=1.2)[0], np.ones(4)]) @ CAMERA.matrix(SIZE).astype(float)
    expected = (corners[:, :2] / corners[:, 3:] / 2 + 0.5) * SIZE
    shown = [[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]]
    np.testing.assert_allclose(shown, [expected.min(axis=0), expected.max(axis=0)], atol=1)
    assert (pixels[0, 0] == [0, 0, 255]).all()


def test_edges_are_smooth(picture):
    turned, normals = square(0.7)
    turned = (turned - [0, 0.8, 0]) @ [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]] + [0, 0.8, 0]
    smooth = picture((PLAIN, (turned, normals), FRONT))
    rough = picture((PLAIN, (turned, normals), FRONT), samples=1)

    def mixed(pixels):
        return ((pixels[..., 0] > 20) & (pixels[..., 2] > 20)).sum()

    assert mixed(smooth) > 40
    assert mixed(rough) == 0


def test_one_sided_triangles_are_seen_from_the_front_only(picture):
    one_sided = replace(PLAIN, two_sided=False)
    assert picture((one_sided, square(0.5), FRONT))[60, 80].tolist() == [255, 0, 0]
    assert picture((one_sided, square(0.5), FRONT[:, ::-1]))[60, 80].tolist() == [0, 0, 255]
    assert picture((PLAIN, square(0.5), FRONT[:, ::-1]))[60, 80].tolist() == [255, 0, 0]


def test_the_nearer_surface_hides_the_other(picture):
    green = replace(PLAIN, color=np.array([0, 1, 0, 1], np.float32))
    pixels = picture((PLAIN, square(0.5, z=0.5), FRONT), (green, square(1.0), FRONT))
    assert pixels[60, 80].tolist() == [255, 0, 0]
    assert pixels[45, 80].tolist() == [0, 255, 0]


def test_transparent_surfaces_mix_with_what_is_behind_them(picture):
    glass = replace(PLAIN, color=np.array([0, 1, 0, 0.5], np.float32), opacity="BLEND")
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
    lit = replace(PLAIN, unlit=False, color=np.ones(4, np.float32))
    corners = np.array([[-0.5, 0, -0.5], [0.5, 0, -0.5], [0.5, 0, 0.5], [-0.5, 0, 0.5]])
    vertices, triangles = igl.upsample(corners, FRONT[:, ::-1], splits) if splits else (corners, FRONT[:, ::-1])
    lit = replace(lit, uv=np.zeros((len(vertices), 2), np.float32))
    vertices = vertices + np.array([0.0, 0.6, 0.0])
    camera = Camera(np.array([0.0, 2.5, 5.0]), np.array([0.0, 0.4, 0.0]), 40)
    normals = np.tile([0.0, 1.0, 0.0], (len(vertices), 1))
    floor = (217, 217, 217)
    pixels = picture((lit, (vertices, normals), triangles), floor=floor, camera=camera).astype(int)
    alone = picture(floor=floor, camera=camera).astype(int)
    darker = (alone - pixels)[..., 0]
    assert (darker > 40).sum() > 300  # the core of the shadow
    assert ((darker > 5) & (darker < 35)).sum() > 60  # its soft edge
    assert pixels[..., 0].max() > alone[..., 0].max()  # the upper side is not in its own shadow


def test_a_shadow_begins_at_the_foot_that_casts_it(picture):
    """A low slab on the floor, as low as a paw: the floor beside it, away from the light, is dark."""
    lit = replace(PLAIN, unlit=False, color=np.ones(4, np.float32))
    corners = np.array(
        [[x, y, z] for y in (0.0, 0.02) for x, z in ((-0.5, -0.1), (0.5, -0.1), (0.5, 0.1), (-0.5, 0.1))]
    )
    faces = np.array([[4, 6, 5], [4, 7, 6], [0, 5, 1], [0, 4, 5], [3, 2, 6], [3, 6, 7], [1, 6, 2], [1, 5, 6]])
    lit = replace(lit, uv=np.zeros((8, 2), np.float32))
    camera = Camera(np.array([0.0, 1.2, -0.3]), np.array([0.0, 0.0, -0.1]), 20)  # from above
    normals = np.tile([0.0, 1.0, 0.0], (8, 1))
    floor = (217, 217, 217)
    darker = picture(floor=floor, camera=camera).astype(int) - picture(
        (lit, (corners, normals), faces), floor=floor, camera=camera
    )
    away = np.array([[0.0, 0.0, z, 1.0] for z in (-0.105, 0.3)]) @ camera.matrix(SIZE).astype(float)
    (column, row), (far_column, far_row) = np.floor((away[:, :2] / away[:, 3:] / 2 + 0.5) * SIZE).astype(int)
    assert darker[row, column, 0] > 30
    assert abs(darker[far_row, far_column, 0]) < 8


def test_a_floor_without_a_colour_shows_shadows_only(picture):
    camera = Camera(np.array([0.0, 2.5, 5.0]), np.array([0.0, 0.4, 0.0]), 40)
    behind = (200, 220, 240)
    corners, _ = square(0.8)
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    pixels = picture((PLAIN, (corners, normals), FRONT), shadows=True, camera=camera, background=behind)
    assert pixels[5, 5].tolist() == list(behind)
    floor = ~(pixels[..., 0] > 250)
    assert ((pixels.sum(axis=2) < sum(behind) - 60) & floor).sum() > 100


def test_pictures_lie_over_the_frame_with_their_opacity(picture):
    over = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    over[:20] = [255, 255, 255, 255]
    pixels = picture(overlays=[(over, 0.5)])
    assert pixels[10, 80] == pytest.approx([128, 128, 255], abs=2)
    assert pixels[30, 80].tolist() == [0, 0, 255]
