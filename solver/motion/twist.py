"""Removal of rotations that handles do not determine: any rotation for one handle, that about their line for several.

Neither the deformation energy nor such handles prevent these rotations. The character would roll a little with every
motion and never roll back.
"""

import math

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.matrix_blocks import MATRICES, NUMBERS, ROWS, place_of_matrix
from solver.model.polar import nearest_rotations


def rigid_fit(rest: NDArray[np.float64], now: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least rotation that best fits the motion of points, (3, 3) for row vectors.

    Parameters
    ----------
    rest, now : (h, 3) float64
    """
    fit = np.zeros(NUMBERS)
    _add_covariance(rest, now, fit)
    nearest_rotations(fit, fit)  # from here: a compiled caller would compile it once more
    return np.ascontiguousarray(fit.reshape(3, 3, MATRICES)[..., 0].T)


def remove_roll(turns: NDArray[np.float64], count: int, start: NDArray[np.float64], line: NDArray[np.float64]) -> None:
    """Rotate all isolines so that their mean has no roll relative to a rotation.

    Parameters
    ----------
    turns : (blocks · NUMBERS,) float64
        The isolines' rotations in the layout of `matrix_blocks`, for row vectors; written to.
    count : int
        Number of isolines.
    start : (3, 3) float64
        Reference rotation, from `rigid_fit`.
    line : (3,) float64
        Unit direction of the line through the handles; zero for a single handle, where any rotation is undetermined.
    """
    mean = np.zeros(NUMBERS)
    _add_turns(turns, count, mean)
    nearest_rotations(mean, mean)
    _roll_back(turns, count, mean, start, line)


@compiled
def _add_covariance(rest, now, fit):
    """Add the matrix whose nearest rotation is that of the points to the first of a block."""
    count, square = len(rest), 0.0
    for i in range(3):
        for j in range(3):
            middle = moved = product = 0.0
            for h in range(count):
                middle += rest[h, i] / count
                moved += now[h, j] / count
            for h in range(count):
                product += (rest[h, i] - middle) * (now[h, j] - moved)
            fit[j * ROWS + i * MATRICES] += product
            square += product * product
    farthest = farthest_now = 0.0
    for h in range(count):
        for x in range(3):
            farthest, farthest_now = max(farthest, abs(rest[h, x])), max(farthest_now, abs(now[h, x]))
    # differences between handles at one point are rounding errors without a direction
    least = 1e-9 * math.sqrt(square) + 1e-24 * count * farthest * farthest_now + 1e-300
    for i in range(3):
        fit[i * ROWS + i * MATRICES] += least


@compiled
def _add_turns(turns, count, mean):
    """Add rotations to the first matrix of a block."""
    for k in range(count):
        place = place_of_matrix(k)
        for entry in range(0, NUMBERS, MATRICES):
            mean[entry] += turns[place + entry]


@compiled
def _roll_back(turns, count, mean, start, line):
    """Rotate the rotations by the twist about a line that their mean lacks."""
    roll, row = np.empty((3, 3)), np.empty(3)
    for i in range(3):
        for j in range(3):
            roll[i, j] = 0.0
            for k in range(3):
                roll[i, j] += mean[i * ROWS + k * MATRICES] * start[k, j]
    _keep_twist(line, roll)
    for k in range(count):
        place = place_of_matrix(k)
        for i in range(3):
            for j in range(3):
                row[j] = turns[place + j * ROWS + i * MATRICES]
            for j in range(3):
                turns[place + j * ROWS + i * MATRICES] = row[0] * roll[0, j] + row[1] * roll[1, j] + row[2] * roll[2, j]


@compiled(inner=True)
def _keep_twist(line, R):
    """Replace a rotation by its twist about a line, from the swing-twist decomposition of its quaternion."""
    # four times the products of the components; the row of the largest square is the quaternion, up to scale
    a, b, c = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    d, e, f = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    largest = 1 + R[0, 0] + R[1, 1] + R[2, 2]
    w, x, y, z = largest, a, b, c
    square = 1 + R[0, 0] - R[1, 1] - R[2, 2]
    if square > largest:
        largest, w, x, y, z = square, a, square, d, e
    square = 1 - R[0, 0] + R[1, 1] - R[2, 2]
    if square > largest:
        largest, w, x, y, z = square, b, d, square, f
    square = 1 - R[0, 0] - R[1, 1] + R[2, 2]
    if square > largest:
        w, x, y, z = c, e, f, square
    if line[0] != 0 or line[1] != 0 or line[2] != 0:
        along = x * line[0] + y * line[1] + z * line[2]
        x, y, z = along * line[0], along * line[1], along * line[2]
    square = w * w + x * x + y * y + z * z
    s = 2 / square if square > 0 else 0.0
    R[0, 0], R[0, 1], R[0, 2] = 1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)
