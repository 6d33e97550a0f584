"""A picture of what is seen of a source: what the sensor sees with the skeletons on it, and why nothing moves.

Pictures are not mirrored: a performer's right hand is on their left. Sources without pictures are drawn from where the
sensor would be and from above, on a grid of half a metre.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from capture.sensors.picture import Picture
from capture.sensors.sight import Performer, Reason, Sight, told
from capture.skeleton import JOINT_INDEX, PARENTS

HEIGHT = 480
"""Of a panel, pixels."""
GRID = 0.5
"""Metres."""

PAPER, PANEL, LINES, INK, FAINT = (22, 24, 28), (34, 37, 43), (58, 63, 72), (232, 234, 238), (150, 156, 166)
GUESSED, AMISS, WELL = (255, 170, 40), (255, 112, 92), (120, 220, 130)
PERFORMERS = ((86, 196, 255), (255, 130, 190), (160, 230, 110), (200, 160, 255))

_FINE = 2  # pixels that are drawn for each one of the picture, along an edge
_GAP = 12
_LEAST = 1.0  # metres around somebody that a panel shows at least
_Color = tuple[int, int, int]


@dataclass(frozen=True)
class _View:
    """Where positions are in a panel: `axes` (2, 3) metres to pixels right and down, `offset` (2,) pixels."""

    axes: NDArray[np.float64]
    offset: NDArray[np.float64]

    def project(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        pixels: NDArray[np.float64] = positions @ self.axes.T + self.offset
        return pixels


def draw(sight: Sight, reasons: Sequence[Reason]) -> Image.Image:
    """Draw what was seen: panels side by side, and what is to be said about it below them."""
    panels = list(_panels(sight))
    width = sum(panel.width + _GAP for panel in panels) + _GAP
    words = _words(sight, reasons, width - 2 * _GAP)
    whole = Image.new("RGB", (width, HEIGHT + words.height + 3 * _GAP), PAPER)
    left = _GAP
    for panel in panels:
        whole.paste(panel, (left, _GAP))
        left += panel.width + _GAP
    whole.paste(words, (_GAP, HEIGHT + 2 * _GAP))
    return whole


def shaded(depth: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return depth as a picture: near is light, slopes are darker, and what is not known is violet.

    Parameters
    ----------
    depth : (height, width) uint16
        Millimetres.

    Returns
    -------
    (height, width, 3) uint8
    """
    metres = depth / 1000.0
    down, right = np.gradient(metres)
    facing = 1 / np.sqrt(1 + (100 * right) ** 2 + (100 * down) ** 2)
    light = np.clip(1.15 - metres / 5, 0.15, 1) * (0.35 + 0.65 * facing)
    grey = np.repeat((255 * light).astype(np.uint8)[..., None], 3, axis=2)
    grey[depth == 0] = (52, 26, 66)
    return grey


def _panels(sight: Sight) -> Iterable[Image.Image]:
    performers = list(sight.performers.values())
    picture = sight.picture
    if picture is None:
        yield _front(performers)
    else:
        if picture.color is not None:
            yield _seen(picture, picture.color, performers, "colour")
        if picture.depth is not None:
            yield _seen(picture, shaded(picture.depth), performers, "depth, violet where there is none")
    yield _above(performers, "origin" if sight.listens else "sensor")


def _seen(picture: Picture, pixels: NDArray[np.uint8], performers: list[Performer], title: str) -> Image.Image:
    width = round(HEIGHT * picture.lens.width / picture.lens.height)
    panel = Image.fromarray(pixels).resize((width * _FINE, HEIGHT * _FINE), Image.Resampling.BILINEAR)
    scale = HEIGHT * _FINE / picture.lens.height
    pen = ImageDraw.Draw(panel)
    for performer in performers:
        before = performer.newest.positions[:, 2] > 0
        positions = np.where(before[:, None], performer.newest.positions, 1.0)
        _skeleton(pen, picture.lens.project(positions) * scale, performer, performer.known() & before)
    return _finished(panel, title)


def _front(performers: list[Performer]) -> Image.Image:
    """Draw performers as somebody at the sensor sees them, with their heights above the lowest foot."""
    low, high = _extent(performers, with_origin=False)
    view = _view(low, high, [[-1, 0, 0], [0, -1, 0]])
    panel = Image.new("RGB", (HEIGHT * _FINE, HEIGHT * _FINE), PANEL)
    pen = ImageDraw.Draw(panel)
    floor = float(low[1])
    for line in range(-20, 21):
        across = view.project(np.array([line * GRID, 0, 0]))[0]
        pen.line([across, 0, across, panel.height], LINES, _FINE)
    for line in range(20):
        down = view.project(np.array([0, floor + line * GRID, 0]))[1]
        pen.line([0, down, panel.width, down], FAINT if line == 0 else LINES, _FINE)
        pen.text((6 * _FINE, down - 2), f"{line * GRID:g} m", FAINT, _font(11 * _FINE), anchor="ls")
    for performer in performers:
        _skeleton(pen, view.project(performer.newest.positions), performer, performer.known())
    return _finished(panel, "from the front, their right hand on your left")


def _above(performers: list[Performer], origin: str) -> Image.Image:
    """Draw performers from above, the sensor below them."""
    low, high = _extent(performers, with_origin=True)
    view = _view(low, high, [[-1, 0, 0], [0, 0, -1]])
    panel = Image.new("RGB", (HEIGHT * _FINE, HEIGHT * _FINE), PANEL)
    pen = ImageDraw.Draw(panel)
    for line in range(-40, 41):
        across, down = view.project(np.array([line * GRID, 0, line * GRID]))
        pen.line([across, 0, across, panel.height], LINES, _FINE)
        pen.line([0, down, panel.width, down], LINES, _FINE)
        if line % 2 == 0:
            pen.text((6 * _FINE, down - 2), f"{line * GRID:g} m", FAINT, _font(11 * _FINE), anchor="ls")
    x, y = view.project(np.zeros(3))
    pen.polygon([(x, y - 9 * _FINE), (x - 8 * _FINE, y + 6 * _FINE), (x + 8 * _FINE, y + 6 * _FINE)], FAINT)
    pen.text((x + 14 * _FINE, y), origin, FAINT, _font(12 * _FINE), anchor="lm")
    for performer in performers:
        _skeleton(pen, view.project(performer.newest.positions), performer, performer.known())
    return _finished(panel, "from above")


def _extent(performers: list[Performer], *, with_origin: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (3,) lowest and highest positions of everybody; of an empty room, somewhat before the sensor."""
    points = [performer.newest.positions[performer.known()] for performer in performers]
    if not any(map(len, points)):
        points.append(np.array([[0.0, 0, 0], [0, 1.8, 3]]))
    if with_origin:
        points.append(np.zeros((1, 3)))
    everybody = np.concatenate(points)
    return everybody.min(axis=0), everybody.max(axis=0)


def _view(low: NDArray[np.float64], high: NDArray[np.float64], axes: list[list[int]]) -> _View:
    """Show all between two corners in a square panel."""
    directions = np.array(axes, float)
    size = np.abs(directions) @ (high - low)
    scale = HEIGHT * _FINE / (1.3 * max(float(size.max()), _LEAST))
    middle = directions @ ((low + high) / 2)
    return _View(directions * scale, HEIGHT * _FINE / 2 - middle * scale)


def _skeleton(
    pen: ImageDraw.ImageDraw, pixels: NDArray[np.float64], performer: Performer, shown: NDArray[np.bool_]
) -> None:
    """Draw bones in the performer's colour, or in that of a guess."""
    color = PERFORMERS[performer.newest.user % len(PERFORMERS)]
    seen = performer.seen()
    places = [(float(x), float(y)) for x, y in pixels]
    for child, parent in PARENTS.items():
        a, b = JOINT_INDEX[child], JOINT_INDEX[parent]
        if shown[a] and shown[b]:
            pen.line([places[a], places[b]], PAPER, 6 * _FINE)
            pen.line([places[a], places[b]], color if seen[a] and seen[b] else GUESSED, 3 * _FINE)
    for name, index in JOINT_INDEX.items():
        if shown[index]:
            x, y = places[index]
            r = (7 if name == "head" else 4) * _FINE
            pen.ellipse([x - r, y - r, x + r, y + r], color if seen[index] else GUESSED, PAPER, _FINE)
    labels = {"hand_left": ("left", 8, 0, "lm"), "hand_right": ("right", -8, 0, "rm")}
    labels["head"] = f"user {performer.newest.user}", 0, -10, "mb"
    for name, (text, right, down, anchor) in labels.items():
        if shown[JOINT_INDEX[name]]:
            x, y = places[JOINT_INDEX[name]]
            place = x + right * _FINE, y + down * _FINE
            pen.text(place, text, color, _font(13 * _FINE), anchor=anchor, stroke_width=_FINE, stroke_fill=PAPER)


def _finished(panel: Image.Image, title: str) -> Image.Image:
    pen = ImageDraw.Draw(panel)
    font = _font(13 * _FINE)
    pen.rectangle([0, 0, font.getlength(title) + 16 * _FINE, 24 * _FINE], PAPER)
    pen.text((8 * _FINE, 12 * _FINE), title, INK, font, anchor="lm")
    return panel.resize((panel.width // _FINE, panel.height // _FINE), Image.Resampling.BOX)


def _words(sight: Sight, reasons: Sequence[Reason], width: int) -> Image.Image:
    """Write who is seen how well, and why nothing moves."""
    lines: list[tuple[str, _Color, int]] = []
    headline = reasons[0].what if reasons else "All is well."
    lines += [(line, AMISS if reasons else WELL, 20) for line in _wrapped(headline, 20, width)]
    for number, reason in enumerate(reasons):
        if number:
            lines += [(line, AMISS, 15) for line in _wrapped(reason.what, 15, width)]
        lines += [(line, INK, 15) for line in _wrapped(reason.fix, 15, width)]
    lines += [(told(performer), FAINT, 14) for _, performer in sorted(sight.performers.items())]
    if any((each.known() & ~each.seen()).any() for each in sight.performers.values()):
        lines.append(("orange: joints that are guessed", GUESSED, 14))
    lines += [(line, FAINT, 14) for line in _wrapped(f"{sight.source}, {sight.seconds:.1f} s", 14, width)]
    paper = Image.new("RGB", (width, sum(size + 8 for _, _, size in lines)), PAPER)
    pen = ImageDraw.Draw(paper)
    top = 0
    for line, color, size in lines:
        pen.text((0, top + size), line, color, _font(size), anchor="ls")
        top += size + 8
    return paper


def _wrapped(text: str, size: int, width: int) -> list[str]:
    """Break a text between words into lines that are not wider than so many pixels."""
    font, lines = _font(size), [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return [line for line in lines if line]


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
