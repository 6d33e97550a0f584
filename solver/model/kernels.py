"""The loops over all vertices: control variables to positions and normals.

X = W R without W: a vertex blends the transforms of two isolines per field and applies the sum to its rest position.
Each transform, times its field's weight, is a row of a table; a vertex adds up 16 rows (`simd_vector`).
"""

import numpy as np

from puppetline.compiled import compiled
from solver.model.simd_vector import add_scaled, item, load, zeros

ZERO, ONE = np.float32(0), np.float32(1)


@compiled(inner=True)
def _fill(rows, controls, weights):
    """Write each transform, times its field's weight, as a row."""
    isolines = len(controls) // len(weights)
    for j in range(len(controls)):
        weight = np.float32(weights[j // isolines])
        for row in range(3):
            for column in range(4):
                rows[j, 4 * row + column] = weight * controls[j, row, column]


@compiled(fastmath=True, error_model="numpy")
def blend_positions(rest, isoline_coordinates, controls, weights, rows, out):
    """Write the positions of vertices.

    Parameters
    ----------
    rest, out : (n, 3) float32
    isoline_coordinates : (n, n_e) float32
    controls : (m, 3, 4) float32
    weights : (n_e,) float64
        Field weights.
    rows : (m, 16) float32
        Buffer for the table of transforms; its last four columns are zero.
    """
    _fill(rows, controls, weights)
    isolines = len(controls) // len(weights)
    last = np.float32(isolines - 2)
    for v in range(len(isoline_coordinates)):
        total = zeros()
        for i in range(isoline_coordinates.shape[1]):
            below = int(min(isoline_coordinates[v, i], last))
            upper = isoline_coordinates[v, i] - np.float32(below)
            total = add_scaled(total, ONE - upper, load(rows, i * isolines + below))
            total = add_scaled(total, upper, load(rows, i * isolines + below + 1))
        x, y, z = _moved(total, rest[v, 0], rest[v, 1], rest[v, 2], ONE)
        out[v, 0], out[v, 1], out[v, 2] = x, y, z


@compiled(fastmath=True, error_model="numpy")
def blend_normals(rest, tangents, slopes, isoline_coordinates, controls, weights, rows, out, normals):
    """Write the positions and the unit normals of vertices.

    x(t) = Σ_i T_i(t_i) x₀ with T_i(t_i) linear between two isolines, so the derivative along a tangent a is
    Σ_i (T_i a + (∂t_i/∂a) (T_i,k+1 − T_i,k) x₀): the tangents also follow the change of the blend along the surface.
    Their cross product is the normal.

    Parameters
    ----------
    rest, isoline_coordinates, controls, weights, rows, out
        As in `blend_positions`.
    tangents : (n, 2, 3) float32
        Their cross product is the rest normal.
    slopes : (n, n_e, 2) float32
        Derivative of each isoline coordinate along them.
    normals : (n, 3) float32
        Zero where the surface is degenerate.
    """
    _fill(rows, controls, weights)
    isolines = len(controls) // len(weights)
    last = np.float32(isolines - 2)
    for v in range(len(isoline_coordinates)):
        total, along_a, along_b = zeros(), zeros(), zeros()
        for i in range(isoline_coordinates.shape[1]):
            below = int(min(isoline_coordinates[v, i], last))
            lower, upper = load(rows, i * isolines + below), load(rows, i * isolines + below + 1)
            step = add_scaled(upper, -ONE, lower)
            total = add_scaled(add_scaled(total, ONE, lower), isoline_coordinates[v, i] - np.float32(below), step)
            along_a = add_scaled(along_a, slopes[v, i, 0], step)
            along_b = add_scaled(along_b, slopes[v, i, 1], step)
        x, y, z = rest[v, 0], rest[v, 1], rest[v, 2]
        out[v, 0], out[v, 1], out[v, 2] = _moved(total, x, y, z, ONE)
        ax, ay, az = _moved(along_a, x, y, z, ONE)
        bx, by, bz = _moved(along_b, x, y, z, ONE)
        a = _moved(total, tangents[v, 0, 0], tangents[v, 0, 1], tangents[v, 0, 2], ZERO)
        b = _moved(total, tangents[v, 1, 0], tangents[v, 1, 1], tangents[v, 1, 2], ZERO)
        ax, ay, az, bx, by, bz = ax + a[0], ay + a[1], az + a[2], bx + b[0], by + b[1], bz + b[2]
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        scale = ONE / length if length > 0 else np.float32(0)
        normals[v, 0], normals[v, 1], normals[v, 2] = nx * scale, ny * scale, nz * scale


@compiled(inner=True, forceinline=True, fastmath=True)
def _moved(transform, x, y, z, w):
    """Apply a vector's 3 × 4 transform to (x, y, z, w)."""
    return (
        item(transform, 0) * x + item(transform, 1) * y + item(transform, 2) * z + item(transform, 3) * w,
        item(transform, 4) * x + item(transform, 5) * y + item(transform, 6) * z + item(transform, 7) * w,
        item(transform, 8) * x + item(transform, 9) * y + item(transform, 10) * z + item(transform, 11) * w,
    )
