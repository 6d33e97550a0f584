"""Removal of rotations that handles do not determine: any rotation for one handle, that about their line for several.

Neither the deformation energy nor such handles prevent these rotations. The character would roll a little with every
motion and never roll back.
"""

import numpy as np

from puppetline.compiled import compiled
from solver.model.matrix_blocks import MATRICES, NUMBERS, ROWS, place_of_matrix
from solver.model.polar import nearest_rotations


@compiled
def rigid_fit(rest, now):
    """Return the least rotation that best fits the motion of points, (3, 3) for row vectors.

    Parameters
    ----------
    rest, now : (h, 3) float64
    """
    middle, moved = np.zeros(3), np.zeros(3)
    for h in range(len(rest)):
        middle += rest[h] / len(rest)
        moved += now[h] / len(rest)
    S = np.zeros((3, 3))
    for h in range(len(rest)):
        for i in range(3):
            for j in range(3):
                S[i, j] += (rest[h, i] - middle[i]) * (now[h, j] - moved[j])
    # differences between handles at one point are rounding errors without a direction
    size = np.abs(rest).max() * np.abs(now).max()
    least = 1e-9 * np.sqrt((S * S).sum()) + 1e-24 * len(rest) * size + 1e-300
    for i in range(3):
        S[i, i] += least
    return _nearest(S)


@compiled
def remove_roll(turns, count, start, line):
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
    total = np.zeros((3, 3))
    for k in range(count):
        place = place_of_matrix(k)
        for i in range(3):
            for j in range(3):
                total[i, j] += turns[place + j * ROWS + i * MATRICES]
    roll = _about(line, _product(_nearest(total).T, start))
    row = np.empty(3)
    for k in range(count):
        place = place_of_matrix(k)
        for i in range(3):
            for j in range(3):
                row[j] = turns[place + j * ROWS + i * MATRICES]
            for j in range(3):
                turns[place + j * ROWS + i * MATRICES] = row[0] * roll[0, j] + row[1] * roll[1, j] + row[2] * roll[2, j]


@compiled(inner=True)
def _nearest(S):
    packed, R = np.zeros(NUMBERS), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            packed[j * ROWS + i * MATRICES] = S[i, j]
    nearest_rotations(packed, packed)
    for i in range(3):
        for j in range(3):
            R[i, j] = packed[j * ROWS + i * MATRICES]
    return R


@compiled(inner=True)
def _product(A, B):
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                C[i, j] += A[i, k] * B[k, j]
    return C


@compiled(inner=True)
def _about(line, R):
    """Return the twist of a rotation about a line, from the swing-twist decomposition of its quaternion."""
    # four times the products of the components; the row of the largest square is the quaternion, up to scale
    squares = np.array(
        [
            1 + R[0, 0] + R[1, 1] + R[2, 2],
            1 + R[0, 0] - R[1, 1] - R[2, 2],
            1 - R[0, 0] + R[1, 1] - R[2, 2],
            1 - R[0, 0] - R[1, 1] + R[2, 2],
        ]
    )
    a, b, c = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    d, e, f = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    products = ((squares[0], a, b, c), (a, squares[1], d, e), (b, d, squares[2], f), (c, e, f, squares[3]))
    w, x, y, z = products[squares.argmax()]
    if line[0] != 0 or line[1] != 0 or line[2] != 0:
        along = x * line[0] + y * line[1] + z * line[2]
        x, y, z = along * line[0], along * line[1], along * line[2]
    square = w * w + x * x + y * y + z * z
    s = 2 / square if square > 0 else 0.0
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )
