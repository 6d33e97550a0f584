"""What is behind the characters of a film, and over them: pictures, panoramas, the floor and the shadows on it.

A frame is (h, w, 4) uint8. Cameras stand upright, so that all pixels of a row see the floor at one depth.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.camera import Camera
from engine_bridge.pictures.kernels import inner, kernel
from engine_bridge.pictures.lights import Lights, irradiance
from engine_bridge.pictures.pixels import between, encoded, lay
from engine_bridge.pictures.surroundings import Overlay, Panorama
from engine_bridge.pictures.textures import texture

GRID = 8
"""Distance in pixels between points of a panorama that are computed; between them it is interpolated."""


STEP = 3
"""Distance in pixels between points of the floor whose light is computed: shadows are soft, so few are enough."""


class Rays(NamedTuple):
    """The directions in which pixels look: `ahead` + x `right` + y `down`, with x and y from −1 to 1 (3 each)."""

    eye: NDArray[np.float64]
    ahead: NDArray[np.float64]
    right: NDArray[np.float64]
    down: NDArray[np.float64]


def rays_of(camera: Camera, size: tuple[int, int]) -> Rays:
    """Return the directions in which the pixels of a frame look."""
    right, up, towards = camera.axes
    slope = np.tan(np.radians(camera.field_of_view) / 2)
    return Rays(np.asarray(camera.eye, np.float64), -towards, right * slope * size[0] / size[1], -up * slope)


def show_panorama(frame: NDArray[np.uint8], panorama: Panorama, rays: Rays) -> None:
    """Fill a frame with a panorama."""
    height, width = frame.shape[:2]
    columns, rows = (np.arange(0, side + GRID, GRID) for side in (width, height))
    x, y = 2 * columns[None, :, None] / width - 1, 2 * rows[:, None, None] / height - 1
    ways = rays.ahead + x * rays.right + y * rays.down
    heading = np.arctan2(rays.ahead[0], -rays.ahead[2])
    # relative to where the camera looks, so that nothing jumps between two points
    east, north = np.cos(heading) * ways[..., 0] + np.sin(heading) * ways[..., 2], np.hypot(ways[..., 0], ways[..., 2])
    ahead = np.sin(heading) * ways[..., 0] - np.cos(heading) * ways[..., 2]
    around = np.degrees(heading + np.arctan2(east, ahead)) / panorama.period + 0.5
    high = np.degrees(np.arctan2(ways[..., 1], north))
    down = (panorama.top - high) / (panorama.top - panorama.bottom)
    _show_around(frame, panorama.image, around, down)


@kernel
def _show_around(frame, image, around, down):
    """Fill a frame with an image that repeats sideways, at points of it (rows, columns), see `GRID`."""
    height, width = image.shape[:2]
    for row in range(frame.shape[0]):
        i, b = row // GRID, row % GRID / GRID + 0.5 / GRID
        for column in range(frame.shape[1]):
            j, a = column // GRID, column % GRID / GRID + 0.5 / GRID
            u = (1 - b) * ((1 - a) * around[i, j] + a * around[i, j + 1])
            u += b * ((1 - a) * around[i + 1, j] + a * around[i + 1, j + 1])
            v = (1 - b) * ((1 - a) * down[i, j] + a * down[i, j + 1])
            v += b * ((1 - a) * down[i + 1, j] + a * down[i + 1, j + 1])
            x, y = (u - np.floor(u)) * width - 0.5, min(max(v * height - 0.5, 0.0), height - 1.0)
            left, top = int(np.floor(x)), int(y)
            below = min(top + 1, height - 1)
            p, q = x - left, y - top
            right, left = (left + 1) % width, left % width
            for k in range(3):
                frame[row, column, k] = int(between(image, top, below, left, right, q, p, k) + 0.5)


@kernel
def show_floor(frame, floor, rays, middle, reach, tile):
    """Draw the floor over a frame; it fades out towards a circle.

    Parameters
    ----------
    frame : (h, w, 4) uint8
    floor : Textures
        One image.
    rays : Rays
    middle : (3,) float64
        Of the circle.
    reach : float
        Radius of the circle, in metres.
    tile : float
        Width and height of the image, in metres.
    """
    height, width = frame.shape[:2]
    texels = floor.levels[0, 0, 1] / tile
    across = 2 / width * np.sqrt(rays.right[0] ** 2 + rays.right[2] ** 2)
    for row in range(height):
        y = 2 * (row + 0.5) / height - 1
        far = _distance(rays, y)
        if far <= 0:
            continue
        # the point of the floor in the middle of this row, and of the next
        next_far = _distance(rays, y + 2 / height)
        stride = far * across
        if next_far > 0:
            px, pz = _point(rays, far, 0.0, y)
            next_x, next_z = _point(rays, next_far, 0.0, y + 2 / height)
            stride = max(stride, np.sqrt((next_x - px) ** 2 + (next_z - pz) ** 2))
        for column in range(width):
            x = 2 * (column + 0.5) / width - 1
            px, pz = _point(rays, far, x, y)
            share = np.sqrt((px - middle[0]) ** 2 + (pz - middle[2]) ** 2) / reach
            if share > 1:
                continue
            fading = min(max((share - 0.25) / 0.75, 0.0), 1.0)
            opacity = 1 - fading * fading * (3 - 2 * fading)
            r, g, b, _ = texture(floor, 0, px / tile, pz / tile, stride * texels)
            lay(frame, row, column, 255 * r, 255 * g, 255 * b, opacity)


@inner
def _distance(rays, y):
    """Return the distance of the floor in a row of pixels, in lengths of their directions; negative without a floor."""
    down = rays.ahead[1] + y * rays.down[1]
    return -rays.eye[1] / down if down * rays.eye[1] < 0 else -1.0


@inner
def _point(rays, far, x, y):
    """Return x and z of the point in a pixel's direction, at a distance in lengths of that."""
    return (
        rays.eye[0] + far * (rays.ahead[0] + x * rays.right[0] + y * rays.down[0]),
        rays.eye[2] + far * (rays.ahead[2] + x * rays.right[2] + y * rays.down[2]),
    )


def show_shadows(frame: NDArray[np.uint8], lights: Lights, rays: Rays, window: tuple[int, int, int, int]) -> None:
    """Darken the floor in a window of a frame, from its first column and row to those after its last."""
    left, top, right, bottom = window
    shade = np.ones(((bottom - top) // STEP + 2, (right - left) // STEP + 2, 3), np.float32)
    _floor_light(shade, lights, rays, left, top, frame.shape[1], frame.shape[0])
    _darken(frame, shade, left, top, right, bottom)


@kernel
def _floor_light(shade, lights, rays, left, top, width, height):
    """Compute the share of the light that reaches the floor, encoded, at every `STEP`-th pixel from a corner on."""
    for i in range(shade.shape[0]):
        y = 2 * (top + STEP * i) / height - 1
        far = _distance(rays, y)
        if far <= 0:
            continue
        for j in range(shade.shape[1]):
            x = 2 * (left + STEP * j) / width - 1
            px, pz = _point(rays, far, x, y)
            # the floor casts no shadow, so it needs no lift; with one, what is lower than that would lose its shadow
            light = irradiance(lights, px, 0.0, pz, 0.0, 1.0, 0.0, 0.0)
            for k in range(3):
                shade[i, j, k] = encoded(light[k] / (lights.towards[1] * lights.key_color[k] + lights.sky_color[k]))


@inner
def _is_lit(shade, row, column):
    """Return whether all light reaches two points beside each other; one colour of a light may be none."""
    least = 1.0
    for k in range(3):
        least = min(least, shade[row, column, k], shade[row, column + 1, k])
    return least == 1


@kernel
def _darken(frame, shade, left, top, right, bottom):
    """Multiply a window of a frame by shades that are computed at every `STEP`-th pixel, interpolated."""
    for row in range(top, bottom):
        y = (row + 0.5 - top) / STEP
        i, b = int(y), y - int(y)
        for column in range(left, right):
            x = (column + 0.5 - left) / STEP
            j, a = int(x), x - int(x)
            if _is_lit(shade, i, j) and _is_lit(shade, i + 1, j):
                continue
            for k in range(3):
                light = between(shade, i, i + 1, j, j + 1, b, a, k)
                frame[row, column, k] = int(frame[row, column, k] * light + 0.5)


def show(frame: NDArray[np.uint8], overlay: Overlay) -> None:
    """Draw a picture over a frame."""
    height, width = frame.shape[:2]
    left, top, right, bottom = np.array(overlay.place) * [width, height, width, height]
    _show(frame, overlay.picture, left, top, right, bottom, overlay.opacity)


@kernel
def _show(frame, picture, left, top, right, bottom, opacity):
    """Draw a picture (h, w, 4) over a rectangle of a frame, interpolated."""
    rows, columns = picture.shape[:2]
    for row in range(max(int(np.ceil(top - 0.5)), 0), min(int(np.ceil(bottom - 0.5)), frame.shape[0])):
        y = min(max((row + 0.5 - top) / (bottom - top) * rows - 0.5, 0.0), rows - 1.0)
        i, b = int(y), y - int(y)
        below = min(i + 1, rows - 1)
        for column in range(max(int(np.ceil(left - 0.5)), 0), min(int(np.ceil(right - 0.5)), frame.shape[1])):
            x = min(max((column + 0.5 - left) / (right - left) * columns - 0.5, 0.0), columns - 1.0)
            j, a = int(x), x - int(x)
            beside = min(j + 1, columns - 1)
            share = opacity / 255 * between(picture, i, below, j, beside, b, a, 3)
            if share > 0:
                red = between(picture, i, below, j, beside, b, a, 0)
                green = between(picture, i, below, j, beside, b, a, 1)
                blue = between(picture, i, below, j, beside, b, a, 2)
                lay(frame, row, column, red, green, blue, share)
