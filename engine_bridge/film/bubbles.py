"""Speech bubbles, thoughts and names: what is written beside a character, wherever it is in the picture."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from engine_bridge.film.overlays import fading
from engine_bridge.film.scene import BubbleTable, Scene
from engine_bridge.film.typeface import typeface
from puppetline.errors import at

LETTERS_PER_LINE = 18
"""Number of letters after which a line of a bubble ends, if a word does."""

PADDING, DISTANCE, MARGIN = 0.7, 1.2, 0.5
"""Space around the text, between a bubble and a head, and at the picture's edges, in letter heights."""

PAPER, INK = (255, 255, 255, 245), (28, 30, 38, 255)

SUPERSAMPLING = 2

FADE_SECONDS = 0.15


class BubblePlace(NamedTuple):
    """Where a bubble is in the picture, in pixels: its middle (2,) and the tip of its tail (2,)."""

    middle: NDArray[np.float64]
    tip: NDArray[np.float64]


class Bubble:
    """A table ``[[bubble]]``, ready to be drawn.

    Parameters
    ----------
    table : BubbleTable
    size : tuple of 2 ints
        Of the frame, in pixels.
    where : str
        The table, for errors.
    folder : Path
        Of the scene file.

    Attributes
    ----------
    lines : list of tuple of str and float
        The lines of its text, and their widths in pixels.
    letter : float
        Height of its letters, in pixels.
    half : (2,) float64
        Half of its width and height without the tail, in pixels.

    Raises
    ------
    SceneError
        The typeface cannot be opened, or has no such letters.
    """

    def __init__(self, table: BubbleTable, size: tuple[int, int], where: str, folder: Path) -> None:
        self.table, self._size = table, np.array(size)
        text = wrapped(table.text or table.character)
        self.letter = max(table.size * size[1], 4.0)
        font = typeface(table.font, text, round(self.letter * SUPERSAMPLING), where, folder)
        self.lines = [(line, font.getlength(line) / SUPERSAMPLING) for line in text.split("\n")]
        left, top, right, bottom = ImageDraw.Draw(Image.new("L", (1, 1))).multiline_textbbox((0, 0), text, font)
        self._text = Image.new("L", (round(right - left), round(bottom - top)))
        ImageDraw.Draw(self._text).multiline_text((-left, -top), text, 255, font, align="center")
        padding = 0.35 if table.kind == "name" else PADDING
        self.half = (np.array(self._text.size) / SUPERSAMPLING + 2 * padding * self.letter) / 2

    def opacity(self, time: float) -> float:
        """Return how visible it is at a time of the film, from 0 to 1."""
        return fading(time, self.table.at, self.table.seconds, FADE_SECONDS)

    def place(self, head: NDArray[np.float64], body: NDArray[np.float64], usual: NDArray[np.float64]) -> BubblePlace:
        """Return where it is: beside a head, or below a body.

        Parameters
        ----------
        head, body : (2, 2) float64
            Upper left and lower right corner in the picture, in pixels.
        usual : (2, 2) float64
            Mean of `head` in the shot, which decides the side, so that the bubble does not jump.
        """
        middle = self._middle(head, body, usual)
        nearest = np.clip(middle, head[0], head[1])
        towards = np.clip(nearest, -self.letter, self._size + self.letter)  # of a head outside the picture, its edge
        return BubblePlace(middle, middle + (towards - middle) * 0.96)

    def draw(self, place: BubblePlace) -> tuple[NDArray[np.uint8], tuple[float, float, float, float]]:
        """Draw it at a place.

        Returns
        -------
        pixels : (h, w, 4) uint8
        edges : tuple of 4 floats
            Left, upper, right and lower edge, as shares of the picture.
        """
        middle, tip = place
        corners = [middle - self.half, middle + self.half]
        low, high = corners[0], corners[1]
        if self.table.kind != "name":
            low, high = np.minimum(low, tip), np.maximum(high, tip)
        border = 0.6 * self.letter
        low, high = np.floor(low - border), np.ceil(high + border)
        image = Image.new("RGBA", tuple(((high - low) * SUPERSAMPLING).astype(int).tolist()), (*PAPER[:3], 0))
        pen, scale = ImageDraw.Draw(image), SUPERSAMPLING
        box = [*((corners[0] - low) * scale).tolist(), *((corners[1] - low) * scale).tolist()]
        at, point = (middle - low) * scale, (tip - low) * scale
        line = max(0.06 * self.letter * scale, 1.0)
        if self.table.kind == "name":
            pen.rounded_rectangle(box, 0.5 * self.letter * scale, (*INK[:3], 170))
        else:
            for width, color in ((line, INK), (0.0, PAPER)):  # one outline around all shapes
                self._outline(pen, box, at, point, width, color)
        color = PAPER if self.table.kind == "name" else INK
        corner = np.rint(at - np.array(self._text.size) / 2).astype(int)
        image.paste(color, (int(corner[0]), int(corner[1])), self._text)
        share = np.concatenate([low, high]) / [*self._size, *self._size]
        return np.asarray(image.reduce(SUPERSAMPLING)), (share[0], share[1], share[2], share[3])

    def _outline(
        self,
        pen: ImageDraw.ImageDraw,
        box: list[float],
        at: NDArray[np.float64],
        tip: NDArray[np.float64],
        width: float,
        color: tuple[int, int, int, int],
    ) -> None:
        """Fill the shape of a bubble and its tail, wider by a line's width."""
        left, top, right, bottom = box
        letter = self.letter * SUPERSAMPLING
        if self.table.kind == "speech":
            pen.rounded_rectangle([left - width, top - width, right + width, bottom + width], letter + width, color)
            along = (tip - at) / max(float(np.linalg.norm(tip - at)), 1e-9)
            across = np.array([-along[1], along[0]]) * (0.45 * letter + width)
            pen.polygon([*map(tuple, (at + across, tip + width * along, at - across))], color)
            return
        r = 0.75 * letter
        inside = [left + r / 2, top + r / 2, right - r / 2, bottom - r / 2]
        pen.rounded_rectangle(inside, r / 2, color)
        for x in np.linspace(inside[0], inside[2], max(round((inside[2] - inside[0]) / letter), 2)):
            for y in (inside[1], inside[3]):
                _disc(pen, x, y, r + width, color)
        for y in np.linspace(inside[1], inside[3], max(round((inside[3] - inside[1]) / letter), 2)):
            for x in (inside[0], inside[2]):
                _disc(pen, x, y, r + width, color)
        edge = np.clip(tip, [left, top], [right, bottom])
        for share, size in ((0.45, 0.3), (0.75, 0.2), (1.0, 0.12)):
            x, y = edge + share * (tip - edge)
            _disc(pen, x, y, size * letter + width, color)

    def _middle(
        self, head: NDArray[np.float64], body: NDArray[np.float64], usual: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the middle of the bubble: above the head, else beside it where there is more room; in the picture."""
        gap, room = DISTANCE * self.letter, self.half + MARGIN * self.letter
        center = head.mean(axis=0)
        if self.table.kind == "name":
            middle = np.array([body[:, 0].mean(), body[1, 1] + self.half[1]])
        elif usual[0, 1] - gap - self.half[1] >= room[1]:
            middle = np.array([center[0], head[0, 1] - gap - self.half[1]])
        elif usual[:, 0].mean() < self._size[0] / 2:
            middle = np.array([head[1, 0] + gap + self.half[0], center[1] - gap])
        else:
            middle = np.array([head[0, 0] - gap - self.half[0], center[1] - gap])
        shown: NDArray[np.float64] = np.clip(middle, room, np.maximum(self._size - room, room))
        return shown


def bubbles_of(scene: Scene, size: tuple[int, int], path: Path) -> list[Bubble]:
    """Return the bubbles of a scene file for a size of frames.

    Raises
    ------
    SceneError
        A typeface cannot be opened, or has no such letters.
    """
    return [
        Bubble(table, size, at(path, field=f"[[bubble]] {number}"), path.parent)
        for number, table in enumerate(scene.bubble, 1)
    ]


def wrapped(text: str) -> str:
    """Return a text with line breaks between words."""
    lines = [""]
    for word in text.split(" "):
        if lines[-1] and len(f"{lines[-1]} {word}") > LETTERS_PER_LINE:
            lines.append(word)
        else:
            lines[-1] = f"{lines[-1]} {word}".strip(" ")
    return "\n".join(lines)


def _disc(pen: ImageDraw.ImageDraw, x: float, y: float, r: float, color: tuple[int, int, int, int]) -> None:
    pen.ellipse([x - r, y - r, x + r, y + r], color)
