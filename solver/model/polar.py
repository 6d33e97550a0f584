"""The rotations nearest to many 3 × 3 matrices: the inner loop of the solver's iteration.

R = U Vᵀ of the singular value decomposition S = U Σ Vᵀ. V comes from Jacobi rotations of SᵀS, U from S V. The third
axis of both is a cross product, so the determinant of R is +1.

The code has no branches and 16 matrices are interleaved in memory (`matrix_blocks`), so that the compiler computes
several at a time in vector registers. That is eight times as fast.
"""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.matrix_blocks import MATRICES, NUMBERS, matrix_row_places, pack_rows, unpack_rows
from solver.model.vectors import cross, dot

MIN_SINGULAR_VALUE_RATIO = 1e-8
"""Ratio of a singular value to the largest one below which the matrix does not determine a rotation about one axis."""

TINY = 1e-300
"""Smallest denominator, so that quotients of zeros are finite."""


@compiled(inner=True, forceinline=True, error_model="numpy")
def _turn(app, aqq, apq, arp, arq, v0p, v0q, v1p, v1q, v2p, v2q):
    """Make a symmetric matrix's entry pq zero by a rotation of axes p and q, and turn the columns p and q of V."""
    difference = aqq - app
    t = 2 * apq / (abs(difference) + np.sqrt(difference * difference + 4 * apq * apq) + TINY)
    t = -t if difference < 0 else t
    c = 1 / np.sqrt(t * t + 1)
    s = t * c
    return (
        *(app - t * apq, aqq + t * apq, c * arp - s * arq, s * arp + c * arq),
        *(c * v0p - s * v0q, s * v0p + c * v0q),
        *(c * v1p - s * v1q, s * v1p + c * v1q),
        *(c * v2p - s * v2q, s * v2p + c * v2q),
    )


@compiled(inner=True, forceinline=True, error_model="numpy")
def _sweep(a, v):
    """Rotate each pair of axes once; a is the upper triangle (00, 11, 22, 01, 02, 12), v is V by rows."""
    a00, a11, a22, a01, a02, a12 = a
    v00, v01, v02, v10, v11, v12, v20, v21, v22 = v
    a00, a11, a02, a12, v00, v01, v10, v11, v20, v21 = _turn(a00, a11, a01, a02, a12, v00, v01, v10, v11, v20, v21)
    a00, a22, a01, a12, v00, v02, v10, v12, v20, v22 = _turn(a00, a22, a02, 0.0, a12, v00, v02, v10, v12, v20, v22)
    a11, a22, a01, a02, v01, v02, v11, v12, v21, v22 = _turn(a11, a22, a12, a01, 0.0, v01, v02, v11, v12, v21, v22)
    return (a00, a11, a22, a01, a02, 0.0), (v00, v01, v02, v10, v11, v12, v20, v21, v22)


@compiled(inner=True, forceinline=True)
def _larger_first(x, y, a, b):
    """Exchange two eigenvalues and their vectors where the second is larger."""
    later = x < y
    first = (b[0] if later else a[0], b[1] if later else a[1], b[2] if later else a[2])
    second = (a[0] if later else b[0], a[1] if later else b[1], a[2] if later else b[2])
    return max(x, y), min(x, y), first, second


@compiled(inner=True, forceinline=True, error_model="numpy")
def _across(wanted, other):
    """Return the direction and the length of the part of a vector at a right angle to a unit vector."""
    along = wanted[0] * other[0] + wanted[1] * other[1] + wanted[2] * other[2]
    x, y, z = wanted[0] - along * other[0], wanted[1] - along * other[1], wanted[2] - along * other[2]
    length = np.sqrt(x * x + y * y + z * z)
    scale = 1 / (length + TINY)
    return (x * scale, y * scale, z * scale), length


@compiled(inner=True, forceinline=True)
def _either(condition, a, b):
    return (a[0] if condition else b[0], a[1] if condition else b[1], a[2] if condition else b[2])


@compiled(inner=True, forceinline=True)
def _image(s, v):
    return (
        s[0] * v[0] + s[1] * v[1] + s[2] * v[2],
        s[3] * v[0] + s[4] * v[1] + s[5] * v[2],
        s[6] * v[0] + s[7] * v[1] + s[8] * v[2],
    )


@compiled(error_model="numpy")
def nearest_rotations(S, out):
    """Write the rotation nearest to each matrix.

    Parameters
    ----------
    S, out : (blocks · NUMBERS,) float64
        Matrices in the layout of `matrix_blocks`, their entries zero or between 1e-100 and 1e100 in size. A matrix of
        rank 1 or 0 has several nearest rotations; the result is the one with the smallest angle.
    """
    for block in range(len(S) // NUMBERS):
        o = block * NUMBERS
        for k in range(MATRICES):
            s = (
                *(S[o + k], S[o + 3 * MATRICES + k], S[o + 6 * MATRICES + k]),
                *(S[o + MATRICES + k], S[o + 4 * MATRICES + k], S[o + 7 * MATRICES + k]),
                *(S[o + 2 * MATRICES + k], S[o + 5 * MATRICES + k], S[o + 8 * MATRICES + k]),
            )
            a = (
                (s[0] * s[0] + s[3] * s[3] + s[6] * s[6]),
                (s[1] * s[1] + s[4] * s[4] + s[7] * s[7]),
                (s[2] * s[2] + s[5] * s[5] + s[8] * s[8]),
                (s[0] * s[1] + s[3] * s[4] + s[6] * s[7]),
                (s[0] * s[2] + s[3] * s[5] + s[6] * s[8]),
                (s[1] * s[2] + s[4] * s[5] + s[7] * s[8]),
            )
            v = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
            # convergence is quadratic: after five sweeps only rounding errors remain, for every matrix
            a, v = _sweep(a, v)
            a, v = _sweep(a, v)
            a, v = _sweep(a, v)
            a, v = _sweep(a, v)
            a, v = _sweep(a, v)
            v0, v1, v2 = (v[0], v[3], v[6]), (v[1], v[4], v[7]), (v[2], v[5], v[8])
            a0, a1, v0, v1 = _larger_first(a[0], a[1], v0, v1)
            a0, a2, v0, v2 = _larger_first(a0, a[2], v0, v2)
            a1, a2, v1, v2 = _larger_first(a1, a2, v1, v2)
            v2 = cross(v0, v1)
            u0, largest = _across(_image(s, v0), (0.0, 0.0, 0.0))
            u0 = _either(largest > 0, u0, v0)
            u1, second = _across(_image(s, v1), u0)
            least, length = _across(v1, u0)
            least = _either(length > 1e-4, least, _across(v2, u0)[0])
            u1 = _either(second > MIN_SINGULAR_VALUE_RATIO * largest, u1, least)
            u2 = cross(u0, u1)
            for_row_0 = (u0[0], u1[0], u2[0])
            for_row_1 = (u0[1], u1[1], u2[1])
            for_row_2 = (u0[2], u1[2], u2[2])
            x, y, z = (v0[0], v1[0], v2[0]), (v0[1], v1[1], v2[1]), (v0[2], v1[2], v2[2])
            out[o + k] = dot(for_row_0, x)
            out[o + MATRICES + k] = dot(for_row_1, x)
            out[o + 2 * MATRICES + k] = dot(for_row_2, x)
            out[o + 3 * MATRICES + k] = dot(for_row_0, y)
            out[o + 4 * MATRICES + k] = dot(for_row_1, y)
            out[o + 5 * MATRICES + k] = dot(for_row_2, y)
            out[o + 6 * MATRICES + k] = dot(for_row_0, z)
            out[o + 7 * MATRICES + k] = dot(for_row_1, z)
            out[o + 8 * MATRICES + k] = dot(for_row_2, z)


def of_matrices(S: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (m, 3, 3) rotations nearest to (m, 3, 3) matrices."""
    place = matrix_row_places(len(S))
    packed = pack_rows(S.reshape(-1, 3), place)
    nearest_rotations(packed, packed)
    return unpack_rows(packed, place).reshape(-1, 3, 3)
