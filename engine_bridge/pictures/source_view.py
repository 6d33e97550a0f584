"""A picture of what is seen of a source: what the sensor sees with the skeletons on it, and why nothing moves.

Pictures are not mirrored: a performer's right hand is on their left. Sources without pictures are drawn from where the
sensor would be and from above, on a grid of half a metre.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from capture.sensors.source_report import Performer, Reason, Sight, told
from capture.skeleton import JOINT_INDEX, PARENTS
from capture.trackers.picture import Picture

HEIGHT = 480
"""Of a panel, pixels."""
PAPER, PANEL, LINES, INK, FAINT = (22, 24, 28), (34, 37, 43), (58, 63, 72), (232, 234, 238), (150, 156, 166)
GUESSED, AMISS, WELL = (255, 170, 40), (255, 112, 92), (120, 220, 130)
PERFORMERS = ((86, 196, 255), (255, 130, 190), (160, 230, 110), (200, 160, 255))

_GAP = 12
_LEAST = 1.0  # metres around somebody that a panel shows at least
_FINE = 2  # pixels that are drawn for each one of a panel, along an edge
_BONE, _EDGE = 3, 1.5  # widths of a bone, and of the dark on either side of it, pixels
_JOINT, _HEAD, _RIM = 4, 7, 1  # radii, and the width of the dark around them
_GRID = 0.5  # metres from line to line where there is no picture
_MARGIN = 1.3  # how much larger a view is than what is in it
_Color = tuple[int, int, int]
_Place = Sequence[float] | NDArray[np.float64]


@dataclass(frozen=True)
class _View:
    """Where positions are in a panel: `axes` (2, 3) metres to pixels right and down, `offset` (2,) pixels."""

    axes: NDArray[np.float64]
    offset: NDArray[np.float64]

    def project(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        pixels: NDArray[np.float64] = positions @ self.axes.T + self.offset
        return pixels


class _Panel:
    """A picture that is drawn finer than it is shown; places and lengths are pixels of what is shown.

    Parameters
    ----------
    title : str
    size : (int, int)
        Width and height.
    background : (height, width, 3) uint8, optional
        Of any size.
    """

    def __init__(self, title: str, size: tuple[int, int], background: NDArray[np.uint8] | None = None) -> None:
        self.title, self.size = title, size
        fine = size[0] * _FINE, size[1] * _FINE
        if background is None:
            self._image = Image.new("RGB", fine, PANEL)
        else:
            self._image = Image.fromarray(background).resize(fine, Image.Resampling.BILINEAR)
        self._pen = ImageDraw.Draw(self._image)

    def image(self) -> Image.Image:
        """Write the title over all that was drawn, and return it."""
        self._pen.rectangle([0, 0, _font(13 * _FINE).getlength(self.title) + 16 * _FINE, 24 * _FINE], PAPER)
        self.text((8, 12), self.title, INK, 13, "lm")
        return self._image.resize(self.size, Image.Resampling.BOX)

    def line(self, start: _Place, end: _Place, color: _Color, width: float = 1) -> None:
        """Draw a straight line."""
        self._pen.line([*self._fine(start), *self._fine(end)], color, round(width * _FINE))

    def polygon(self, places: Iterable[_Place], color: _Color) -> None:
        """Fill what is between some places."""
        self._pen.polygon([self._fine(place) for place in places], color)

    def disc(self, place: _Place, radius: float, color: _Color) -> None:
        """Draw a joint."""
        (x, y), r = self._fine(place), radius * _FINE
        self._pen.ellipse([x - r, y - r, x + r, y + r], color, PAPER, _RIM * _FINE)

    def text(self, place: _Place, text: str, color: _Color, size: int, anchor: str, stroke: int = 0) -> None:
        """Write a text."""
        font = _font(size * _FINE)
        self._pen.text(
            self._fine(place), text, color, font, anchor=anchor, stroke_width=stroke * _FINE, stroke_fill=PAPER
        )

    def _fine(self, place: _Place) -> tuple[float, float]:
        return float(place[0]) * _FINE, float(place[1]) * _FINE


def draw(sight: Sight, reasons: Sequence[Reason]) -> Image.Image:
    """Draw what was seen: panels side by side, and what is to be said about it below them."""
    images = [panel.image() for panel in _panels(sight)]
    width = sum(image.width + _GAP for image in images) + _GAP
    words = _words(sight, reasons, width - 2 * _GAP)
    whole = Image.new("RGB", (width, HEIGHT + words.height + 3 * _GAP), PAPER)
    left = _GAP
    for image in images:
        whole.paste(image, (left, _GAP))
        left += image.width + _GAP
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


def _panels(sight: Sight) -> Iterator[_Panel]:
    performers = list(sight.performers.values())
    square = HEIGHT, HEIGHT
    if sight.picture is None:
        yield _front(performers, square)
    else:
        lens = sight.picture.lens
        yield from _seen(sight.picture, performers, (round(HEIGHT * lens.width / lens.height), HEIGHT))
    yield _above(performers, sight, square)


def _seen(picture: Picture, performers: list[Performer], size: tuple[int, int]) -> Iterator[_Panel]:
    """Draw what the sensor sees: colour, depth, or both."""
    if picture.color is not None:
        yield _overlaid("colour", picture, picture.color, performers, size)
    if picture.depth is not None:
        title = "depth, violet where there is none"
        yield _overlaid(title, picture, shaded(picture.depth), performers, size)


def _overlaid(
    title: str,
    picture: Picture,
    pixels: NDArray[np.uint8],
    performers: list[Performer],
    size: tuple[int, int],
) -> _Panel:
    panel = _Panel(title, size, pixels)
    scale = size[1] / picture.lens.height
    for performer in performers:
        before = performer.newest.positions[:, 2] > 0
        positions = np.where(before[:, None], performer.newest.positions, 1.0)
        _skeleton(panel, picture.lens.project(positions) * scale, performer, performer.known() & before)
    return panel


def _front(performers: list[Performer], size: tuple[int, int]) -> _Panel:
    """Draw performers as somebody at the sensor sees them, with their heights above the lowest foot."""
    panel = _Panel("from the front, their right hand on your left", size)
    low, high = _extent(performers)
    view = _view(low, high, [[-1, 0, 0], [0, -1, 0]], panel)
    floor = float(low[1])
    for line in range(-20, 21):
        across = view.project(np.array([line * _GRID, 0, 0]))[0]
        panel.line((across, 0), (across, size[1]), LINES)
    for line in range(20):
        down = view.project(np.array([0, floor + line * _GRID, 0]))[1]
        panel.line((0, down), (size[0], down), FAINT if line == 0 else LINES)
        panel.text((6, down - 1), f"{line * _GRID:g} m", FAINT, 11, "ls")
    for performer in performers:
        _skeleton(panel, view.project(performer.newest.positions), performer, performer.known())
    return panel


def _above(performers: list[Performer], sight: Sight, size: tuple[int, int]) -> _Panel:
    """Draw performers from above, the sensor below them."""
    panel = _Panel("from above", size)
    low, high = _extent(performers, [[0, 0, 0]])
    view = _view(low, high, [[-1, 0, 0], [0, 0, -1]], panel)
    for line in range(-40, 41):
        across, down = view.project(np.array([line * _GRID, 0, line * _GRID]))
        panel.line((across, 0), (across, size[1]), LINES)
        panel.line((0, down), (size[0], down), LINES)
        if line % 2 == 0:
            panel.text((6, down - 1), f"{line * _GRID:g} m", FAINT, 11, "ls")
    x, y = view.project(np.zeros(3))
    r = _HEAD
    panel.polygon([(x, y - 1.3 * r), (x - 1.15 * r, y + 0.85 * r), (x + 1.15 * r, y + 0.85 * r)], FAINT)
    panel.text((x + 14, y), "origin" if sight.listens else "sensor", FAINT, 12, "lm")
    for performer in performers:
        _skeleton(panel, view.project(performer.newest.positions), performer, performer.known())
    return panel


def _extent(
    performers: list[Performer], others: Sequence[Sequence[float]] = ()
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (3,) lowest and highest positions of everybody and others; of an empty room, before the sensor."""
    points = [performer.newest.positions[performer.known()] for performer in performers]
    if not any(map(len, points)):
        points.append(np.array([[0.0, 0, 0], [0, 1.8, 3]]))
    everybody = np.concatenate([*points, np.reshape(others, (-1, 3))])
    return everybody.min(axis=0), everybody.max(axis=0)


def _view(low: NDArray[np.float64], high: NDArray[np.float64], axes: list[list[int]], panel: _Panel) -> _View:
    """Show all between two corners in a panel."""
    directions = np.array(axes, float)
    extent = np.maximum(np.abs(directions) @ (high - low), _LEAST)
    scale = float((np.array(panel.size) / extent).min()) / _MARGIN
    middle = directions @ ((low + high) / 2)
    return _View(directions * scale, np.array(panel.size) / 2 - middle * scale)


def _skeleton(panel: _Panel, pixels: NDArray[np.float64], performer: Performer, shown: NDArray[np.bool_]) -> None:
    """Draw bones in the performer's colour, or in that of a guess."""
    color = PERFORMERS[performer.newest.user % len(PERFORMERS)]
    seen = performer.seen()
    for child, parent in PARENTS.items():
        a, b = JOINT_INDEX[child], JOINT_INDEX[parent]
        if shown[a] and shown[b]:
            panel.line(pixels[a], pixels[b], PAPER, _BONE + 2 * _EDGE)
            panel.line(pixels[a], pixels[b], color if seen[a] and seen[b] else GUESSED, _BONE)
    for name, index in JOINT_INDEX.items():
        if shown[index]:
            panel.disc(pixels[index], _HEAD if name == "head" else _JOINT, color if seen[index] else GUESSED)
    labels = {"hand_left": ("left", 8, 0, "lm"), "hand_right": ("right", -8, 0, "rm")}
    labels["head"] = f"user {performer.newest.user}", 0, -10, "mb"
    for name, (text, right, down, anchor) in labels.items():
        if shown[JOINT_INDEX[name]]:
            panel.text(pixels[JOINT_INDEX[name]] + [right, down], text, color, 13, anchor, stroke=1)


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
    if sight.level is not None:
        lines.append((f"the sensor: {sight.level}", FAINT, 14))
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
