"""Which axes of a file with a skeleton point up and forward."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.puppet.body_plans import is_leg
from engine_bridge.puppet.puppet import Direction
from solver.anatomy.limb_chain import Limbs

MIN_RATIO = 2.0
"""Minimum length of the legs along another axis, as a multiple of that along y, for which the axis is taken as up."""


def axes_of(limbs: Limbs) -> tuple[Direction, Direction] | None:
    """Return up and front of a skeleton with named limbs; None without a pair of legs.

    Parameters
    ----------
    limbs : Limbs
        From a skeleton with named sides: left limbs are on the left.
    """
    points = limbs.points
    pairs = [
        (points[name], points[name.replace("left", "right")])
        for name in points
        if name.startswith("left") and is_leg(name) and name.replace("left", "right") in points
    ]
    if not pairs:
        return None
    left = np.sum([left[0] - right[0] for left, right in pairs], axis=0)
    up = upward(np.sum([leg[0] - leg[-1] for pair in pairs for leg in pair], axis=0))
    return _direction(up), _direction(np.cross(left, up))


def upward(from_feet: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axis that points up: y as glTF says, unless the legs clearly stand along another one.

    Legs may reach forwards or upwards at rest, as those of a frog or of an insect that flies.

    Parameters
    ----------
    from_feet : (3,) float64
        Sum of the vectors from the feet to the hips.
    """
    axis = int(np.abs(from_feet).argmax())
    if abs(from_feet[axis]) < MIN_RATIO * abs(from_feet[1]):
        return np.array([0.0, 1.0, 0.0])
    return np.asarray(np.sign(from_feet[axis]) * np.eye(3)[axis])


def _direction(along: NDArray[np.float64]) -> Direction:
    names: tuple[tuple[Direction, Direction], ...] = (("x", "-x"), ("y", "-y"), ("z", "-z"))
    axis = int(np.abs(along).argmax())
    return names[axis][int(along[axis] < 0)]
