"""A picture of a performer's skeleton, drawn by the camera that draws a character."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from capture.skeleton import JOINT_INDEX, PARENTS
from engine_bridge.pictures.renderer import View, backdrop, project

SUPERSAMPLING = 3
LEFT, RIGHT, MIDDLE = (214, 106, 36), (38, 104, 178), (74, 78, 86)
"""sRGB of the performer's left side, right side, and the trunk with the head."""
WIDTH = 0.018
"""Of a bone's line, as a share of the picture's smaller side."""
HEAD = 0.055
"""Radius of the head, as the same share."""


def draw(joints: NDArray[np.floating], view: View, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Draw a performer's bones, the nearer ones over the others.

    Parameters
    ----------
    joints : (20, 3) float
        Metres, character axes (y up, left at +x, forward +z); NaN for joints that are not known.
    view : View
    size : tuple of 2 ints
        Width and height in pixels.

    Returns
    -------
    (height, width, 3) uint8
        sRGB.
    """
    large = (size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING)
    image = Image.fromarray(backdrop(large))
    pen, thick = ImageDraw.Draw(image), round(WIDTH * min(large))
    seen = project(joints, view, large)
    bones = [(JOINT_INDEX[parent], JOINT_INDEX[joint], _color(joint)) for joint, parent in PARENTS.items()]
    known = [bone for bone in bones if np.isfinite(seen[list(bone[:2])]).all()]
    for start, end, color in sorted(known, key=lambda bone: -seen[list(bone[:2]), 2].sum()):
        (x0, y0), (x1, y1) = seen[start, :2].tolist(), seen[end, :2].tolist()
        pen.line([(x0, y0), (x1, y1)], color, thick)
        for x, y in ((x0, y0), (x1, y1)):
            _dot(pen, x, y, thick / 2, color)
    head = seen[JOINT_INDEX["head"]]
    if np.isfinite(head).all():
        _dot(pen, float(head[0]), float(head[1]), HEAD * min(large), MIDDLE)
    return np.asarray(image.resize(size, Image.Resampling.BOX))


def _color(joint: str) -> tuple[int, int, int]:
    if joint.endswith("_left"):
        return LEFT
    return RIGHT if joint.endswith("_right") else MIDDLE


def _dot(pen: ImageDraw.ImageDraw, x: float, y: float, radius: float, color: tuple[int, int, int]) -> None:
    pen.ellipse((x - radius, y - radius, x + radius, y + radius), color)
