"""An image of a source report: what the sensor sees with the skeletons on it, and why nothing moves.

Images are not mirrored: a performer's right hand is on the viewer's left. Sources without images are drawn from the
sensor's side and from above, on a grid of half a metre.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from capture.sensors.diagnosis import Problem, describe
from capture.sensors.picture_jpeg import shaded
from capture.sensors.source_report import PerformerReport, SourceReport
from capture.skeleton import JOINT_INDEX, PARENTS
from capture.trackers.picture import Picture

PANEL_HEIGHT = 480
"""Height of a panel, in pixels."""
PAPER, PANEL, LINES, INK, FAINT = (22, 24, 28), (34, 37, 43), (58, 63, 72), (232, 234, 238), (150, 156, 166)
INFERRED_COLOR, PROBLEM_COLOR, OK_COLOR = (255, 170, 40), (255, 112, 92), (120, 220, 130)
PERFORMER_COLORS = ((86, 196, 255), (255, 130, 190), (160, 230, 110), (200, 160, 255))

_GAP = 12  # pixels between panels
_MIN_EXTENT = 1.0  # metres that a view shows at least
_SCALE = 2  # pixels drawn per pixel of a panel, along an edge
_BONE_WIDTH, _OUTLINE = 3, 1.5  # pixels: width of a bone, and of the dark outline on either side
_JOINT_RADIUS, _HEAD_RADIUS, _RIM = 4, 7, 1  # pixels; the last is the width of the dark rim
_GRID = 0.5  # metres between grid lines
_MARGIN = 1.3  # size of a view relative to its content
_Color = tuple[int, int, int]
_Place = Sequence[float] | NDArray[np.float64]


@dataclass(frozen=True)
class _Projection:
    """A parallel projection: `axes` (2, 3) pixels right and down per metre, `offset` (2,) pixels."""

    axes: NDArray[np.float64]
    offset: NDArray[np.float64]

    def project(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        pixels: NDArray[np.float64] = positions @ self.axes.T + self.offset
        return pixels


class _Panel:
    """An image that is drawn larger and then reduced; coordinates and lengths are pixels of the reduced image.

    Parameters
    ----------
    title : str
    size : (int, int)
        Width and height, in pixels.
    background : (height, width, 3) uint8, optional
        Any size; it is scaled.
    """

    def __init__(self, title: str, size: tuple[int, int], background: NDArray[np.uint8] | None = None) -> None:
        self.title, self.size = title, size
        scaled = size[0] * _SCALE, size[1] * _SCALE
        if background is None:
            self._image = Image.new("RGB", scaled, PANEL)
        else:
            self._image = Image.fromarray(background).resize(scaled, Image.Resampling.BILINEAR)
        self._pen = ImageDraw.Draw(self._image)

    def image(self) -> Image.Image:
        """Write the title on top, and return the reduced image."""
        self._pen.rectangle([0, 0, _font(13 * _SCALE).getlength(self.title) + 16 * _SCALE, 24 * _SCALE], PAPER)
        self.text((8, 12), self.title, INK, 13, "lm")
        return self._image.resize(self.size, Image.Resampling.BOX)

    def line(self, start: _Place, end: _Place, color: _Color, width: float = 1) -> None:
        self._pen.line([*self._scaled(start), *self._scaled(end)], color, round(width * _SCALE))

    def polygon(self, places: Iterable[_Place], color: _Color) -> None:
        self._pen.polygon([self._scaled(place) for place in places], color)

    def disc(self, place: _Place, radius: float, color: _Color) -> None:
        (x, y), r = self._scaled(place), radius * _SCALE
        self._pen.ellipse([x - r, y - r, x + r, y + r], color, PAPER, _RIM * _SCALE)

    def text(self, place: _Place, text: str, color: _Color, size: int, anchor: str, stroke: int = 0) -> None:
        font = _font(size * _SCALE)
        self._pen.text(
            self._scaled(place), text, color, font, anchor=anchor, stroke_width=stroke * _SCALE, stroke_fill=PAPER
        )

    def _scaled(self, place: _Place) -> tuple[float, float]:
        return float(place[0]) * _SCALE, float(place[1]) * _SCALE


def draw(report: SourceReport, problems: Sequence[Problem]) -> Image.Image:
    """Draw a report: panels side by side, and the problems as text below them."""
    images = [panel.image() for panel in _panels(report)]
    width = sum(image.width + _GAP for image in images) + _GAP
    text = _text(report, problems, width - 2 * _GAP)
    whole = Image.new("RGB", (width, PANEL_HEIGHT + text.height + 3 * _GAP), PAPER)
    left = _GAP
    for image in images:
        whole.paste(image, (left, _GAP))
        left += image.width + _GAP
    whole.paste(text, (_GAP, PANEL_HEIGHT + 2 * _GAP))
    return whole


def _panels(report: SourceReport) -> Iterator[_Panel]:
    performers = list(report.performers.values())
    picture = report.picture
    if picture is None:
        yield _front_panel(performers)
    elif picture.color is not None:
        yield _overlay("colour", picture, picture.color, performers)
    if picture is not None and picture.depth is not None:
        yield _overlay("depth, violet if unknown", picture, shaded(picture.depth), performers)
    yield _top_panel(performers, "origin" if report.listens else "sensor")


def _overlay(title: str, picture: Picture, pixels: NDArray[np.uint8], performers: list[PerformerReport]) -> _Panel:
    """Draw the performers on colours or depth of the sensor's image."""
    lens = picture.lens
    panel = _Panel(title, (round(PANEL_HEIGHT * lens.width / lens.height), PANEL_HEIGHT), pixels)
    scale = PANEL_HEIGHT / lens.height
    for performer in performers:
        in_front = performer.newest.positions[:, 2] > 0
        positions = np.where(in_front[:, None], performer.newest.positions, 1.0)
        _draw_skeleton(panel, lens.project(positions) * scale, performer, performer.known() & in_front)
    return panel


def _front_panel(performers: list[PerformerReport]) -> _Panel:
    """Draw performers as seen from the sensor, with heights above the lowest foot."""
    low, high = _bounds(performers)
    floor = np.array([0.0, low[1], 0.0])
    title = "from the front, the performer's right hand on your left"
    return _plan(title, performers, _projection(low, high, [[-1, 0, 0], [0, -1, 0]]), floor)


def _top_panel(performers: list[PerformerReport], origin: str) -> _Panel:
    """Draw performers from above, with the sensor, called `origin`, below them."""
    low, high = _bounds(performers)
    view = _projection(np.minimum(low, 0), np.maximum(high, 0), [[-1, 0, 0], [0, 0, -1]])
    panel = _plan("from above", performers, view, np.zeros(3))
    x, y = view.project(np.zeros(3))
    r = _HEAD_RADIUS
    panel.polygon([(x, y - 1.3 * r), (x - 1.15 * r, y + 0.85 * r), (x + 1.15 * r, y + 0.85 * r)], FAINT)
    panel.text((x + 14, y), origin, FAINT, 12, "lm")
    return panel


def _plan(title: str, performers: list[PerformerReport], view: _Projection, zero: NDArray[np.float64]) -> _Panel:
    """Draw performers on a grid whose distances count from the point `zero`."""
    panel = _Panel(title, (PANEL_HEIGHT, PANEL_HEIGHT))
    for line in range(-40, 41):
        across, down = view.project(zero + line * _GRID)
        panel.line((across, 0), (across, PANEL_HEIGHT), LINES)
        panel.line((0, down), (PANEL_HEIGHT, down), LINES if line else FAINT)
        if line % 2 == 0:
            panel.text((6, down - 1), f"{line * _GRID:g} m", FAINT, 11, "ls")
    for performer in performers:
        _draw_skeleton(panel, view.project(performer.newest.positions), performer, performer.known())
    return panel


def _bounds(performers: list[PerformerReport]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (3,) lowest and highest coordinates of all known joints; of an empty room without performers."""
    points = [performer.newest.positions[performer.known()] for performer in performers]
    if not any(map(len, points)):
        points.append(np.array([[0.0, 0, 0], [0, 1.8, 3]]))
    joints = np.concatenate(points)
    return joints.min(axis=0), joints.max(axis=0)


def _projection(low: NDArray[np.float64], high: NDArray[np.float64], axes: list[list[int]]) -> _Projection:
    """Return the projection along `axes` that shows everything between two corners in a square panel."""
    directions = np.array(axes, float)
    extent = np.maximum(np.abs(directions) @ (high - low), _MIN_EXTENT)
    scale = PANEL_HEIGHT / float(extent.max()) / _MARGIN
    middle = directions @ ((low + high) / 2)
    return _Projection(directions * scale, PANEL_HEIGHT / 2 - middle * scale)


def _draw_skeleton(
    panel: _Panel, pixels: NDArray[np.float64], performer: PerformerReport, shown: NDArray[np.bool_]
) -> None:
    """Draw bones and joints in the performer's colour, or in that of inferred joints."""
    color = PERFORMER_COLORS[performer.newest.user % len(PERFORMER_COLORS)]
    tracked = performer.tracked()
    for child, parent in PARENTS.items():
        a, b = JOINT_INDEX[child], JOINT_INDEX[parent]
        if shown[a] and shown[b]:
            panel.line(pixels[a], pixels[b], PAPER, _BONE_WIDTH + 2 * _OUTLINE)
            panel.line(pixels[a], pixels[b], color if tracked[a] and tracked[b] else INFERRED_COLOR, _BONE_WIDTH)
    for name, index in JOINT_INDEX.items():
        if shown[index]:
            radius = _HEAD_RADIUS if name == "head" else _JOINT_RADIUS
            panel.disc(pixels[index], radius, color if tracked[index] else INFERRED_COLOR)
    labels = {"hand_left": ("left", 8, 0, "lm"), "hand_right": ("right", -8, 0, "rm")}
    labels["head"] = f"user {performer.newest.user}", 0, -10, "mb"
    for name, (text, right, down, anchor) in labels.items():
        if shown[JOINT_INDEX[name]]:
            panel.text(pixels[JOINT_INDEX[name]] + [right, down], text, color, 13, anchor, stroke=1)


def _text(report: SourceReport, problems: Sequence[Problem], width: int) -> Image.Image:
    """Write the problems, and how well each performer is tracked."""
    lines: list[tuple[str, _Color, int]] = []
    headline = problems[0].what if problems else "No problems found."
    lines += [(line, PROBLEM_COLOR if problems else OK_COLOR, 20) for line in _wrap(headline, 20, width)]
    for number, problem in enumerate(problems):
        if number:
            lines += [(line, PROBLEM_COLOR, 15) for line in _wrap(problem.what, 15, width)]
        lines += [(line, INK, 15) for line in _wrap(problem.fix, 15, width)]
    lines += [(describe(performer), FAINT, 14) for _, performer in sorted(report.performers.items())]
    if report.sensor_tilt is not None:
        lines.append((f"the sensor: {report.sensor_tilt}", FAINT, 14))
    if any((each.known() & ~each.tracked()).any() for each in report.performers.values()):
        lines.append(("orange: inferred joints", INFERRED_COLOR, 14))
    lines += [(line, FAINT, 14) for line in _wrap(f"{report.source}, {report.seconds:.1f} s", 14, width)]
    paper = Image.new("RGB", (width, sum(size + 8 for _, _, size in lines)), PAPER)
    pen = ImageDraw.Draw(paper)
    top = 0
    for line, color, size in lines:
        pen.text((0, top + size), line, color, _font(size), anchor="ls")
        top += size + 8
    return paper


def _wrap(text: str, size: int, width: int) -> list[str]:
    """Break a text between words into lines of at most `width` pixels."""
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
