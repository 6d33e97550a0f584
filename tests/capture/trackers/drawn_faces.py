"""Drawn faces whose openings are known: a surface of points in space with painted eyes, brows and lips."""

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

GRID = 0.05
"""Distance of the points of the face, in centimetres."""

SKIN, HAIR, BACKGROUND = (224, 172, 140), (60, 40, 28), (120, 130, 140)
EYE_X, MOUTH_Y = 3.1, 6.6
VIEW_CM, DISTANCE_CM = 22.0, 150.0


@cache
def draw(opening=0.0, smile=0.0, blink=(0.0, 0.0), brow=0.0, yaw=0.0, size=200, fill=0.6, pitch=0.0, roll=0.0):
    """Return an image (size, size, 3) of a face.

    Opening of the mouth, height of its corners and of the brows are in centimetres, blinks of the performer's left and
    right eye from 0 to 1, and the turns in degrees: to the performer's left, down, and to its left shoulder. The face
    fills a part of the image.
    """
    x, y, z, inside = _surface(opening)
    colors = np.broadcast_to(SKIN, (*x.shape, 3)).astype(float)
    _paint(colors, 0.3 * np.hypot((np.abs(x) - 0.75) / 0.42, (y - 4.6) / 0.22) - 0.3, (130, 80, 70))  # nostrils
    along = np.abs(x) - 3.2
    height = np.abs(y + 1.75 + brow + 0.35 * np.clip(1 - (along / 1.9) ** 2, 0, 1))
    _paint(colors, np.maximum(height - 0.27 * np.clip(1 - 0.16 * along, 0, 2), np.abs(along) - 1.9), (70, 45, 30), 0.12)
    for side, closed in ((1, blink[0]), (-1, blink[1])):  # the performer's left is right in the image
        _paint_eye(colors, x, y, side, closed)
    _paint_mouth(colors, x, y, opening, smile)
    _paint(colors, y + 6.0 - 6 * np.clip(np.abs(x) - 5.8, 0, None), HAIR, 0.3)
    zy, zx = np.gradient(z, GRID)
    normals = np.stack([-zx, -zy, np.ones_like(z)], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    front = np.stack([x, y, z + 8], -1)[inside], colors[inside], normals[inside]
    shown = (np.concatenate(each) for each in zip(front, _back(), _neck(), strict=True))
    return _projected(*shown, turn(yaw, pitch, roll), size, fill)


def _paint(image, distance, color, width=0.06):
    """Paint where the signed distance from an edge is negative, which is inside; the edge is soft."""
    image += np.clip(0.5 - distance / (2 * width), 0, 1)[..., None] * (np.asarray(color, float) - image)


def _surface(opening):
    """Return the points of a face, and which of them it has."""
    chin = 10.6 + 0.6 * opening
    x, y = np.meshgrid(np.arange(-7.6, 7.6, GRID), np.arange(-11.5, chin + 0.2, GRID))
    u = np.where(y < 0, y / -11.3, y / chin)
    taper = 1 - 0.12 * np.clip((y - 2) / (chin - 2), 0, 1)
    half = 7.3 * np.sqrt(np.clip(1 - u**2 * np.where(y < 0, 1, 0.92), 0, 1)) * taper
    across = np.clip(1 - (x / np.maximum(half, 1e-6)) ** 2, 0, 1)
    z = -8 + 8 * np.sqrt(across) * np.sqrt(np.clip(1 - 0.55 * u**2, 0, 1))
    for height, cx, cy, sx, sy in (
        *((2.1, 0, 3.9, 1.3, 1.3), (1.0, 0, 1.8, 0.8, 1.9)),  # the nose
        (0.5, 0, MOUTH_Y + 0.4 * opening, 2.6, 1.6),
        *((0.5, side * 3, -1.8, 2, 0.6) for side in (-1, 1)),
        *((-0.9, side * EYE_X, 0, 1.7, 1.0) for side in (-1, 1)),
    ):
        z += height * np.exp(-(((x - cx) / sx) ** 2) - ((y - cy) / sy) ** 2)
    return x, y, z, np.abs(x) < half


def _paint_eye(colors, x, y, side, closed):
    along = (x - side * EYE_X) / 1.5
    lid, within = np.clip(1 - along**2, 0, None), (np.abs(along) - 1) * 1.5
    upper, lower = (0.55 - 0.9 * closed) * lid, 0.35 * lid
    opened = np.maximum(np.maximum(np.maximum(-upper - y, y - lower), within), 0.02 - upper - lower)
    _paint(colors, opened, (240, 238, 235))
    for radius, color in ((0.62, (90, 60, 35)), (0.28, (15, 12, 10))):
        _paint(colors, np.maximum(opened, np.hypot(x - side * EYE_X, y + 0.05) - radius), color)
    _paint(colors, np.maximum(np.abs(y + upper) - 0.1, within), (45, 28, 22), 0.08)


def _paint_mouth(colors, x, y, opening, smile):
    half = 2.6
    lip, within = np.clip(1 - (x / half) ** 2, 0, None), np.abs(x) - half
    shape = lip**0.6
    top = MOUTH_Y - smile * (np.abs(x) / half) ** 2 + 0.2 * opening * (1 - shape)
    bottom = top + opening * shape
    above = top - 0.75 * lip**0.7 + 0.25 * np.exp(-((x / 0.45) ** 2))
    _paint(colors, np.maximum(np.maximum(above - y, y - bottom - lip**0.7), within), (185, 85, 85))
    _paint(colors, np.maximum(np.abs(y - top) - 0.06, within), (120, 45, 45))
    _paint(colors, np.maximum(np.maximum(top - y, y - bottom), within), (60, 18, 20), 0.04)


def _back():
    around, down = np.meshgrid(np.linspace(0, 2 * np.pi, 600), np.linspace(0, np.pi, 330))
    points = np.stack(
        [7.4 * np.sin(down) * np.cos(around), -1.2 - 10.6 * np.cos(down), -8.5 * np.sin(down) * np.abs(np.sin(around))],
        -1,
    )
    points = points[points[..., 1] < 4] - [0, 0, 0.2]
    return points, np.broadcast_to(HAIR, points.shape), points / 8


def _neck():
    around, down = np.meshgrid(np.linspace(0, 2 * np.pi, 400), np.linspace(5, 22, 230))
    points = np.stack([5 * np.cos(around), down, 5 * np.sin(around)], -1).reshape(-1, 3)
    return points, np.broadcast_to(SKIN, points.shape), points * [0.2, 0, 0.2]


def turn(yaw=0.0, pitch=0.0, roll=0.0):
    """Return the rotation (3, 3) of a head, from degrees; x is right in the image, y down, z towards the camera."""
    return Rotation.from_euler("YXZ", [yaw, -pitch, roll], degrees=True).as_matrix()


def _projected(points, colors, normals, turned, size, fill):
    points, normals = points @ turned.T, normals @ turned.T
    shade = 0.55 + 0.5 * np.clip(normals @ (-0.25, -0.45, 0.86), 0, 1)
    scale = 2 * size * fill / VIEW_CM * DISTANCE_CM / (DISTANCE_CM - points[:, 2])
    columns, rows = (np.round(size + points[:, axis] * scale).astype(int) for axis in (0, 1))
    seen = (columns >= 0) & (rows >= 0) & (columns < 2 * size) & (rows < 2 * size)
    order = np.flatnonzero(seen)[np.argsort(points[seen, 2], kind="stable")]
    image = np.empty((2 * size, 2 * size, 3), np.uint8)
    image[:] = BACKGROUND
    image[rows[order], columns[order]] = np.clip(colors[order] * shade[order, None], 0, 255)
    import cv2  # only the environment of cameras has it

    return cv2.resize(cv2.medianBlur(image, 3), (size, size), interpolation=cv2.INTER_AREA)
