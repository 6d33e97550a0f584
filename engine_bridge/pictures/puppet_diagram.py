"""A picture of a puppet: the character from the front and its side, its limbs' bones, its handles and their joints."""

import colorsys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from engine_bridge.character.character import Character
from engine_bridge.pictures.renderer import View, contact_sheet, project, render
from engine_bridge.puppet.puppet import HandleTable, LimbTable, Puppet

VIEWS = {"from the front": (25.0, 12.0), "from its left": (100.0, 8.0)}
"""Title of each picture, and the camera's azimuth and elevation in degrees."""
SIZE = (840, 560)
"""Pixels of each picture; the space beside the character is for labels."""
DOT, JOINT, BONE, LINE = 8, 5, 5, 40
"""Pixels: radius of a handle's dot and of a joint's, width of a bone, and height of a label."""
SEEN_THROUGH = 0.6
"""How much of a character with limbs is faded towards white, so that the bones inside are seen."""
MARGIN = 8


@dataclass(frozen=True, eq=False)
class _Mark:
    """A limb or a handle in the picture: what it is called, what moves it, and its points (k, 3)."""

    name: str
    moved_by: str
    points: NDArray[np.float64]


def draw(puppet: Puppet, character: Character, path: Path, title: str) -> None:
    """Draw a puppet's limbs and handles onto its character into a PNG.

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
    vertices = character.vertices @ basis.T
    marks = [*map(_limb_mark, puppet.limb), *map(_handle_mark, puppet.handle)]
    images = []
    for angles in VIEWS.values():
        view = View.around(vertices, *angles)
        picture = render(vertices, character.triangles, view, SIZE, character.colors)
        if puppet.limb:
            picture = np.round(picture + SEEN_THROUGH * (255.0 - picture)).astype(np.uint8)
        image = Image.fromarray(picture)
        _label(image, [project(mark.points @ basis.T, view, SIZE)[:, :2] for mark in marks], marks)
        images.append(np.asarray(image))
    contact_sheet(images, list(VIEWS), len(images), path, title)


def _limb_mark(limb: LimbTable) -> _Mark:
    first, last = (" + ".join(dict.fromkeys(limb.driven_by[end])) for end in (0, -1))
    return _Mark(limb.name, f"{first} … {last}", np.array(limb.points, dtype=np.float64))


def _handle_mark(handle: HandleTable) -> _Mark:
    return _Mark(handle.name, " + ".join(handle.driven_by) or "stays", np.array([handle.position], dtype=np.float64))


def _label(image: Image.Image, places: list[NDArray[np.float64]], marks: list[_Mark]) -> None:
    """Draw each mark, seen through the surface, and a line from its end to its label at the nearer side."""
    pen = ImageDraw.Draw(image)
    large, small = ImageFont.load_default(19), ImageFont.load_default(14)
    ends = np.array([place[-1] for place in places])
    on_the_right = ends[:, 0] > SIZE[0] / 2
    for side in (False, True):
        chosen = [index for index in np.argsort(ends[:, 1], kind="stable").tolist() if on_the_right[index] == side]
        edge, anchor = (SIZE[0] - MARGIN, "r") if side else (MARGIN, "l")
        for index, y in zip(chosen, _apart(ends[chosen, 1]), strict=True):
            mark, color = marks[index], _color(index, len(marks))
            x = float(ends[index, 0])
            reach = max(pen.textlength(mark.name, large), pen.textlength(mark.moved_by, small)) + MARGIN
            pen.line([(edge + (-reach if side else reach), y), (x, float(ends[index, 1]))], color, 2)
            pen.text((edge, y), mark.name, color, large, anchor=f"{anchor}b")
            pen.text((edge, y + 1), mark.moved_by, (70, 72, 78), small, anchor=f"{anchor}t")
    for index, place in enumerate(places):
        color = _color(index, len(marks))
        pen.line([(x, y) for x, y in place.tolist()], color, BONE)
        radius = JOINT if len(place) > 1 else DOT
        for x, y in place.tolist():
            pen.ellipse((x - radius, y - radius, x + radius, y + radius), color, (255, 255, 255), 2)


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
