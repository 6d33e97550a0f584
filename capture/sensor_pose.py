"""Pose of a sensor in the coordinates of another one, and the rigid fit of points to points."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SensorPose:
    """Transform from a sensor's own coordinates to common coordinates.

    Attributes
    ----------
    rotation : (3, 3) float64
        Proper and orthogonal.
    position : (3,) float64
        Position of the sensor in common coordinates, metres.
    """

    rotation: Array
    position: Array

    @classmethod
    def of_degrees(cls, tilt: float, turn: float, roll: float, position: Array) -> Self:
        """Return the pose of a sensor that is rolled, then tilted down, then turned to its own left.

        Parameters
        ----------
        tilt, turn, roll : float
            Degrees about x, y and z, right-handed.
        position : (3,) float64
            Metres.
        """
        turned = scipy.spatial.transform.Rotation.from_euler("YXZ", [turn, tilt, roll], degrees=True)
        return cls(turned.as_matrix(), np.asarray(position, dtype=np.float64))

    @property
    def degrees(self) -> tuple[float, float, float]:
        """Tilt, turn and roll as in `of_degrees`."""
        rotation = scipy.spatial.transform.Rotation.from_matrix(self.rotation)
        turn, tilt, roll = rotation.as_euler("YXZ", degrees=True).tolist()
        return tilt, turn, roll

    @property
    def is_identity(self) -> bool:
        """Whether the sensor's own coordinates are the common ones."""
        return np.array_equal(self.rotation, np.eye(3)) and not self.position.any()

    def apply(self, positions: Array) -> Array:
        """Convert positions (…, 3) from the sensor's own coordinates to common coordinates."""
        return positions @ self.rotation.T + self.position


def fit(points: Array, onto: Array, weights: Array) -> SensorPose:
    """Return the pose that moves points nearest to others, without scaling (Kabsch).

    Parameters
    ----------
    points, onto : (n, 3) float64
        Finite.
    weights : (n,) float64
        Not negative, with a positive sum.
    """
    share = (weights / weights.sum())[:, None]
    middle, target = (share * points).sum(axis=0), (share * onto).sum(axis=0)
    u, _, v = np.linalg.svd((share * (points - middle)).T @ (onto - target))
    sides = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    rotation = (u * sides @ v).T
    return SensorPose(rotation, target - rotation @ middle)
