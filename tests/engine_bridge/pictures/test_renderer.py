"""The renderer of films: what is where, which side is seen, shadows, textures, opacity, floor and panorama."""

from dataclasses import replace

import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import Part
from engine_bridge.character.materials import Appearance
from engine_bridge.pictures.camera import NEAR_SHARE, Camera
from engine_bridge.pictures.geometry import geometry_of
from engine_bridge.pictures.renderer import PLACES, Renderer
from engine_bridge.pictures.surroundings import Lighting, Overlay, Panorama, StageExtent, Surroundings
from engine_bridge.pictures.textures import textures_of

from ..conftest import in_picture

SIZE = (160, 120)
STAGE = StageExtent(np.zeros(3), 2.0, 2.0, 1.0)
CAMERA = Camera(np.array([0.0, 0.8, 6.0]), np.array([0.0, 0.8, 0.0]), 30)
ABOVE = Camera(np.array([0.0, 2.5, 5.0]), np.array([0.0, 0.4, 0.0]), 40)
PLAIN = Appearance(
    np.array([1, 0, 0, 1], np.float32), None, None, np.zeros((4, 2), np.float32), "OPAQUE", 0.5, True, True
)
FRONT = np.array([[0, 1, 2], [0, 2, 3]])
SHADES = np.linspace(0, 1, 256, dtype=np.float32)


def square(side, x=0.0, y=0.8, z=0.0):
    """A square that faces the camera, and its normals."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side / 2 + [x, y, z]
    return corners, np.tile([0.0, 0.0, 1.0], (4, 1))


def part_of(corners, triangles, normals):
    return Part(0, 0, np.eye(4)[None], corners, triangles, normals)


def picture(
    *squares,
    floor=None,
    shadows=False,
    background=(0, 0, 255),
    camera=CAMERA,
    samples=4,
    overlays=(),
    light=Lighting(),  # noqa: B008 - it cannot change
):
    """Draw squares (material, corners, normals, triangles) and return the pixels (h, w, 3)."""
    drawn = geometry_of([([part_of(places, faces, normals)], [m]) for m, (places, normals), faces in squares])
    moved = [(places.astype(np.float32), normals.astype(np.float32)) for _, (places, normals), _ in squares]
    tile = None if floor is None else textures_of([np.array([[[*floor, 255]]], np.uint8)], SHADES)
    behind = np.full((1, 1, 4), (*background, 255), np.uint8)
    around = Surroundings(behind, tile, has_floor=floor is not None or shadows, lighting=light)
    over = [Overlay(pixels, opacity) for pixels, opacity in overlays]
    return Renderer(SIZE, samples).draw(camera, STAGE, drawn, moved, around, over)[..., :3]


def test_transparent_surfaces_mix_with_what_is_behind_them():
    glass = replace(PLAIN, color=np.array([0, 1, 0, 0.5], np.float32), opacity="BLEND")
    pixels = picture((glass, square(0.5, z=0.5), FRONT), (PLAIN, square(1.0), FRONT))
    assert pixels[60, 80] == pytest.approx([128, 128, 0], abs=2)


def test_textures_repeat_and_masks_have_holes():
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
def test_a_square_over_the_floor_casts_a_soft_shadow(splits):
    """The same square as two triangles, and as many small ones, which are lit at their vertices."""
    corners = np.array([[-0.5, 0, -0.5], [0.5, 0, -0.5], [0.5, 0, 0.5], [-0.5, 0, 0.5]])
    vertices, triangles = igl.upsample(corners, FRONT[:, ::-1], splits) if splits else (corners, FRONT[:, ::-1])
    lit = replace(PLAIN, unlit=False, color=np.ones(4, np.float32), uv=np.zeros((len(vertices), 2), np.float32))
    vertices = vertices + np.array([0.0, 0.6, 0.0])
    normals = np.tile([0.0, 1.0, 0.0], (len(vertices), 1))
    floor = (217, 217, 217)
    pixels = picture((lit, (vertices, normals), triangles), floor=floor, camera=ABOVE).astype(int)
    alone = picture(floor=floor, camera=ABOVE).astype(int)
    darker = (alone - pixels)[..., 0]
    assert (darker > 40).sum() > 300  # the core of the shadow
    assert ((darker > 5) & (darker < 35)).sum() > 60  # its soft edge
    assert pixels[..., 0].max() > alone[..., 0].max()  # the upper side is not in its own shadow


def test_each_colour_of_a_light_casts_its_own_shadow():
    """High over the floor, a square's shadow of the key light lies beside that of the sky."""
    corners = 0.3 * np.array([[-1, 4, -1], [1, 4, -1], [1, 4, 1], [-1, 4, 1]])
    drawn = PLAIN, (corners, np.tile([0.0, 1.0, 0.0], (4, 1))), FRONT[:, ::-1]
    white, without_red = (
        picture(drawn, floor=(200, 200, 200), camera=ABOVE, light=Lighting(key=key)).astype(int)
        for key in ((1.0, 1.0, 1.0), (0.0, 1.0, 1.0))
    )
    assert np.array_equal(white[..., 1:], without_red[..., 1:])
    assert (white[..., 1].max() - white[..., 1] > 40).sum() > 50  # the shadow


@pytest.mark.parametrize("forwards", [-0.8, 0.0, 0.8])
def test_a_light_from_the_other_side_gives_the_mirrored_picture(forwards):
    """The shadow of a square that is high over the floor lies on either side of it, whole."""
    corners = 0.3 * np.array([[-1, 3, -1], [1, 3, -1], [1, 3, 1], [-1, 3, 1]])
    drawn = PLAIN, (corners, np.tile([0.0, 1.0, 0.0], (4, 1))), FRONT[:, ::-1]
    from_left, from_right = (
        picture(drawn, floor=(200, 200, 200), camera=ABOVE, light=Lighting(direction=(x, 1.0, forwards))).astype(int)
        for x in (-0.8, 0.8)
    )
    assert (from_left[:, 80:].min(axis=2) < 150).sum() > (from_left[:, :80].min(axis=2) < 150).sum()
    differs = np.abs(from_left - from_right[:, ::-1]).max(axis=2) > 8
    assert differs.mean() < 0.005  # pixels at edges


def test_a_shadow_begins_at_the_foot_that_casts_it():
    """A low slab on the floor, as low as a paw: the floor beside it, away from the light, is dark."""
    corners = np.array(
        [[x, y, z] for y in (0.0, 0.02) for x, z in ((-0.5, -0.1), (0.5, -0.1), (0.5, 0.1), (-0.5, 0.1))]
    )
    faces = np.array([[4, 6, 5], [4, 7, 6], [0, 5, 1], [0, 4, 5], [3, 2, 6], [3, 6, 7], [1, 6, 2], [1, 5, 6]])
    lit = replace(PLAIN, unlit=False, color=np.ones(4, np.float32), uv=np.zeros((8, 2), np.float32))
    camera = Camera(np.array([0.0, 1.2, -0.3]), np.array([0.0, 0.0, -0.1]), 20)  # from above
    normals = np.tile([0.0, 1.0, 0.0], (8, 1))
    floor = (217, 217, 217)
    darker = picture(floor=floor, camera=camera).astype(int) - picture(
        (lit, (corners, normals), faces), floor=floor, camera=camera
    )
    away = in_picture(camera, [[0.0, 0.0, z] for z in (-0.105, 0.3)], SIZE)
    (column, row), (far_column, far_row) = np.floor(away * SIZE).astype(int)
    assert darker[row, column, 0] > 30
    assert abs(darker[far_row, far_column, 0]) < 8


def test_a_floor_without_a_colour_shows_shadows_only():
    behind = (200, 220, 240)
    pixels = picture((PLAIN, square(0.8), FRONT), shadows=True, camera=ABOVE, background=behind)
    assert pixels[5, 5].tolist() == list(behind)
    floor = ~(pixels[..., 0] > 250)
    assert ((pixels.sum(axis=2) < sum(behind) - 60) & floor).sum() > 100


def test_pictures_lie_over_the_frame_with_their_opacity():
    over = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    over[:20] = [255, 255, 255, 255]
    pixels = picture(overlays=[(over, 0.5)])
    assert pixels[10, 80] == pytest.approx([128, 128, 255], abs=2)
    assert pixels[30, 80].tolist() == [0, 0, 255]


def seen_by_rays(camera, corners, two_sided, places):
    """Return the nearest triangle (h, w, s) of corners (t, 3, 3) at each sample, −1 for none (Möller and Trumbore)."""
    right, up, towards = camera.axes
    slope = np.tan(np.radians(camera.field_of_view) / 2)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    x, y = ((each[..., None] + places[:, k]) / SIZE[k] * 2 - 1 for k, each in enumerate((x, y)))
    rays = -towards + slope * (x[..., None] * right * SIZE[0] / SIZE[1] - y[..., None] * up)
    nearest, shown = np.full(rays.shape[:3], np.inf), np.full(rays.shape[:3], -1)
    for number, (a, b, c) in enumerate(corners):
        across = np.cross(rays, c - a)
        size = across @ (b - a)
        u = (across @ (camera.eye - a)) / size
        along = np.cross(camera.eye - a, b - a)
        v, distance = rays @ along / size, (c - a) @ along / size
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance < nearest) & (two_sided | (size > 0))
        hit &= distance >= NEAR_SHARE * np.linalg.norm(camera.eye - camera.target)
        nearest, shown = np.where(hit, distance, nearest), np.where(hit, number, shown)
    return shown


@pytest.mark.parametrize("two_sided", [False, True], ids=["one-sided", "two-sided"])
@pytest.mark.parametrize("samples", PLACES)
def test_each_sample_shows_the_triangle_that_its_ray_meets_first(two_sided, samples):
    """Also triangles that reach behind the camera."""
    corners = np.random.default_rng(7).normal([0, 0.8, 1.5], 1.6, (60, 3, 3))
    corners[:30] = corners[:30, :1] + 0.1 * (corners[:30] - corners[:30, :1])
    triangles = np.arange(180).reshape(60, 3)
    colors = np.random.default_rng(1).uniform(size=(60, 4)).astype(np.float32).repeat(3, axis=0)
    uv = np.zeros((180, 2), np.float32)
    material = replace(PLAIN, color=np.ones(4), vertex_colors=colors, uv=uv, two_sided=two_sided)
    normals = np.tile([0.0, 0.0, 1.0], (180, 1))
    pixels = picture((material, (corners.reshape(-1, 3), normals), triangles), samples=samples)
    shown = seen_by_rays(CAMERA, corners, two_sided, PLACES[samples])
    linear = np.vstack([colors[::3, :3], [[0, 0, 1]]])  # the last is the background
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    expected = 255 * srgb[shown].mean(axis=2)
    off = np.abs(pixels - expected).max(axis=2)
    assert len(np.unique(shown)) > 15
    assert np.quantile(off, 0.998) < 4  # but for rays that graze an edge


def test_a_frame_does_not_depend_on_those_before():
    """The background is kept while the camera stands still."""
    near, far = square(0.5, z=1.0), square(0.9, x=0.3)
    cameras = [CAMERA, replace(CAMERA, field_of_view=40.0), CAMERA]
    floor = textures_of([np.random.default_rng(0).integers(0, 255, (8, 8, 4), np.uint8)], SHADES)
    around = Surroundings(np.full((1, 1, 4), 200, np.uint8), floor)
    drawn = geometry_of([([part_of(*near[:1], FRONT, near[1])], [PLAIN])])
    places = [tuple(each.astype(np.float32) for each in one) for one in (near, far, near)]

    def draw(renderer, number):
        return renderer.draw(cameras[number], STAGE, drawn, [places[number]], around)[..., :3]

    renderer = Renderer(SIZE)
    kept = [draw(renderer, number) for number in range(3)]
    for number in range(3):
        assert_array_equal(kept[number], draw(Renderer(SIZE), number))
    assert_array_equal(kept[0], kept[2])
    assert (kept[0] != kept[1]).any()


def test_the_floor_is_where_the_camera_projects_it():
    """A square on the floor, and a floor with a tile of the same colours at the same place."""
    camera = Camera(np.array([1.0, 2.0, 4.0]), np.array([0.2, 0.0, 0.3]), 35)
    tile = np.zeros((256, 256, 4), np.uint8)
    tile[:128, :128] = 255
    floor = textures_of([tile], SHADES)
    around = Surroundings(np.full((1, 1, 4), (0, 0, 255, 255), np.uint8), floor)
    pixels = Renderer(SIZE).draw(camera, STAGE, geometry_of([]), [], around)
    side = 1.6 * STAGE.size / 2  # of the white part of the tile
    corners = np.array([[0, 0, 0], [side, 0, 0], [side, 0, side], [0, 0, side]])
    seen = in_picture(camera, corners, SIZE) * SIZE
    middle = seen.mean(axis=0)
    for share, expected in ((0.9, 255), (1.1, 0)):
        for column, row in np.floor(middle + share * (seen - middle)).astype(int):
            assert_allclose(pixels[row, column, :3].astype(int), expected, atol=60)


def test_a_panorama_turns_with_the_camera():
    """A white stripe at an angle is where the camera projects that direction."""
    image = np.zeros((90, 720, 4), np.uint8)
    image[:, 360 + 2 * 20 : 360 + 2 * 24] = 255  # 20 to 24 degrees to the right of −z
    for turn in (-20.0, 10.0, 170.0):
        toward = np.radians(turn)
        eye = np.array([0.0, 1.0, 0.0])
        camera = Camera(eye, eye + np.array([np.sin(toward), 0.0, -np.cos(toward)]), 50)
        around = Surroundings(Panorama(image, 360.0, 45.0, -45.0), has_floor=False)
        pixels = Renderer(SIZE).draw(camera, STAGE, geometry_of([]), [], around)[..., 0]
        way = np.radians(22.0)
        seen = np.array([*(eye + np.array([np.sin(way), 0, -np.cos(way)])), 1.0]) @ camera.matrix(SIZE).astype(float)
        column = (seen[0] / seen[3] / 2 + 0.5) * SIZE[0]
        if seen[3] > 0 and 0 <= column < SIZE[0]:
            assert pixels[60, int(column)] == 255
            assert pixels[60].argmax() == pytest.approx(column, abs=6)
        else:
            assert not pixels.any()


def test_a_texture_that_is_seen_from_far_away_has_its_mean_colour():
    image = np.full((64, 64, 4), 255, np.uint8)
    image[::2, ::2, :3] = image[1::2, 1::2, :3] = 0
    uv = np.array([[0, 40], [40, 40], [40, 0], [0, 0]], np.float32)
    checked = replace(PLAIN, color=np.ones(4), image=image, uv=uv)
    inside = picture((checked, square(1.2), FRONT))[50:70, 70:90]
    assert_allclose(inside.astype(int), 188, atol=2)  # half of the light, as sRGB
