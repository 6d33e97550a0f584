"""By how much a character is turned about up, away from the axes of its mesh: its left and right mirror each other."""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.anatomy.axes import turned, unit_vector
from solver.anatomy.orientation import mirroring, sample
from solver.surface.mesh import SolverMesh

SAMPLE_COUNT = 3000
"""Number of surface points that are sampled."""

MAX_STRAIGHT = 0.008
"""Mismatch of mirrored points, in diagonals, up to which a mesh stands along its axes."""

MAX_RATIO = 0.65
"""Maximum mismatch of a turned character across its own middle plane, as a ratio to that along the axes."""

STEP, LARGEST = 5, 45
"""Step of the angles that are tried, and the largest of them, in degrees."""

MIN_TURN = 12
"""Minimum turn, in degrees; a character whose pose leans a little to one side is not turned."""


def turn_of(mesh: SolverMesh, ups: Sequence[str]) -> tuple[str, int]:
    """Return the axis about which a character is turned, and the angle.

    Parameters
    ----------
    mesh : SolverMesh
    ups : sequence of str
        Axes that may be up, the likeliest first.

    Returns
    -------
    axis : str
        One of these.
    angle : int
        Degrees, from −45 to 45, counterclockwise if the axis points at the viewer; 0 for a character that stands along
        the axes, or that has no two sides that mirror each other.
    """
    points, _ = sample(mesh, SAMPLE_COUNT)
    tree, diagonal = scipy.spatial.cKDTree(points), float(np.linalg.norm(np.ptp(points, axis=0)))

    def mismatch(up: NDArray[np.float64], angle: float) -> float:
        first = unit_vector("x" if up[0] == 0 else "y")
        planes = (first, np.cross(up, first))
        return min(mirroring(tree, turned(plane, up, angle), diagonal)[1] for plane in planes)

    best = (MAX_RATIO, ups[0], 0)
    for axis in ups:
        up = unit_vector(axis)
        straight = mismatch(up, 0)
        if straight <= MAX_STRAIGHT:
            return axis, 0
        _, coarse = min((mismatch(up, angle), angle) for angle in range(-LARGEST + STEP, LARGEST + 1, STEP))
        least, angle = min((mismatch(up, angle), angle) for angle in range(coarse - STEP + 1, coarse + STEP))
        if abs(angle) >= MIN_TURN:
            best = min(best, (least / straight, axis, angle))
    return best[1:]
