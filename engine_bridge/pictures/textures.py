"""Textures with smaller copies of themselves, and their colours at points."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.kernels import inner, shared


class Textures(NamedTuple):
    """Images that repeat, each with copies of half, a quarter … of its width and height.

    Attributes
    ----------
    texels : (k, 4) uint8
        RGB and opacity of all images and copies, row by row.
    levels : (i, l, 3) int32
        Of each image and copy: its first texel, its width and its height. After the last copy, it is repeated.
    shades : (256,) float32
        What the numbers of RGB mean.
    """

    texels: NDArray[np.uint8]
    levels: NDArray[np.int32]
    shades: NDArray[np.float32]


def textures_of(images: Sequence[NDArray[np.uint8]], shades: NDArray[np.float32]) -> Textures:
    """Return the textures of images (h, w, 4) whose RGB means some shades (256,), which rise."""
    texels, rows, start = [np.zeros((0, 4), np.uint8)], [], 0
    for image in images:
        levels = list[tuple[int, int, int]]()
        for level in _ever_smaller(image, shades):
            height, width = level.shape[:2]
            levels.append((start, width, height))
            texels.append(level.reshape(-1, 4))
            start += width * height
        rows.append(levels)
    most = max(map(len, rows), default=1)
    full = [levels + levels[-1:] * (most - len(levels)) for levels in rows]
    return Textures(np.concatenate(texels), np.array(full, np.int32).reshape(-1, most, 3), shades)


def _ever_smaller(image: NDArray[np.uint8], shades: NDArray[np.float32]) -> Iterator[NDArray[np.uint8]]:
    """Yield an image (h, w, 4) and copies of half, a quarter … of its size, down to one texel, of equal light."""
    yield image
    light = np.concatenate([shades[image[..., :3]], image[..., 3:].astype(np.float32)], axis=2)
    while light.shape[:2] != (1, 1):
        light = _halved(_halved(light).swapaxes(0, 1)).swapaxes(0, 1)
        numbers = np.interp(light[..., :3], shades, np.arange(256))
        yield np.rint(np.concatenate([numbers, light[..., 3:]], axis=2)).astype(np.uint8)


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the means of two rows each; the last of an odd number of rows goes."""
    rows = len(image) // 2 * 2
    halved: NDArray[np.float32] = np.float32(0.5) * (image[:rows:2] + image[1:rows:2])
    return halved if rows else image


@shared
def texture(textures, number, u, v, stride):
    """Return the red, green, blue and opacity of an image at a point (u, v), in shares of its width and height.

    `stride` is the distance, in texels of the image, to the next point that is looked up. Texels are interpolated
    linearly, in two of the copies and between these.
    """
    levels = textures.levels[number]
    level = min(max(np.log2(max(stride, 1e-9)), 0.0), len(levels) - 1.0)
    below = int(level)
    share = level - below
    r, g, b, a = _bilinear(textures, levels[below], u, v)
    if share > 0:
        r2, g2, b2, a2 = _bilinear(textures, levels[below + 1], u, v)
        r, g, b, a = r + share * (r2 - r), g + share * (g2 - g), b + share * (b2 - b), a + share * (a2 - a)
    return r, g, b, a


@inner
def _bilinear(textures, level, u, v):
    texels, shades = textures.texels, textures.shades
    start, width, height = level[0], level[1], level[2]
    x, y = (u - np.floor(u)) * width - 0.5, (v - np.floor(v)) * height - 0.5
    column, row = int(np.floor(x)), int(np.floor(y))
    across, down = x - column, y - row
    r, g, b, a = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        dx, dy = k & 1, k >> 1
        i = start + (row + dy) % height * width + (column + dx) % width
        weight = (across if dx else 1 - across) * (down if dy else 1 - down)
        r += weight * shades[texels[i, 0]]
        g += weight * shades[texels[i, 1]]
        b += weight * shades[texels[i, 2]]
        a += weight * texels[i, 3] / 255.0
    return r, g, b, a
