"""A picture of a puppet: the character from the front and from its side, with its handles and what moves them."""

import colorsys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from engine_bridge.gltf.character import Character
from engine_bridge.preview import View, contact_sheet, project, render
from engine_bridge.puppet import HandleTable, Puppet

VIEWS = {"from the front": (25.0, 12.0), "from its left": (100.0, 8.0)}
"""Title of each picture, and the camera's azimuth and elevation in degrees."""
SIZE = (840, 560)
"""Pixels of each picture; the space beside the character is for labels."""
DOT, LINE = 8, 40
"""Pixels: radius of a handle's dot, and height of a label."""
MARGIN = 8


def draw(puppet: Puppet, character: Character, path: Path, title: str) -> None:
    """Draw a puppet's handles onto its character into a PNG.

    Parameters
    ----------
    puppet : Puppet
    character : Character
        The puppet's.
    path : Path
    title : str

    Raises
    ------
    OutputError
    """
    basis = puppet.character.basis
    vertices, handles = character.vertices @ basis.T, puppet.handle_positions @ basis.T
    images = []
    for angles in VIEWS.values():
        view = View.around(vertices, *angles)
        image = Image.fromarray(render(vertices, character.triangles, view, SIZE, character.colors))
        _label(image, project(handles, view, SIZE)[:, :2], puppet.handle)
        images.append(np.asarray(image))
    contact_sheet(images, list(VIEWS), len(images), path, title)


def _label(image: Image.Image, dots: NDArray[np.float64], handles: tuple[HandleTable, ...]) -> None:
    """Draw a dot for each handle, seen through the surface, and a line from it to its label at the nearer side."""
    pen = ImageDraw.Draw(image)
    large, small = ImageFont.load_default(19), ImageFont.load_default(14)
    on_the_right = dots[:, 0] > SIZE[0] / 2
    for side in (False, True):
        chosen = [index for index in np.argsort(dots[:, 1], kind="stable").tolist() if on_the_right[index] == side]
        edge, anchor = (SIZE[0] - MARGIN, "r") if side else (MARGIN, "l")
        for index, y in zip(chosen, _apart(dots[chosen, 1]), strict=True):
            handle, color = handles[index], _color(index, len(handles))
            x = float(dots[index, 0])
            moved_by = " + ".join(handle.driven_by) or "stays"
            reach = max(pen.textlength(handle.name, large), pen.textlength(moved_by, small)) + MARGIN
            pen.line([(edge + (-reach if side else reach), y), (x, float(dots[index, 1]))], color, 2)
            pen.text((edge, y), handle.name, color, large, anchor=f"{anchor}b")
            pen.text((edge, y + 1), moved_by, (70, 72, 78), small, anchor=f"{anchor}t")
    for index, (x, y) in enumerate(dots.tolist()):
        box = (x - DOT, y - DOT, x + DOT, y + DOT)
        pen.ellipse(box, _color(index, len(handles)), (255, 255, 255), 2)


def _apart(heights: NDArray[np.float64]) -> list[float]:
    """Move labels, sorted from the top, until none covers another and all are in the picture."""
    count = len(heights)
    slots = LINE * np.arange(count)
    lowered = np.maximum.accumulate(heights - slots) + slots
    lowest = SIZE[1] - LINE / 2 - LINE * np.arange(count)[::-1]
    placed: list[float] = np.clip(lowered, LINE / 2 + slots, np.maximum(lowest, LINE / 2 + slots)).tolist()
    return placed


def _color(index: int, count: int) -> tuple[int, int, int]:
    red, green, blue = colorsys.hsv_to_rgb(index / count, 0.85, 0.72)
    return round(255 * red), round(255 * green), round(255 * blue)
