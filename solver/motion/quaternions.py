"""Unit quaternions (w, x, y, z) as tuples, for compiled loops over few rotations.

A quaternion turns column vectors: `rotated(q, v)` is q v q⁻¹, and `product(a, b)` turns by b first.
"""

import math

import numpy as np

from puppetline.compiled import compiled
from solver.model.vectors import cross, dot, length, perpendicular, plus, scaled, unit
from solver.model.vectors import write_row as _write_row


@compiled(inner=True)
def product(a, b):
    """Return the rotation that turns by b and then by a."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@compiled(inner=True)
def inverse(q):
    """Return the inverse rotation."""
    return (q[0], -q[1], -q[2], -q[3])


@compiled(inner=True)
def rotated(q, v):
    """Return a vector rotated by a quaternion."""
    u = (q[1], q[2], q[3])
    t = cross(u, v)
    t = scaled(t, 2)
    s = cross(u, t)
    return (v[0] + q[0] * t[0] + s[0], v[1] + q[0] * t[1] + s[1], v[2] + q[0] * t[2] + s[2])


@compiled(inner=True)
def row_of(quaternions, row):
    """Return a row of an array of quaternions as a tuple."""
    return (quaternions[row, 0], quaternions[row, 1], quaternions[row, 2], quaternions[row, 3])


@compiled(inner=True)
def write_row(quaternions, row, q):
    """Write a quaternion to a row of an array."""
    quaternions[row, 0], quaternions[row, 1], quaternions[row, 2], quaternions[row, 3] = q[0], q[1], q[2], q[3]


@compiled(inner=True)
def normalised(q):
    """Return a quaternion of unit length."""
    size = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] / size, q[1] / size, q[2] / size, q[3] / size)


@compiled(inner=True)
def least(a, b):
    """Return the least rotation from one direction to another, about `perpendicular` if they are opposite."""
    w = 1 + dot(a, b)
    if w < 1e-9:
        x, y, z = perpendicular(a)
        return (0.0, x, y, z)
    x, y, z = cross(a, b)
    return normalised((w, x, y, z))


@compiled(inner=True)
def from_vector(v):
    """Return the rotation about a vector by its length in radians."""
    angle = length(v)
    s = math.sin(angle / 2) / angle if angle > 1e-8 else 0.5
    return (math.cos(angle / 2), s * v[0], s * v[1], s * v[2])


@compiled(inner=True)
def to_vector(q):
    """Return the axis of a rotation times its angle, 0 to π."""
    sign = -1.0 if q[0] < 0 else 1.0
    s = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = sign * (2 * math.atan2(s, sign * q[0]) / s if s > 1e-12 else 2.0)
    return scaled((q[1], q[2], q[3]), scale)


@compiled(inner=True)
def near_vector(q, before):
    """Return `to_vector` plus the number of full turns that brings it nearest to the vector before."""
    v = to_vector(q)
    angle = length(v)
    axis = (v[0] / angle, v[1] / angle, v[2] / angle) if angle > 1e-9 else unit(before)
    return scaled(axis, angle + 2 * math.pi * round((dot(before, axis) - angle) / (2 * math.pi)))


@compiled(inner=True)
def twist(a, b, axis):
    """Return the angle about a unit axis from vector a to vector b, −π to π."""
    along_a, along_b = dot(a, axis), dot(b, axis)
    flat_a, flat_b = plus(a, axis, -along_a), plus(b, axis, -along_b)
    return math.atan2(dot(cross(flat_a, flat_b), axis), dot(flat_a, flat_b))


@compiled(inner=True)
def about(axis, angle):
    """Return the rotation about a unit axis by an angle in radians."""
    s = math.sin(angle / 2)
    return (math.cos(angle / 2), s * axis[0], s * axis[1], s * axis[2])


@compiled(inner=True)
def of_rows(A):
    """Return the quaternion of a (3, 3) rotation for row vectors, x' = x A."""
    # Shepperd's method: the largest of the four squares, so that nothing cancels
    trace = A[0, 0] + A[1, 1] + A[2, 2]
    if trace >= A[0, 0] and trace >= A[1, 1] and trace >= A[2, 2]:
        q = (1 + trace, A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0])
    elif A[0, 0] >= A[1, 1] and A[0, 0] >= A[2, 2]:
        q = (A[1, 2] - A[2, 1], 1 + 2 * A[0, 0] - trace, A[0, 1] + A[1, 0], A[2, 0] + A[0, 2])
    elif A[1, 1] >= A[2, 2]:
        q = (A[2, 0] - A[0, 2], A[0, 1] + A[1, 0], 1 + 2 * A[1, 1] - trace, A[1, 2] + A[2, 1])
    else:
        q = (A[0, 1] - A[1, 0], A[2, 0] + A[0, 2], A[1, 2] + A[2, 1], 1 + 2 * A[2, 2] - trace)
    return normalised(q)


@compiled
def of_matrices(turns):
    """Return the quaternions (n, 4) float64 of rotations (n, 3, 3) for column vectors: x, y, z, w, with w ≥ 0."""
    found = np.empty((len(turns), 4))
    for k in range(len(turns)):
        w, x, y, z = of_rows(turns[k].T)
        sign = -1.0 if w < 0 else 1.0
        found[k, 0], found[k, 1], found[k, 2], found[k, 3] = sign * x, sign * y, sign * z, sign * w
    return found


@compiled(inner=True)
def write_rows(q, A):
    """Write a rotation as a (3, 3) matrix for row vectors: row i is the rotated axis i."""
    _write_row(A, 0, rotated(q, (1.0, 0.0, 0.0)))
    _write_row(A, 1, rotated(q, (0.0, 1.0, 0.0)))
    _write_row(A, 2, rotated(q, (0.0, 0.0, 1.0)))
