"""One rotation per isoline from the deformed surface: from the covariance of edges, or from sampled triangles.

Both use *strips*, the triangles that an isoline crosses, and begin with a linear map of the control variables R, so
that the iteration does not compute vertices. Rotations are for row vectors: x' = x · Rot.
"""

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model import polar
from solver.model.fields import blends
from solver.surface.mesh import SolverMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

RotationMode = Literal["clusters", "covariance", "triangles"]

TRIANGLES_PER_ISOLINE = 10
"""Number of triangles per isoline in the paper's update; 80 isolines then have about the n_tri of its Table 1."""


def crossed_triangles(
    isoline_coordinates: NDArray[np.float64], faces: NDArray[np.int64], isolines: int
) -> list[NDArray[np.int64]]:
    """List the triangles that each isoline crosses.

    An isoline in the gap between two separate parts crosses none and has the nearest triangles instead.

    Parameters
    ----------
    isoline_coordinates : (n, n_e) float64
    faces : (t, 3) int64
    isolines : int

    Returns
    -------
    list of n_e · n_iso int64 arrays
        Indices of faces, ascending.
    """
    m = isoline_coordinates.shape[1] * isolines
    counts = _count_crossed(isoline_coordinates, faces, isolines, m)
    crossed = np.split(
        _crossed(isoline_coordinates, faces, isolines, np.cumsum(counts) - counts, int(counts.sum())),
        np.cumsum(counts)[:-1],
    )
    for isoline in np.flatnonzero(counts == 0):
        field, level = divmod(int(isoline), isolines)
        away = np.abs(isoline_coordinates[:, field][faces].mean(axis=1) - level)
        crossed[isoline] = np.sort(np.argsort(away, kind="stable")[:TRIANGLES_PER_ISOLINE])
    return crossed


@compiled
def _levels(isoline_coordinates, face, field):
    """Return the first level of a field that a face reaches, and the one after the last."""
    a, b, c = (
        isoline_coordinates[face[0], field],
        isoline_coordinates[face[1], field],
        isoline_coordinates[face[2], field],
    )
    low, high = min(a, b, c), max(a, b, c)
    return (int(np.ceil(low)), int(np.floor(high)) + 1) if low < high else (0, 0)


@compiled
def _count_crossed(isoline_coordinates, faces, isolines, m):
    counts = np.zeros(m, dtype=np.int64)
    for f in range(len(faces)):
        for field in range(isoline_coordinates.shape[1]):
            first, stop = _levels(isoline_coordinates, faces[f], field)
            for level in range(first, stop):
                counts[field * isolines + level] += 1
    return counts


@compiled
def _crossed(isoline_coordinates, faces, isolines, starts, total):
    """Return the faces that each isoline crosses, those of isoline j from starts[j] on."""
    crossed, place = np.empty(total, dtype=np.int64), starts.copy()
    for f in range(len(faces)):
        for field in range(isoline_coordinates.shape[1]):
            first, stop = _levels(isoline_coordinates, faces[f], field)
            for isoline in range(field * isolines + first, field * isolines + stop):
                crossed[place[isoline]] = f
                place[isoline] += 1
    return crossed


def covariance_map(
    mesh: SolverMesh,
    strips: list[NDArray[np.int64]],
    isoline_coordinates: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Build Q: S = Q R stacks, for each isoline, Σ area · e_restᵀ e_def over the edges of its whole strip.

    Parameters
    ----------
    mesh : SolverMesh
        In the units of the model.
    strips : list of n_e · n_iso int64 arrays
        From `crossed_triangles`.
    isoline_coordinates : (n, n_e) float64
    weights : (n_e,) float64

    Returns
    -------
    (3 · isolines, 4 · isolines) float64
    """
    below, upper = blends(isoline_coordinates, len(strips) // len(weights))
    Q = np.zeros((3 * len(strips), 4 * len(strips)))
    for isoline, strip in enumerate(strips):
        _add_covariance(mesh.vertices, mesh.faces[strip], below, upper, weights, Q[3 * isoline : 3 * isoline + 3])
    return Q


@compiled
def _add_covariance(rest, faces, below, upper, weights, rows):
    """Add the covariances of faces: each corner is in two edges."""
    isolines = rows.shape[1] // (4 * len(weights))
    edge, h = np.empty(3), np.ones(4)
    for f in range(len(faces)):
        a, b, c = rest[faces[f, 0]], rest[faces[f, 1]], rest[faces[f, 2]]
        area = 0.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            area += ((b[y] - a[y]) * (c[z] - a[z]) - (b[z] - a[z]) * (c[y] - a[y])) ** 2
        area = 0.5 * np.sqrt(area)
        for v in faces[f]:
            for x in range(3):
                h[x] = rest[v, x]
                edge[x] = area * ((h[x] - a[x]) + (h[x] - b[x]) + (h[x] - c[x]))
            for i in range(len(weights)):
                column = 4 * (i * isolines + below[v, i])
                highest = weights[i] * upper[v, i]
                lowest = weights[i] - highest
                for x in range(3):
                    for k in range(4):
                        rows[x, column + k] += lowest * edge[x] * h[k]
                        rows[x, column + 4 + k] += highest * edge[x] * h[k]


def sample_strips(mesh: SolverMesh, strips: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Take a farthest-point sample of `TRIANGLES_PER_ISOLINE` triangles of each strip.

    They are spread all round the isoline; triangles with evenly spaced indices may all be on one side. A strip with
    fewer triangles repeats some of them.

    Returns
    -------
    (isolines, TRIANGLES_PER_ISOLINE) int64
        Indices of faces.
    """
    return np.stack(
        [
            strip[_farthest_points(mesh.vertices[mesh.faces[strip]].mean(axis=1), TRIANGLES_PER_ISOLINE)]
            for strip in strips
        ]
    )


@compiled
def _farthest_points(points, count):
    """Choose points: the farthest from the mean, then the farthest from those already chosen."""
    n = len(points)
    away, target = np.full(n, np.inf), np.zeros(3)
    for i in range(n):
        target += points[i] / n
    chosen = np.empty(count, dtype=np.int64)
    for place in range(count):
        farthest = 0
        for i in range(n):
            square = 0.0
            for x in range(3):
                square += (points[i, x] - target[x]) ** 2
            away[i] = square if place <= 1 else min(away[i], square)
            if away[i] > away[farthest]:
                farthest = i
        chosen[place] = farthest
        target = points[farthest]
    return chosen


def edge_map(corners: "csr_matrix") -> NDArray[np.float64]:
    """Build T: T R stacks the two edges from the first corner of every sampled triangle.

    Parameters
    ----------
    corners : (isolines · TRIANGLES_PER_ISOLINE · 3, 4 · isolines) sparse float64
        Rows of W for the corners of each triangle.

    Returns
    -------
    (2 · isolines · TRIANGLES_PER_ISOLINE, 4 · isolines) float64
    """
    rows = corners.toarray().reshape(-1, 3, corners.shape[1])
    return (rows[:, 1:] - rows[:, :1]).reshape(-1, corners.shape[1])


def from_edges(edges: NDArray[np.float64], rest_frames: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean rotation of each isoline's sampled triangles from their rest frames.

    Parameters
    ----------
    edges : (2 · m · TRIANGLES_PER_ISOLINE, 3) float64
        T R.
    rest_frames : (m, TRIANGLES_PER_ISOLINE, 3, 3) float64
        `triangle_frames` of the rest pose.

    Returns
    -------
    (m, 3, 3) float64
    """
    total = np.zeros((len(rest_frames), 3, 3))
    _add_turns(edges, rest_frames, total)
    return polar.of_matrices(total)


def triangle_frames(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an orthonormal frame of each triangle, axes as rows: its first edge, its normal × that edge, its normal.

    Parameters
    ----------
    edges : (2 · m · TRIANGLES_PER_ISOLINE, 3) float64

    Returns
    -------
    (m, TRIANGLES_PER_ISOLINE, 3, 3) float64
    """
    frames = np.empty((len(edges) // (2 * TRIANGLES_PER_ISOLINE), TRIANGLES_PER_ISOLINE, 3, 3))
    _write_frames(np.ascontiguousarray(edges), frames.reshape(-1, 3, 3))
    return frames


@compiled
def _write_frames(edges, frames):
    for k in range(len(frames)):
        _write_frame(edges[2 * k], edges[2 * k + 1], frames[k])


@compiled
def _write_frame(first, second, frame):
    along, across, normal = frame
    _unit_cross(first, second, normal)
    length = max(np.sqrt(first[0] ** 2 + first[1] ** 2 + first[2] ** 2), 1e-300)
    for axis in range(3):
        along[axis] = first[axis] / length
    _unit_cross(normal, along, across)


@compiled
def _unit_cross(a, b, out):
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    length = max(np.sqrt(x * x + y * y + z * z), 1e-300)
    out[0], out[1], out[2] = x / length, y / length, z / length


@compiled
def _add_turns(edges, rest_frames, total):
    """Add up the rotations of each isoline's sampled triangles from their rest frames to their current frames."""
    frame = np.empty((3, 3))
    triangle = 0
    for isoline in range(len(rest_frames)):
        for rest in rest_frames[isoline]:
            _write_frame(edges[2 * triangle], edges[2 * triangle + 1], frame)
            triangle += 1
            for i in range(3):
                for j in range(3):
                    for axis in range(3):
                        total[isoline, i, j] += rest[axis, i] * frame[axis, j]
