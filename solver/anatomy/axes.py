"""Axes by name: x, -x, y, -y, z and -z; directions between them."""

import numpy as np
from numpy.typing import NDArray


def unit_vector(axis: str) -> NDArray[np.float64]:
    """Return the unit vector (3,) float64 of an axis such as "-y"."""
    return np.eye(3)["xyz".index(axis[-1])] * (-1.0 if axis.startswith("-") else 1.0)


def basis_of(up: str, front: str, turn: float = 0.0) -> NDArray[np.float64]:
    """Return the directions (3, 3) of left, up and front as rows, if a character is turned by degrees to its left."""
    upward = unit_vector(up)
    forward = turned(unit_vector(front), upward, turn)
    return np.array([np.cross(upward, forward), upward, forward])


def turned(vector: NDArray[np.float64], axis: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Return a vector (3,) that is at a right angle to a unit axis (3,), turned about it."""
    angle = np.radians(degrees)
    return np.cos(angle) * vector + np.sin(angle) * np.cross(axis, vector)
