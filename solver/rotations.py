"""One rotation an isoline from the current surface, in the two ways that the literature has.

Both read the surface through *strips*, the triangles that an isoline crosses, and both begin with a linear map of the
control variables R, so that the iteration never touches a vertex. Rotations are kept for row vectors: x' = x · Rot.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from solver import polar
from solver.mesh import SolverMesh

RotationMode = Literal["covariance", "triangles"]

SAMPLED_TRIANGLES = 10
"""Triangles an isoline in the paper's update; 80 isolines then have about the n_tri of its Table 1."""


def crossed_triangles(ladder: NDArray[np.float64], faces: NDArray[np.int64], isolines: int) -> list[NDArray[np.int64]]:
    """List the triangles that each isoline crosses.

    An isoline that falls into the gap between two separate parts crosses none and gets the nearest ones instead.

    Parameters
    ----------
    ladder : (n, n_e) float64
    faces : (t, 3) int64
    isolines : int

    Returns
    -------
    list of n_e · n_iso int64 arrays
        Indices of faces, ascending.
    """
    strips = []
    for field in ladder.T:
        levels = field[faces]
        low, high = levels.min(axis=1), levels.max(axis=1)
        for level in range(isolines):
            strip = np.flatnonzero((low <= level) & (level <= high) & (low < high))
            if not len(strip):
                strip = np.sort(np.argsort(np.abs(levels.mean(axis=1) - level), kind="stable")[:SAMPLED_TRIANGLES])
            strips.append(strip)
    return strips


def covariance_map(mesh: SolverMesh, strips: list[NDArray[np.int64]], W: csr_matrix) -> NDArray[np.float64]:
    """Build Q: S = Q R stacks, for each isoline, Σ area · e_restᵀ e_def over the edges of its whole strip.

    Returns
    -------
    (3 · isolines, 4 · isolines) float64
    """
    isoline = np.repeat(np.arange(len(strips)), [len(strip) for strip in strips])
    corners = mesh.faces[np.concatenate(strips)]
    points = mesh.vertices[corners]
    area = 0.5 * np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1)
    rows, columns, values = [], [], []
    for tail, head in ((0, 1), (1, 2), (2, 0)):
        edge = area[:, None] * (points[:, head] - points[:, tail])
        for axis in range(3):
            for corner, sign in ((head, 1.0), (tail, -1.0)):
                rows.append(3 * isoline + axis)
                columns.append(corners[:, corner])
                values.append(sign * edge[:, axis])
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    gather = csr_matrix(coo_matrix(entries, shape=(3 * len(strips), len(mesh.vertices))))
    return (gather @ W).toarray()


def sample_strips(mesh: SolverMesh, strips: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Take `SAMPLED_TRIANGLES` of each strip, each as far as possible from those already taken.

    Spread round the isoline they stand for all of it; taken by number they may all lie on one side. A strip with fewer
    triangles gives some of them more than once.

    Returns
    -------
    (isolines, SAMPLED_TRIANGLES) int64
        Indices of faces.
    """
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    sampled = np.empty((len(strips), SAMPLED_TRIANGLES), dtype=np.int64)
    for row, strip in zip(sampled, strips, strict=True):
        points = middles[strip]
        distance = np.linalg.norm(points - points.mean(axis=0), axis=1)
        for place in range(SAMPLED_TRIANGLES):
            farthest = int(np.argmax(distance))
            row[place] = strip[farthest]
            from_it = np.linalg.norm(points - points[farthest], axis=1)
            distance = from_it if place == 0 else np.minimum(distance, from_it)
    return sampled


def edge_map(mesh: SolverMesh, sampled: NDArray[np.int64], W: csr_matrix) -> NDArray[np.float64]:
    """Build T: T R stacks the two edges from the first corner of every sampled triangle.

    Returns
    -------
    (2 · isolines · SAMPLED_TRIANGLES, 4 · isolines) float64
    """
    a, b, c = mesh.faces[sampled.ravel()].T
    edges = np.stack([(W[b] - W[a]).toarray(), (W[c] - W[a]).toarray()], axis=1)
    return edges.reshape(-1, W.shape[1])


def from_covariance(S: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations nearest to the blocks of S by polar decomposition.

    Parameters
    ----------
    S : (3 · m, 3) float64

    Returns
    -------
    (m, 3, 3) float64
        Determinant +1.
    """
    return polar.of_matrices(S.reshape(-1, 3, 3))


def from_edges(edges: NDArray[np.float64], rest_frames: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compare sampled triangles with their rest frames, average over each isoline, and make orthogonal.

    Parameters
    ----------
    edges : (2 · m · SAMPLED_TRIANGLES, 3) float64
        T R.
    rest_frames : (m, SAMPLED_TRIANGLES, 3, 3) float64
        `triangle_frames` of the rest pose.

    Returns
    -------
    (m, 3, 3) float64
    """
    frames = triangle_frames(edges)
    turns = np.einsum("msji,msjk->mik", rest_frames, frames)
    return from_covariance(turns.reshape(-1, 3))


def triangle_frames(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an orthonormal frame of each triangle, axes as rows: along its first edge, in its plane, its normal.

    Parameters
    ----------
    edges : (2 · m · SAMPLED_TRIANGLES, 3) float64

    Returns
    -------
    (m, SAMPLED_TRIANGLES, 3, 3) float64
    """
    first, second = np.moveaxis(edges.reshape(-1, SAMPLED_TRIANGLES, 2, 3), 2, 0)
    normal = np.cross(first, second)
    along = first / np.maximum(np.linalg.norm(first, axis=2, keepdims=True), 1e-300)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-300)
    return np.stack([along, np.cross(normal, along), normal], axis=2)
