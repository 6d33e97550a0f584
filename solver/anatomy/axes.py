"""Axes by name: x, -x, y, -y, z and -z."""

import numpy as np
from numpy.typing import NDArray


def unit_vector(axis: str) -> NDArray[np.float64]:
    """Return the unit vector (3,) float64 of an axis such as "-y"."""
    return np.eye(3)["xyz".index(axis[-1])] * (-1.0 if axis.startswith("-") else 1.0)
