"""Cameras of films: perspective, and the parallel projections of lights."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

NEAR_SHARE = 0.02
"""Distance of the nearest visible point, as a share of the distance from the camera to its target."""


@dataclass(frozen=True)
class Camera:
    """A perspective camera that stands upright.

    Attributes
    ----------
    eye, target : (3,) float64
        Metres.
    field_of_view : float
        Vertical angle in degrees.
    """

    eye: NDArray[np.float64]
    target: NDArray[np.float64]
    field_of_view: float

    @property
    def axes(self) -> NDArray[np.float64]:
        """(3, 3): rows right, up and towards the viewer."""
        return axes_towards(self.eye - self.target)

    def matrix(self, size: tuple[int, int]) -> NDArray[np.float32]:
        """Return the map of points to clip coordinates with y down, (4, 4) column by column, for a frame's size."""
        distance = float(np.linalg.norm(self.eye - self.target))
        near, far = NEAR_SHARE * distance, 50 * distance
        spread = 1 / np.tan(np.radians(self.field_of_view) / 2)
        projection = np.array(
            [
                [spread * size[1] / size[0], 0, 0, 0],
                [0, -spread, 0, 0],
                [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
                [0, 0, -1, 0],
            ]
        )
        view = np.eye(4)
        view[:3, :3] = self.axes
        view[:3, 3] = -self.axes @ self.eye
        return np.ascontiguousarray((projection @ view).T, np.float32)


class Light(NamedTuple):
    """A parallel projection.

    Attributes
    ----------
    matrix : (4, 4) float32
        Map of points to clip coordinates, column by column.
    half : (2,) float64
        Half of the width and height that it covers, in metres.
    """

    matrix: NDArray[np.float32]
    half: NDArray[np.float64]


def orthographic(direction: NDArray[np.float64], center: NDArray[np.float64], radius: float, height: float) -> Light:
    """Return the projection along a direction that covers a cylinder on the floor.

    Parameters
    ----------
    direction : (3,) float64
        Unit vector towards the light.
    center : (3,) float64
        Of the cylinder's lower end.
    radius, height : float
    """
    axes = axes_towards(direction)
    middle = center + np.array([0, height / 2, 0])
    # half extents of a cylinder: its circle's and its axis's shadows on each direction
    half = radius * np.sqrt(np.maximum(0, 1 - axes[:, 1] ** 2)) + height / 2 * np.abs(axes[:, 1])
    half = half * 1.02 + 1e-6
    matrix = np.eye(4)
    matrix[:3, :3] = axes / half[:, None] * [[1], [1], [-1]]
    matrix[:3, 3] = -matrix[:3, :3] @ middle
    return Light(np.ascontiguousarray(matrix.T, np.float32), half[:2])


def axes_towards(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) rows right, up and towards of a view from a direction."""
    towards = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 1.0, 0.0], towards)
    length = np.linalg.norm(right)
    right = right / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    return np.array([right, np.cross(towards, right), towards])
