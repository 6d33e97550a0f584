"""The solver mesh: welded, without degenerate faces, and which render vertex follows which of its vertices."""

from dataclasses import dataclass
from functools import cached_property

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from puppetline.errors import MeshError

WELD_TOLERANCE = 1e-6
"""Render vertices no farther apart than this, as a fraction of the diagonal, are one solver vertex."""


@dataclass(frozen=True)
class SolverMesh:
    """One surface to deform, and its relation to the mesh that is rendered.

    Attributes
    ----------
    vertices : (n, 3) float64
        Welded positions in the mesh file's coordinates; every one belongs to a face.
    faces : (t, 3) int64
        Triangles without zero area and without doubles.
    of_render : (N,) int64
        For each render vertex the solver vertex whose motion it follows.
    name : str
        What error messages call it.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    of_render: NDArray[np.int64]
    name: str = "mesh"

    @cached_property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, the unit of every tolerance."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """(e, 2) vertex indices, each undirected edge once."""
        return undirected_edges(self.faces)

    @cached_property
    def components(self) -> NDArray[np.int32]:
        """(n,) number of the connected part that each vertex belongs to."""
        n = len(self.vertices)
        a, b = self.edges.T
        return connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[1]


def undirected_edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (e, 2) edges of (t, 3) faces, the smaller index first, each once."""
    pairs = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(pairs, axis=0)


def weld(positions: NDArray[np.float64], triangles: NDArray[np.int64], name: str = "mesh") -> SolverMesh:
    """Make the solver mesh of a render mesh.

    Vertices at one place become one, so that texture and normal seams do not tear; faces that then have no area or
    stand there twice are dropped. Render vertices in no face follow the nearest solver vertex.

    Parameters
    ----------
    positions : (N, 3) float
        Render vertices.
    triangles : (T, 3) int
        Indices into them.
    name : str
        What an error message calls the mesh.

    Raises
    ------
    MeshError
        Positions that are not finite, indices out of range, or no surface left.
    """
    positions = np.asarray(positions, dtype=np.float64)
    triangles = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    _check(positions, triangles, name)
    used, corners = np.unique(triangles, return_inverse=True)
    diagonal = float(np.linalg.norm(np.ptp(positions[used], axis=0)))
    first, place_of = _places(positions[used], WELD_TOLERANCE * diagonal)
    vertices = positions[used[first]]

    faces = _proper_faces(vertices, place_of[corners.reshape(-1, 3)])
    if len(faces) < 4:
        raise MeshError(
            name,
            found=f"{len(faces)} faces with an area",
            expected="a surface of at least 4 triangles",
            fix="Choose a file that holds a surface, not points, lines or a single polygon.",
        )
    kept = np.unique(faces)
    compact = np.full(len(vertices), -1)
    compact[kept] = np.arange(len(kept))
    of_render = np.full(len(positions), -1)
    of_render[used] = compact[place_of]
    isolated = of_render < 0
    if isolated.any():
        of_render[isolated] = cKDTree(vertices[kept]).query(positions[isolated])[1]
    return SolverMesh(vertices[kept], compact[faces], of_render, name)


def _places(points: NDArray[np.float64], tolerance: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find points that are no farther apart than the tolerance.

    Cells alone would part neighbours on either side of a cell's wall; a search for pairs alone would drown in a file
    that holds thousands of vertices at one point. So one point a cell goes into the search.

    Returns
    -------
    first : (p,) int64
        The first point of each place, ascending: in the file's order, so that neighbours in memory stay neighbours.
    place_of : (n,) int64
        The place of each point.
    """
    cells = np.round((points - points.min(axis=0)) / tolerance).astype(np.int64)
    _, first, cell_of = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    a, b = cKDTree(points[first]).query_pairs(tolerance, output_type="ndarray").T
    count = len(first)
    label = connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count)), directed=False)[1]
    _, first, place_of = np.unique(label[cell_of.reshape(-1)], return_index=True, return_inverse=True)
    order = np.argsort(first)
    return first[order], np.argsort(order)[place_of]


def _check(positions: NDArray[np.float64], triangles: NDArray[np.int64], name: str) -> None:
    if not len(positions) or not len(triangles):
        raise MeshError(
            name,
            found=f"{len(positions)} vertices and {len(triangles)} triangles",
            expected="a triangle surface",
            fix="Choose a file that holds a mesh.",
        )
    bad = ~np.isfinite(positions).all(axis=1)
    if bad.any():
        raise MeshError(
            name,
            found=f"a position that is not a finite number at vertex {int(np.argmax(bad))}",
            expected="finite coordinates",
            fix="Export the mesh again, or remove that vertex in an editor.",
        )
    out = (triangles < 0) | (triangles >= len(positions))
    if out.any():
        face = int(np.argmax(out.any(axis=1)))
        raise MeshError(
            name,
            found=f"vertex index {int(triangles[out][0])} in triangle {face}",
            expected=f"indices from 0 to {len(positions) - 1}",
            fix="The file is damaged: export the mesh again.",
        )
    if not np.ptp(positions[np.unique(triangles)], axis=0).any():
        raise MeshError(
            name,
            found="all vertices at one point",
            expected="a surface with an extent",
            fix="Check the scale that the mesh was exported with.",
        )


def _proper_faces(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Drop faces with two equal corners, without area, or present already."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    corners = vertices[faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    height = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = faces[height > 1e-10 * sides.max(axis=1, initial=0) ** 2]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return faces[np.sort(first)]


def snap(mesh: SolverMesh, points: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Find the nearest surface point of each point.

    Parameters
    ----------
    points : (h, 3) float64
        In the mesh's coordinates.

    Returns
    -------
    corners : (h, 3) int64
        The vertices of the triangle that holds the surface point.
    blend : (h, 3) float64
        Its barycentric coordinates.
    """
    points = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    _, face, nearest = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)
    corners = mesh.faces[np.atleast_1d(face)]
    a, b, c = np.moveaxis(mesh.vertices[corners], 1, 0)
    nearest = np.reshape(nearest, (-1, 3))
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    weight_b = np.einsum("ij,ij->i", np.cross(nearest - a, c - a), normal) / area
    weight_c = np.einsum("ij,ij->i", np.cross(b - a, nearest - a), normal) / area
    return corners, np.column_stack([1 - weight_b - weight_c, weight_b, weight_c])
