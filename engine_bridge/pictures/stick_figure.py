"""An image of a performer's skeleton, from the same camera as an image of a character."""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from capture.skeleton import JOINT_INDEX, PARENTS
from engine_bridge.pictures.mesh_picture import backdrop
from engine_bridge.pictures.view import View, project

SUPERSAMPLING = 3
LEFT, RIGHT, MIDDLE = (214, 106, 36), (38, 104, 178), (74, 78, 86)
"""sRGB colours of the performer's left side, right side, and trunk with head."""
BONE_WIDTH, HEAD_RADIUS = 0.018, 0.055
"""Sizes relative to the image's smaller side."""


def draw(joints: NDArray[np.floating], view: View, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Draw a performer's bones, the nearer ones on top.

    Parameters
    ----------
    joints : (20, 3) float
        Metres, character axes (y up, left at +x, forward +z); NaN for lost joints.
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
    pen, thick = ImageDraw.Draw(image), round(BONE_WIDTH * min(large))
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
        _dot(pen, float(head[0]), float(head[1]), HEAD_RADIUS * min(large), MIDDLE)
    return np.asarray(image.resize(size, Image.Resampling.BOX))


def _color(joint: str) -> tuple[int, int, int]:
    return {"left": LEFT, "right": RIGHT}.get(joint.rpartition("_")[2], MIDDLE)


def _dot(pen: ImageDraw.ImageDraw, x: float, y: float, radius: float, color: tuple[int, int, int]) -> None:
    pen.ellipse((x - radius, y - radius, x + radius, y + radius), color)
