"""Drawn faces whose openings are known: a head of points in space with painted eyes, brows and lips."""

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
    x, y, z, normals, inside = _surface(opening)
    colors = np.empty((*x.shape, 3))
    colors[:] = SKIN
    _paint_nose_and_brows(colors, x, y, brow)
    for side, closed in ((1, blink[0]), (-1, blink[1])):  # the performer's left is right in the image
        _paint_eye(colors, x, y, side, closed)
    _paint_mouth(colors, x, y, opening, smile)
    _over(colors, _cover(y + 6.0 - 6 * np.clip(np.abs(x) - 5.8, 0, None), 0.3), HAIR)
    parts = [(np.stack([x, y, z], -1)[inside], colors[inside], normals[inside]), _back(), _neck()]
    points, colors, normals = (np.concatenate(each) for each in zip(*parts, strict=True))
    return _projected(points, colors, normals, turn(yaw, pitch, roll), size, fill)


def _cover(distance, width=0.06):
    """Return the coverage of points by their signed distance from an edge, negative inside."""
    return np.clip(0.5 - distance / (2 * width), 0, 1)


def _over(image, mask, color):
    image += mask[..., None] * (np.asarray(color, float) - image)


def _surface(opening):
    chin = 10.6 + 0.6 * opening
    x, y = np.meshgrid(np.arange(-7.6, 7.6, GRID), np.arange(-11.5, chin + 0.2, GRID))
    u = np.where(y < 0, y / -11.3, y / chin)
    taper = 1 - 0.12 * np.clip((y - 2) / (chin - 2), 0, 1)
    half = 7.3 * np.sqrt(np.clip(1 - u**2 * np.where(y < 0, 1, 0.92), 0, 1)) * taper
    across = np.clip(1 - (x / np.maximum(half, 1e-6)) ** 2, 0, 1)
    z = -8 + 8 * np.sqrt(across) * np.sqrt(np.clip(1 - 0.55 * u**2, 0, 1))

    def bump(height, cx, cy, sx, sy):
        return height * np.exp(-(((x - cx) / sx) ** 2) - ((y - cy) / sy) ** 2)

    z += bump(2.1, 0, 3.9, 1.3, 1.3) + bump(1.0, 0, 1.8, 0.8, 1.9)
    z += bump(0.5, 0, MOUTH_Y + 0.4 * opening, 2.6, 1.6) + bump(0.6, 0, chin - 1, 2, 1)
    for side in (-1, 1):
        z += bump(0.5, side * 3, -1.8, 2, 0.6) - bump(0.9, side * EYE_X, 0, 1.7, 1.0)
    zy, zx = np.gradient(z, GRID)
    normals = np.stack([-zx, -zy, np.ones_like(z)], -1)
    return x, y, z, normals / np.linalg.norm(normals, axis=-1, keepdims=True), np.abs(x) < half


def _paint_nose_and_brows(colors, x, y, brow):
    _over(colors, 0.8 * _cover(0.3 * np.hypot((np.abs(x) - 0.75) / 0.42, (y - 4.6) / 0.22) - 0.3), (110, 60, 50))
    along = np.abs(x) - 3.2
    height = np.abs(y + 1.75 + brow + 0.35 * np.clip(1 - (along / 1.9) ** 2, 0, 1))
    thick = 0.27 * np.clip(1 - 0.16 * along, 0, 2)
    _over(colors, 0.9 * _cover(np.maximum(height - thick, np.abs(along) - 1.9), 0.12), (70, 45, 30))


def _paint_eye(colors, x, y, side, closed):
    along = (x - side * EYE_X) / 1.5
    lid = np.clip(1 - along**2, 0, None)
    upper, lower = (0.55 - 0.9 * closed) * lid, 0.35 * lid
    within = (np.abs(along) - 1) * 1.5
    ball = np.empty_like(colors)
    ball[:] = (240, 238, 235)
    for radius, color in ((0.62, (90, 60, 35)), (0.28, (15, 12, 10))):
        _over(ball, _cover(np.hypot(x - side * EYE_X, y + 0.05) - radius), color)
    seen = _cover(np.maximum(np.maximum(-upper - y, y - lower), within), 0.05) * (upper + lower > 0.02)
    _over(colors, seen, ball)
    beside = _cover(within, 0.1)
    _over(colors, 0.9 * beside * _cover(np.abs(y + upper) - 0.1, 0.08), (45, 28, 22))
    _over(colors, 0.4 * beside * _cover(np.abs(y - lower) - 0.05), (120, 75, 60))


def _paint_mouth(colors, x, y, opening, smile):
    half = 2.6
    lip = np.clip(1 - (x / half) ** 2, 0, None)
    within, shape = np.abs(x) - half, lip**0.6
    top = MOUTH_Y - smile * (np.abs(x) / half) ** 2 + 0.2 * opening * (1 - shape)
    bottom = top + opening * shape
    above = top - 0.75 * lip**0.7 + 0.25 * np.exp(-((x / 0.45) ** 2))
    _over(colors, _cover(np.maximum(np.maximum(above - y, y - bottom - lip**0.7), within)), (185, 85, 85))
    hole = _cover(np.maximum(np.maximum(top - y, y - bottom), within), 0.04) * (opening > 0)
    inner = np.empty_like(colors)
    inner[:] = (60, 18, 20)
    _over(inner, _cover(np.maximum(top - y, y - top - 0.55 * min(opening, 1.0))), (235, 230, 220))
    _over(colors, hole, inner)
    _over(colors, 0.7 * _cover(np.maximum(np.abs(y - top) - 0.06, within)) * (1 - hole), (120, 45, 45))


def _back():
    around, down = np.meshgrid(np.linspace(0, 2 * np.pi, 600), np.linspace(0, np.pi, 330))
    depth = -8.2 - 8.5 * np.sin(down) * np.abs(np.sin(around))
    points = np.stack([7.4 * np.sin(down) * np.cos(around), -1.2 - 10.6 * np.cos(down), depth], -1).reshape(-1, 3)
    points = points[points[:, 1] < 4]
    return points, np.broadcast_to(np.array(HAIR, float), points.shape), (points + np.array([0, 1, 8])) / 8


def _neck():
    around, down = np.meshgrid(np.linspace(0, 2 * np.pi, 400), np.linspace(5, 22, 230))
    normals = np.stack([np.cos(around), 0 * around, np.sin(around)], -1).reshape(-1, 3)
    points = 5 * normals + np.stack([0 * down, down, 0 * down - 8], -1).reshape(-1, 3)
    return points, np.broadcast_to((200.0, 150.0, 120.0), points.shape), normals


def turn(yaw=0.0, pitch=0.0, roll=0.0):
    """Return the rotation (3, 3) of a head, from degrees; x is right in the image, y down, z towards the camera."""
    return Rotation.from_euler("YXZ", [yaw, -pitch, roll], degrees=True).as_matrix()


def _projected(points, colors, normals, turned, size, fill):
    points, normals = (points + np.array([0, 0, 8])) @ turned.T, normals @ turned.T
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
