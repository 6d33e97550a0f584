"""Views of pictures of a mesh or a performer: from a direction, without perspective."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class View:
    """An orthographic camera, in the mesh's coordinates with y up.

    Attributes
    ----------
    azimuth, elevation : float
        Degrees. At 0, 0 the camera looks along −z at a character that faces +z. A positive azimuth moves the camera
        towards +x, a positive elevation upwards.
    center : tuple of 3 floats
        The point in the centre of the image.
    radius : float
        Distance from the centre to the nearer edges of the image, in the mesh's units.
    ground : float or None
        Height of the floor that receives the shadow; None for no floor.
    """

    azimuth: float
    elevation: float
    center: tuple[float, float, float]
    radius: float
    ground: float | None = None

    @classmethod
    def around(
        cls,
        points: NDArray[np.floating],
        azimuth: float = 25.0,
        elevation: float = 12.0,
        size: tuple[int, int] = (1, 1),
    ) -> Self:
        """Return the view that frames all points with a margin, on a floor at the height of the lowest point.

        Parameters
        ----------
        points : (..., 3) float
            Vertices of a mesh, or of all frames of a clip.
        azimuth, elevation : float
            Degrees, see `View`.
        size : tuple of 2 ints
            Width and height of the image; only their ratio counts.
        """
        flat = np.reshape(points, (-1, 3))
        axes = camera_axes(azimuth, elevation)
        seen = flat @ axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        x, y, z = axes.T @ ((low + high) / 2)
        needed = (high - low)[:2] * min(size) / np.array(size)
        return cls(azimuth, elevation, (x, y, z), 1.12 * float(needed.max()) / 2, float(flat[:, 1].min()))


def project(points: NDArray[np.floating], view: View, size: tuple[int, int]) -> NDArray[np.float64]:
    """Return where a view shows points.

    Parameters
    ----------
    points : (n, 3) float
    view : View
    size : tuple of 2 ints
        Width and height in pixels.

    Returns
    -------
    (n, 3) float64
        Pixels right of, below and behind the image's top left corner.
    """
    axes = camera_axes(view.azimuth, view.elevation)
    return transform(pixel_matrix(axes, np.array(view.center), view.radius, *size), np.asarray(points, np.float64))


def camera_axes(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Return the (3, 3) rows right, up and towards the viewer of a camera at these angles, in degrees."""
    a, e = np.radians([azimuth, elevation])
    right = np.array([np.cos(a), 0, -np.sin(a)])
    towards = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    return np.array([right, np.cross(towards, right), towards])


def pixel_matrix(
    axes: NDArray[np.floating], center: NDArray[np.float64], radius: float, width: int, height: int
) -> NDArray[np.float64]:
    """Return the (3, 4) map of points to pixels right of, below and behind the image's top left corner."""
    linear: NDArray[np.float64] = min(width, height) / (2 * radius) * axes * [[1], [-1], [-1]]
    return np.column_stack([linear, [width / 2, height / 2, 0] - linear @ center])


def transform(matrix: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply a (3, 4) affine map to (n, 3) points."""
    return points @ matrix[:, :3].T + matrix[:, 3]
