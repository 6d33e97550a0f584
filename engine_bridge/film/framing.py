"""Framing: where the cameras of a film are, so that what they show stays in the picture."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.film.scene import CameraTable
from engine_bridge.pictures.camera import Camera, axes_towards

HEAD_ROOM, SIDE_ROOM = 0.09, 0.06
"""Free shares of the picture above and below, and beside what a camera shows."""

FOLLOWING_SECONDS = 0.7
"""Time constant with which a camera follows, in seconds: the standard deviation of a Gaussian filter."""

AZIMUTHS, SHOULDER_AZIMUTHS = (15.0, -15.0, 30.0, -30.0, 45.0, -45.0, 60.0, -60.0), (18.0, -18.0, 28.0, -28.0)
"""Directions in degrees, of which the first one with the best view is used if a camera has none; the second list is
for shots over a shoulder."""

COMPARED_FRAMES = 12
"""Number of frames of a shot in which views are compared."""


class Extent(NamedTuple):
    """Where a character is in each of F frames, in metres.

    Attributes
    ----------
    whole : (F, 2, 3) float64
        Lower and upper corner of a box around it.
    upper : (F, 2, 3) float64
        The same around its upper half, which contains its head and raised hands.
    head : (F, 2, 3) float64
        The same around its head.
    """

    whole: NDArray[np.float64]
    upper: NDArray[np.float64]
    head: NDArray[np.float64]

    def part(self, frames: slice) -> "Extent":
        """Return some of the frames."""
        return Extent(*(boxes[frames] for boxes in self))


class View(NamedTuple):
    """What is seen of a frame: by which camera, in which shot, from 0 on, and its share during a cross-fade."""

    camera: Camera
    shot: int
    share: float


class Shots:
    """The cameras of a film.

    Parameters
    ----------
    tables : sequence of CameraTable
        In the order of their times; none for one wide shot.
    extents : mapping of str to Extent
        Of each character.
    fps : float
    size : tuple of 2 ints
        Width and height of the picture; only their ratio counts.
    """

    def __init__(
        self, tables: Sequence[CameraTable], extents: Mapping[str, Extent], fps: float, size: tuple[int, int]
    ) -> None:
        tables = tables or (CameraTable(),)
        self._begins = np.array([round(table.at * fps) for table in tables])
        self._fades = [0, *(round(table.fade * fps) for table in tables[1:])]
        frames = len(next(iter(extents.values())).whole)
        ends = [begin + fade for begin, fade in zip(self._begins[1:], self._fades[1:], strict=True)]
        # the first camera is there from the beginning
        parts = [
            slice(min(begin, frames - 1), max(min(end, frames), begin + 1))
            for begin, end in zip([0, *self._begins[1:]], [*ends, frames], strict=True)
        ]
        self._shots = [
            _best_shot(table, {name: each.part(part) for name, each in extents.items()}, part.start, fps, size)
            for table, part in zip(tables, parts, strict=True)
        ]

    def views(self, frame: int) -> list[View]:
        """Return the view of a frame, or during a cross-fade both."""
        number = max(int(np.searchsorted(self._begins, frame, side="right")) - 1, 0)
        into, fade = frame - self._begins[number], self._fades[number]
        share = float(min((into + 1) / (fade + 1), 1.0)) if into < fade else 1.0
        shares = {number: share} if share == 1 else {number - 1: 1 - share, number: share}
        return [View(self._shots[shot].camera(frame), shot, share) for shot, share in shares.items()]


class _Shot:
    """One camera, in some frames."""

    def __init__(
        self, table: CameraTable, extents: Mapping[str, Extent], first: int, fps: float, size: tuple[int, int]
    ) -> None:
        behind = _behind(table, extents)
        names = [name for name in extents if (name in table.show or not table.show) and name != behind]
        self._first, self._field = first, table.field_of_view
        self.shown, self.others = names, [name for name in extents if name not in names]
        boxes = [extents[name].upper if table.shot == "close" else extents[name].whole for name in names]
        if behind is not None:
            boxes.append(extents[behind].upper)
        shown = np.stack(boxes)
        low, high = shown[:, :, 0].min(axis=0), shown[:, :, 1].max(axis=0)
        middle = (low + high) / 2
        self._way = np.zeros_like(middle)
        if table.shot in ("follow", "close"):
            self._way = scipy.ndimage.gaussian_filter1d(middle, FOLLOWING_SECONDS * fps, axis=0, mode="nearest")
            if table.shot == "follow":
                self._way[:, 1] = 0  # the camera does not nod with every step
        azimuth = table.azimuth or 0.0
        if table.shot == "over the shoulder":
            azimuth += 180.0 if behind is None else _direction(_middle(extents[behind]) - middle.mean(axis=0))
        self.towards = _towards(azimuth, table.elevation)
        corners = np.concatenate([_corners(box - self._way[:, None]) for box in shown])
        self._target, self._eye = framed(corners, self.towards, table.field_of_view, size, table.zoom)

    def camera(self, frame: int) -> Camera:
        way = self._way[min(max(frame - self._first, 0), len(self._way) - 1)]
        return Camera(self._eye + way, self._target + way, self._field)


def _best_shot(
    table: CameraTable, extents: Mapping[str, Extent], first: int, fps: float, size: tuple[int, int]
) -> _Shot:
    """Return a shot from the given direction, or from the first one in which others are least in the way."""
    if table.azimuth is not None:
        return _Shot(table, extents, first, fps, size)
    shots = []
    for azimuth in SHOULDER_AZIMUTHS if table.shot == "over the shoulder" else AZIMUTHS:
        shots.append(_Shot(table.model_copy(update={"azimuth": azimuth}), extents, first, fps, size))
        if not shots[-1].others:
            break
    return min(shots, key=lambda shot: _flaws(shot, extents, first, size))


def _flaws(shot: _Shot, extents: Mapping[str, Extent], first: int, size: tuple[int, int]) -> float:
    """Return in how many frames others are in front of what is shown, or have a head that the picture's edge cuts."""
    count, flaws = len(next(iter(extents.values())).whole), 0.0
    for frame in np.unique(np.linspace(0, count - 1, COMPARED_FRAMES).astype(int)):
        camera = shot.camera(first + frame)
        rectangles = [rectangle(camera, extents[name].whole[frame], size) for name in shot.shown]
        near = min(_depth(camera, extents[name].whole[frame]) for name in shot.shown)
        for name in shot.others:
            body, head = (rectangle(camera, box[frame], size) for box in (extents[name].whole, extents[name].head))
            inside = float(np.prod(np.maximum(np.minimum(head[1], 1) - np.maximum(head[0], -1), 0)))
            flaws += 0 < inside < 0.999 * float(np.prod(head[1] - head[0]))
            if _depth(camera, extents[name].whole[frame]) < near:
                flaws += sum(_covered(each, body) for each in rectangles)
    return flaws


def _covered(area: NDArray[np.float64], cover: NDArray[np.float64]) -> float:
    """Return the share of a rectangle that another one covers, both with a lower and an upper corner (2, 2)."""
    common = np.maximum(np.minimum(area[1], cover[1]) - np.maximum(area[0], cover[0]), 0)
    return float(np.prod(common) / max(np.prod(area[1] - area[0]), np.finfo(float).tiny))


def rectangle(camera: Camera, box: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float64]:
    """Return the upper left and lower right corner (2, 2) that a box (2, 3) has in a picture, which is from -1 to 1."""
    clip = np.pad(_corners(box[None]), ((0, 0), (0, 1)), constant_values=1) @ camera.matrix(size).astype(np.float64)
    places = clip[:, :2] / np.maximum(clip[:, 3:], 1e-3)
    return np.array([places.min(axis=0), places.max(axis=0)])


def _depth(camera: Camera, box: NDArray[np.float64]) -> float:
    """Return how far a box (2, 3) is from the eye."""
    return float(np.linalg.norm(box.mean(axis=0) - camera.eye))


def _behind(table: CameraTable, extents: Mapping[str, Extent]) -> str | None:
    """Return the character over whose shoulder a shot looks; None for other shots, and for a character alone."""
    others = [name for name in extents if name not in table.show]
    if table.shot != "over the shoulder" or len(extents) < 2 or not others:
        return None
    shown = np.mean([_middle(extents[name]) for name in extents if name in table.show or not table.show], axis=0)
    return table.behind or min(others, key=lambda name: float(np.linalg.norm(_middle(extents[name]) - shown)))


def _middle(extent: Extent) -> NDArray[np.float64]:
    middle: NDArray[np.float64] = extent.whole.mean(axis=(0, 1))
    return middle


def _direction(way: NDArray[np.float64]) -> float:
    """Return the azimuth of a direction (3,), in degrees."""
    return float(np.degrees(np.arctan2(way[0], way[2])))


def _towards(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Return the unit vector (3,) from what is shown towards the camera, for angles in degrees."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])


def _corners(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the eight corners (8 n, 3) of boxes (n, 2, 3)."""
    return np.concatenate([boxes[:, bits, range(3)] for bits in product((0, 1), repeat=3)])


def framed(
    points: NDArray[np.float64],
    towards: NDArray[np.float64],
    field_of_view: float,
    size: tuple[int, int],
    zoom: float = 1.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the target and the eye of the nearest camera that shows all points, with room around them.

    In the camera's axes, with the target at depth 0 and the eye at distance d, a point is in the picture if
    |x - c| ≤ (d - z) t with the tangent t of half the angle. Each side gives a linear bound on c and d, so the
    nearest camera follows from the extremes of x ± z t.

    Parameters
    ----------
    points : (n, 3) float64
    towards : (3,) float64
        Unit vector from the target to the eye.
    field_of_view : float
        Vertical angle, degrees.
    size : tuple of 2 ints
        Width and height of the picture.
    zoom : float
        By how much nearer the camera is than that.

    Returns
    -------
    target, eye : (3,) float64
    """
    axes = axes_towards(towards)
    origin = (points.min(axis=0) + points.max(axis=0)) / 2
    x, y, z = axes @ (points - origin).T
    up = np.tan(np.radians(field_of_view) / 2)
    center_x, distance_x = _nearest(x, z, up * size[0] / size[1] * (1 - 2 * SIDE_ROOM))
    center_y, distance_y = _nearest(y, z, up * (1 - 2 * HEAD_ROOM))
    distance = max(distance_x, distance_y, float(z.max()) + 1e-3) / zoom
    target = origin + center_x * axes[0] + center_y * axes[1]
    return target, target + distance * axes[2]


def _nearest(x: NDArray[np.float64], z: NDArray[np.float64], slope: float) -> tuple[float, float]:
    """Return the centre and the distance of the nearest camera along one axis of the picture."""
    high, low = float((x + slope * z).max()), float((x - slope * z).min())
    return (high + low) / 2, (high - low) / (2 * slope)
