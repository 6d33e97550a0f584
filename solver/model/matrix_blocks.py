"""Stacks of 3 × 3 matrices in blocks of 16, and products with them, laid out for a processor's vector registers.

Entry (row, column) of matrix 16 b + k is at 144 b + 48 column + 16 row + k: the same entries of the 16 matrices of a
block are adjacent. The last block is padded with zeros. Three-column stacks of plain rows have 48 rows per block.
"""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled

MATRICES = 16
"""Number of matrices in a block, which fill vector registers of every usual width."""

ROWS = 3 * MATRICES
"""Number of rows in a block."""

NUMBERS = 3 * ROWS
"""Number of entries in a block."""


def matrix_row_places(count: int) -> NDArray[np.int64]:
    """Return the (3 · count,) place of each row of stacked 3 × 3 matrices among the rows of all blocks."""
    matrix, row = np.divmod(np.arange(3 * count), 3)
    return matrix // MATRICES * ROWS + row * MATRICES + matrix % MATRICES


def row_places(count: int) -> NDArray[np.int64]:
    """Return the (count,) place of each row of a stack of plain rows among the rows of all blocks."""
    return np.arange(count)


def pack_rows(stack: NDArray[np.float64], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Lay a stack of (r, 3) rows out in blocks, each at its (r,) place."""
    padded = np.zeros((_padded(place), 3))
    padded[place] = stack
    return np.ascontiguousarray(padded.reshape(-1, ROWS, 3).transpose(0, 2, 1)).ravel()


def unpack_rows(packed: NDArray[np.float64], place: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the (r, 3) rows at their (r,) places."""
    return packed.reshape(-1, 3, ROWS).transpose(0, 2, 1).reshape(-1, 3)[place]


def _padded(place: NDArray[np.int64]) -> int:
    return -(-(int(place.max()) + 1) // ROWS) * ROWS


def pack_matrix(M: NDArray[np.float64], row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.float64]:
    """Lay a matrix out for `add_product`.

    Parameters
    ----------
    M : (r, k) float64
    row : (r,) int64
        Place of each row of the product, from `matrix_row_places` or `row_places`.
    column : (k,) int64
        Place of each row of the stack that M is multiplied by.

    Returns
    -------
    (blocks · inputs · 48,) float64
        Column after column of each block of rows.
    """
    padded = np.zeros((_padded(row), _padded(column)))
    padded[np.ix_(row, column)] = M
    return np.ascontiguousarray(padded.reshape(-1, ROWS, padded.shape[1]).swapaxes(1, 2)).ravel()


@compiled(inner=True, forceinline=True)
def place_of_matrix(k):
    """Return the index of the first entry of matrix k."""
    return k // MATRICES * NUMBERS + k % MATRICES


@compiled(inner=True, forceinline=True)
def place_of_row(row):
    """Return the index of the first entry of a plain row; the next two follow at intervals of `ROWS`."""
    return row // ROWS * NUMBERS + row % ROWS


@compiled(fastmath=True)
def add_product(M, x, y):
    """Add M x to y.

    Parameters
    ----------
    M : (blocks · inputs · 48,) float64
        From `pack_matrix`.
    x, y : (blocks · 144,) float64
        Stacks of three columns.
    """
    inputs = len(x) // 3
    for block in range(len(y) // NUMBERS):
        out = y[block * NUMBERS : (block + 1) * NUMBERS]
        for j in range(0, inputs, 4):
            v = x[j // ROWS * NUMBERS + j % ROWS :]
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
def apply_change(turns, before, now):
    """Multiply rotations T by the change of others from B to N: T becomes T Bᵀ N.

    Parameters
    ----------
    turns, before, now : (blocks · 144,) float64
        Stacks of T, written to, B and N.
    """
    for block in range(0, len(turns), NUMBERS):
        t, b, n = turns[block : block + NUMBERS], before[block : block + NUMBERS], now[block : block + NUMBERS]
        for row in range(0, ROWS, MATRICES):
            for k in range(MATRICES):
                here = t[row + k], t[row + k + ROWS], t[row + k + 2 * ROWS]
                x, y, z = _dot(here, b, k), _dot(here, b, k + MATRICES), _dot(here, b, k + 2 * MATRICES)
                t[row + k] = x * n[k] + y * n[k + MATRICES] + z * n[k + 2 * MATRICES]
                t[row + k + ROWS] = x * n[k + ROWS] + y * n[k + MATRICES + ROWS] + z * n[k + 2 * MATRICES + ROWS]
                t[row + k + 2 * ROWS] = (
                    x * n[k + 2 * ROWS] + y * n[k + MATRICES + 2 * ROWS] + z * n[k + 2 * MATRICES + 2 * ROWS]
                )


@compiled(inner=True, forceinline=True)
def _dot(t, matrices, place):
    """Return the product of a row with the row of a matrix that begins at a place."""
    return t[0] * matrices[place] + t[1] * matrices[place + ROWS] + t[2] * matrices[place + 2 * ROWS]
