"""Framing: where the cameras of a film are, so that what they show stays in the picture."""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.film.scene import CameraTable
from engine_bridge.pictures.camera import Camera, axes_towards

HEAD_ROOM, SIDE_ROOM = 0.09, 0.06
"""Free shares of the picture above and below, and beside what a camera shows."""

FOLLOWING_SECONDS = 0.7
"""Time constant with which a camera follows, in seconds: the standard deviation of a Gaussian filter."""


class Shots:
    """The cameras of a film.

    Parameters
    ----------
    tables : sequence of CameraTable
        In the order of their times; none for one still camera.
    boxes : dict of str to (F, 2, 3) float64
        Lower and upper corners of each character in each frame, metres.
    fps : float
    size : tuple of 2 ints
        Width and height of the picture; only their ratio counts.
    """

    def __init__(
        self, tables: Sequence[CameraTable], boxes: dict[str, NDArray[np.float64]], fps: float, size: tuple[int, int]
    ) -> None:
        tables = tables or (CameraTable(),)
        self._begins = np.array([round(table.at * fps) for table in tables])
        frames = len(next(iter(boxes.values())))
        ends = [*self._begins[1:], frames]
        # the first camera is there from the beginning
        parts = [
            slice(min(begin, frames - 1), max(end, begin + 1)) for begin, end in zip([0, *ends[:-1]], ends, strict=True)
        ]
        self._cameras = [_Shot(table, boxes, part, fps, size) for table, part in zip(tables, parts, strict=True)]

    def camera(self, frame: int) -> Camera:
        """Return the camera at a frame."""
        return self._cameras[max(int(np.searchsorted(self._begins, frame, side="right")) - 1, 0)].camera(frame)


class _Shot:
    """One camera, in some frames."""

    def __init__(
        self, table: CameraTable, boxes: dict[str, NDArray[np.float64]], part: slice, fps: float, size: tuple[int, int]
    ) -> None:
        shown = np.stack([each[part] for name, each in boxes.items() if not table.show or name in table.show])
        low, high = shown[:, :, 0].min(axis=0), shown[:, :, 1].max(axis=0)
        self._first, self._field = part.start, table.field_of_view
        middle = (low + high) / 2
        if table.shot == "follow":
            self._way = scipy.ndimage.gaussian_filter1d(middle, FOLLOWING_SECONDS * fps, axis=0, mode="nearest")
            self._way[:, 1] = 0  # the camera does not nod with every step
        else:
            self._way = np.zeros_like(middle)
        azimuth, elevation = np.radians([table.azimuth, table.elevation])
        towards = np.array(
            [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)]
        )
        corners = np.stack([np.where(np.array(bits, bool), high, low) for bits in np.ndindex(2, 2, 2)]) - self._way
        self._target, self._eye = framed(corners.reshape(-1, 3), towards, table.field_of_view, size, table.zoom)

    def camera(self, frame: int) -> Camera:
        way = self._way[min(max(frame - self._first, 0), len(self._way) - 1)]
        return Camera(self._eye + way, self._target + way, self._field)


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
