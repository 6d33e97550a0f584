"""Stacks of 3 × 3 matrices, and products with them, laid out so that a processor's vector registers are full.

Sixteen matrices make a block. A block holds column after column, in each column row after row, and in each row the
sixteen matrices side by side: entry (row, column) of matrix 16 b + lane is at 144 b + 48 column + 16 row + lane. The
last block is filled up with zeros. A stack of three columns that is not made of matrices has 48 rows a block.
"""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled

LANES = 16
"""Matrices side by side: a whole number of the registers of every processor in use."""

ROWS = 3 * LANES
"""Rows of a block."""

BLOCK = 3 * ROWS
"""Numbers in a block."""


def of_matrices(count: int) -> NDArray[np.int64]:
    """Return the (3 · count,) place of each row of stacked 3 × 3 matrices, among the rows of all blocks."""
    matrix, row = np.divmod(np.arange(3 * count), 3)
    return matrix // LANES * ROWS + row * LANES + matrix % LANES


def of_rows(count: int) -> NDArray[np.int64]:
    """Return the (count,) place of each row of a stack that is not made of matrices: one after another."""
    return np.arange(count)


def pack(stack: NDArray[np.float64], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Lay a stack of (r, 3) rows out in blocks, each at its (r,) place."""
    filled = np.zeros((_filled_up(place), 3))
    filled[place] = stack
    return np.ascontiguousarray(filled.reshape(-1, ROWS, 3).transpose(0, 2, 1)).ravel()


def unpack(packed: NDArray[np.float64], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the (r, 3) rows from their (r,) places."""
    return packed.reshape(-1, 3, ROWS).transpose(0, 2, 1).reshape(-1, 3)[place]


def _filled_up(place: NDArray[np.int64]) -> int:
    return -(-(int(place.max()) + 1) // ROWS) * ROWS


def matrix(M: NDArray[np.float64], row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.float64]:
    """Lay a matrix out for `add_product`.

    Parameters
    ----------
    M : (r, k) float64
    row : (r,) int64
        Place of each of its rows, from `of_matrices` or `of_rows`.
    column : (k,) int64
        Place of each row of what it is multiplied with.

    Returns
    -------
    (blocks · inputs · 48,) float64
        Column after column of each block of rows.
    """
    filled = np.zeros((_filled_up(row), _filled_up(column)))
    filled[np.ix_(row, column)] = M
    return np.ascontiguousarray(filled.reshape(-1, ROWS, filled.shape[1]).swapaxes(1, 2)).ravel()


@compiled(inner=True, inline="always")
def place_of_matrix(k):
    """Return where the first entry of matrix k is."""
    return k // LANES * BLOCK + k % LANES


@compiled(inner=True, inline="always")
def place_of_row(row):
    """Return where the first entry of a plain row is; the next two are `ROWS` after each other."""
    return row // ROWS * BLOCK + row % ROWS


@compiled(fastmath=True)
def add_product(M, x, y):
    """Add M x to y.

    Parameters
    ----------
    M : (blocks · inputs · 48,) float64
        From `matrix`.
    x, y : (blocks · 144,) float64
        Stacks of three columns.
    """
    inputs = len(x) // 3
    for block in range(len(y) // BLOCK):
        out = y[block * BLOCK : (block + 1) * BLOCK]
        for j in range(0, inputs, 4):
            v = x[j // ROWS * BLOCK + j % ROWS :]
            a0, a1, a2 = v[0], v[ROWS], v[2 * ROWS]
            b0, b1, b2 = v[1], v[1 + ROWS], v[1 + 2 * ROWS]
            c0, c1, c2 = v[2], v[2 + ROWS], v[2 + 2 * ROWS]
            d0, d1, d2 = v[3], v[3 + ROWS], v[3 + 2 * ROWS]
            columns = M[(block * inputs + j) * ROWS : (block * inputs + j + 4) * ROWS]
            for i in range(ROWS):
                a, b, c, d = columns[i], columns[ROWS + i], columns[2 * ROWS + i], columns[3 * ROWS + i]
                out[i] += a * a0 + b * b0 + c * c0 + d * d0
                out[ROWS + i] += a * a1 + b * b1 + c * c1 + d * d1
                out[2 * ROWS + i] += a * a2 + b * b2 + c * c2 + d * d2


@compiled
def turn_on(turns, before, now):
    """Multiply each rotation by what turns another one on: T becomes T Bᵀ N.

    Parameters
    ----------
    turns, before, now : (blocks · 144,) float64
        Stacks of 3 × 3 matrices; the first is written to.
    """
    for block in range(0, len(turns), BLOCK):
        t, b, n = turns[block : block + BLOCK], before[block : block + BLOCK], now[block : block + BLOCK]
        for row in range(0, ROWS, LANES):
            for lane in range(LANES):
                here = t[row + lane], t[row + lane + ROWS], t[row + lane + 2 * ROWS]
                x, y, z = _dot(here, b, lane), _dot(here, b, lane + LANES), _dot(here, b, lane + 2 * LANES)
                t[row + lane] = x * n[lane] + y * n[lane + LANES] + z * n[lane + 2 * LANES]
                t[row + lane + ROWS] = x * n[lane + ROWS] + y * n[lane + LANES + ROWS] + z * n[lane + 2 * LANES + ROWS]
                t[row + lane + 2 * ROWS] = (
                    x * n[lane + 2 * ROWS] + y * n[lane + LANES + 2 * ROWS] + z * n[lane + 2 * LANES + 2 * ROWS]
                )


@compiled(inner=True, inline="always")
def _dot(t, matrices, place):
    """Return the product of a row with that row of a matrix which begins at a place."""
    return t[0] * matrices[place] + t[1] * matrices[place + ROWS] + t[2] * matrices[place + 2 * ROWS]
