"""The rotations nearest to many 3 × 3 matrices at once: the one loop inside the solver's iteration.

R = U Vᵀ of the singular value decomposition S = U Σ Vᵀ, with the direction of the smallest singular value turned over
where that is what makes R a rotation. V comes from Jacobi rotations of SᵀS, U from S V; a cross product on either side
then gives the third axis, so that the determinant is +1 without asking.
"""

import numba
import numpy as np

SWEEPS = 12
"""At most; three or four are enough for all but the most contrived matrices."""


@numba.njit(cache=True, nogil=True)
def _diagonalise(a, V):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Turn a symmetric matrix into a diagonal one in place by cyclic Jacobi rotations; V collects them."""
    total = a[0, 0] + a[1, 1] + a[2, 2]
    for _ in range(SWEEPS):
        if a[0, 1] ** 2 + a[0, 2] ** 2 + a[1, 2] ** 2 <= 1e-30 * total * total:
            return
        for p, q in ((0, 1), (0, 2), (1, 2)):
            apq = a[p, q]
            if apq == 0.0:
                continue
            theta = (a[q, q] - a[p, p]) / (2 * apq)
            t = np.copysign(1 / (abs(theta) + np.sqrt(theta * theta + 1)), theta)
            c = 1 / np.sqrt(t * t + 1)
            s = t * c
            a[p, p] -= t * apq
            a[q, q] += t * apq
            a[p, q] = a[q, p] = 0.0
            r = 3 - p - q
            arp, arq = a[r, p], a[r, q]
            a[r, p] = a[p, r] = c * arp - s * arq
            a[r, q] = a[q, r] = s * arp + c * arq
            for i in range(3):
                vp, vq = V[i, p], V[i, q]
                V[i, p] = c * vp - s * vq
                V[i, q] = s * vp + c * vq


@numba.njit(cache=True, nogil=True)
def _cross(a, b, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, nogil=True)
def _direction(wanted, other, least, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write the unit vector of what is wanted across a unit vector; tell whether more than the least is left of it."""
    along = wanted[0] * other[0] + wanted[1] * other[1] + wanted[2] * other[2]
    for i in range(3):
        out[i] = wanted[i] - along * other[i]
    length = np.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    if length <= least:
        return False
    for i in range(3):
        out[i] /= length
    return True


@numba.njit(cache=True, nogil=True)
def _image(s, vector, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(3):
        out[i] = s[i, 0] * vector[0] + s[i, 1] * vector[1] + s[i, 2] * vector[2]


@numba.njit(cache=True, nogil=True)
def nearest_rotations(S, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write the rotation nearest to each matrix.

    Parameters
    ----------
    S, out : (m, 3, 3) float64
        Where S leaves a turn open, having rank 1 or 0, the result is one of those that fit.
    """
    a, V = np.empty((3, 3)), np.empty((3, 3))
    u, v = np.empty((3, 3)), np.empty((3, 3))
    nothing, image = np.zeros(3), np.empty(3)
    for k in range(len(S)):
        s = S[k]
        for i in range(3):
            for j in range(3):
                V[i, j] = 1.0 if i == j else 0.0
                a[i, j] = s[0, i] * s[0, j] + s[1, i] * s[1, j] + s[2, i] * s[2, j]
        _diagonalise(a, V)
        first = 0 if a[0, 0] >= a[1, 1] else 1
        first = first if a[first, first] >= a[2, 2] else 2
        second, last = (first + 1) % 3, (first + 2) % 3
        if a[last, last] > a[second, second]:
            second, last = last, second
        v[0], v[1] = V[:, first], V[:, second]
        _cross(v[0], v[1], v[2])
        largest = np.sqrt(max(a[first, first], 0.0))
        _image(s, v[0], image)
        if not _direction(image, nothing, 0.0, u[0]):
            u[0] = v[0]
        _image(s, v[1], image)
        # what is left open turns as little as it can
        if not _direction(image, u[0], 1e-8 * largest, u[1]) and not _direction(v[1], u[0], 1e-4, u[1]):
            _direction(v[2], u[0], 0.0, u[1])
        _cross(u[0], u[1], u[2])
        for i in range(3):
            for j in range(3):
                out[k, i, j] = u[0, i] * v[0, j] + u[1, i] * v[1, j] + u[2, i] * v[2, j]
