"""A diagram of a puppet file: the character from the front and the side, its limbs, handles and their joints."""

import colorsys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from engine_bridge.character.character import CharacterMesh
from engine_bridge.character.materials import preview_colors
from engine_bridge.pictures.contact_sheet import write_contact_sheet
from engine_bridge.pictures.mesh_picture import render
from engine_bridge.pictures.view import View, project
from engine_bridge.puppet.puppet import HandleTable, LimbTable, Puppet

VIEWS = {"from the front, it looks at you": (25.0, 12.0), "from its left, it looks to the left": (100.0, 8.0)}
"""Title of each view, and the camera's azimuth and elevation in degrees."""
SIZE = (840, 560)
"""Width and height of each view, in pixels; the space beside the character is for labels."""
HANDLE_RADIUS, JOINT_RADIUS, BONE_WIDTH, LABEL_HEIGHT, MARGIN = 8, 5, 5, 40, 8
"""Sizes of what is drawn, in pixels."""
FADING = 0.6
"""Share of white mixed into a character with limbs, so that the bones inside are visible."""


@dataclass(frozen=True, eq=False)
class _Mark:
    """A limb or a handle in the diagram: its name, the joints that move it, and its points (k, 3)."""

    name: str
    moved_by: str
    points: NDArray[np.float64]


def draw(puppet: Puppet, character: CharacterMesh, path: Path, title: str) -> None:
    """Draw a puppet's limbs and handles on its character, as a PNG.

    Parameters
    ----------
    puppet : Puppet
    character : CharacterMesh
        The puppet's.
    path : Path
    title : str

    Raises
    ------
    OutputError
    """
    basis = puppet.character.basis
    shown = character.whole
    vertices = shown.vertices @ basis.T
    colors = preview_colors(shown)
    marks = [*map(_limb_mark, puppet.limb), *map(_handle_mark, puppet.handle)]
    images = []
    for angles in VIEWS.values():
        view = View.around(vertices, *angles)
        picture = render(vertices, shown.triangles, view, SIZE, colors)
        if puppet.limb:
            picture = np.round(picture + FADING * (255.0 - picture)).astype(np.uint8)
        image = Image.fromarray(picture)
        _label(image, [project(mark.points @ basis.T, view, SIZE)[:, :2] for mark in marks], marks)
        images.append(np.asarray(image))
    write_contact_sheet(images, list(VIEWS), len(images), path, title)


def _limb_mark(limb: LimbTable) -> _Mark:
    first, last = (" + ".join(dict.fromkeys(limb.driven_by[end])) for end in (0, -1))
    return _Mark(limb.name, f"{first} … {last}", np.array(limb.points, dtype=np.float64))


def _handle_mark(handle: HandleTable) -> _Mark:
    return _Mark(handle.name, " + ".join(handle.driven_by) or "stays", np.array([handle.position], dtype=np.float64))


def _label(image: Image.Image, places: list[NDArray[np.float64]], marks: list[_Mark]) -> None:
    """Draw each mark, even inside the mesh, and a line from its end to its label at the nearer side."""
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
        pen.line([(x, y) for x, y in place.tolist()], color, BONE_WIDTH)
        radius = JOINT_RADIUS if len(place) > 1 else HANDLE_RADIUS
        for x, y in place.tolist():
            pen.ellipse((x - radius, y - radius, x + radius, y + radius), color, (255, 255, 255), 2)


def _apart(heights: NDArray[np.float64]) -> list[float]:
    """Return heights of labels, sorted from the top, so that none covers another and all are inside the image."""
    slots = LABEL_HEIGHT * np.arange(len(heights))
    lowered = np.maximum.accumulate(heights - slots) + slots
    highest = LABEL_HEIGHT / 2 + slots
    lowest = SIZE[1] - LABEL_HEIGHT / 2 - slots[::-1]
    placed: list[float] = np.clip(lowered, highest, np.maximum(lowest, highest)).tolist()
    return placed


def _color(index: int, count: int) -> tuple[int, int, int]:
    red, green, blue = colorsys.hsv_to_rgb(index / count, 0.85, 0.72)
    return round(255 * red), round(255 * green), round(255 * blue)
