"""Vectors of three numbers as tuples, for compiled loops over few vectors. Arguments may also be arrays."""

import math

from puppetline.compiled import compiled

MIN_LENGTH = 1e-12
"""Smallest length of a vector that has a direction, in the unit of the vector."""


@compiled(inner=True)
def dot(a, b):
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(inner=True)
def cross(a, b):
    """Return the cross product of two vectors."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled(inner=True)
def scaled(v, factor):
    """Return a vector times a number."""
    return (factor * v[0], factor * v[1], factor * v[2])


@compiled(inner=True)
def minus(a, b):
    """Return the difference of two vectors."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled(inner=True)
def plus(a, b, factor):
    """Return a + factor · b."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


@compiled(inner=True)
def length(v):
    """Return the length of a vector."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@compiled
def unit(v):
    """Return the direction of a vector; zero for a vector too short to have one."""
    size = length(v)
    if not size > MIN_LENGTH:
        return (0.0, 0.0, 0.0)
    return (v[0] / size, v[1] / size, v[2] / size)


@compiled
def perpendicular(v):
    """Return a direction at a right angle to a vector, always the same for the same vector."""
    if abs(v[0]) <= abs(v[1]) and abs(v[0]) <= abs(v[2]):
        return unit((0.0, v[2], -v[1]))
    if abs(v[1]) <= abs(v[2]):
        return unit((-v[2], 0.0, v[0]))
    return unit((v[1], -v[0], 0.0))


@compiled(inner=True)
def row_of(vectors, row):
    """Return a row of an array of vectors as a tuple."""
    return (vectors[row, 0], vectors[row, 1], vectors[row, 2])


@compiled(inner=True)
def write(array, v):
    """Write a vector to an array of three numbers. An assignment to ``array[:]`` would compile more slowly."""
    array[0], array[1], array[2] = v[0], v[1], v[2]


@compiled(inner=True)
def write_row(vectors, row, v):
    """Write a vector to a row of an array. An assignment to the whole row would compile more slowly."""
    vectors[row, 0], vectors[row, 1], vectors[row, 2] = v[0], v[1], v[2]


@compiled(inner=True)
def between(points, start, end):
    """Return the vector from one row of an array of points to another."""
    return (points[end, 0] - points[start, 0], points[end, 1] - points[start, 1], points[end, 2] - points[start, 2])


@compiled(inner=True)
def blend(a, b, share):
    """Return a vector a share of the way from one vector to another."""
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))


@compiled(inner=True)
def in_axes(v, basis):
    """Return x · basis[0] + y · basis[1] + z · basis[2] for a vector (x, y, z)."""
    x, y, z = v[0], v[1], v[2]
    return (
        x * basis[0, 0] + y * basis[1, 0] + z * basis[2, 0],
        x * basis[0, 1] + y * basis[1, 1] + z * basis[2, 1],
        x * basis[0, 2] + y * basis[1, 2] + z * basis[2, 2],
    )
