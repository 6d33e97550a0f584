"""The solver mesh: a welded, repaired and sufficiently fine copy of a render mesh."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import igl
import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.errors import MeshError
from solver.surface.near_points import connected_components, group_near
from solver.surface.winding import distinct_rows, edges_of, pieces, wound_outwards

WELD_TOLERANCE_DIAGONALS = 1e-6
"""Largest distance between render vertices that become one solver vertex, as a fraction of the diagonal."""

MIN_VERTICES = 100
"""Fewest vertices of a solver mesh; a coarser surface is split, so that isolines have triangles to cross."""


@dataclass(frozen=True)
class Repairs:
    """Counts of the vertices and faces that were changed to make a solver mesh of a render mesh.

    Attributes
    ----------
    welded : int
        Vertices that follow the same solver vertex as an earlier one at the same position.
    degenerate, doubled : int
        Faces without area, and faces with the same three vertices as another face.
    isolated : int
        Vertices without a remaining face; they follow the nearest vertex that has one.
    turned : int
        Faces that were flipped, so that neighbours agree and closed surfaces face outwards.
    split : int
        Faces added because the surface was too coarse.
    """

    welded: int = 0
    degenerate: int = 0
    doubled: int = 0
    isolated: int = 0
    turned: int = 0
    split: int = 0

    def describe(self) -> list[str]:
        """Return one line for each kind of repair that was made."""
        lines = [
            (self.welded, "vertices that share a place with another are welded to it"),
            (self.degenerate, "faces without area are left out"),
            (self.doubled, "doubled faces are left out"),
            (self.isolated, "vertices that belong to no face follow the nearest surface"),
            (self.turned, "faces are turned over to agree with their neighbours, and to face outwards"),
            (self.split, "faces are added, for the surface is too coarse to bend"),
        ]
        return [f"{count:,} {what}" for count, what in lines if count]


@dataclass(frozen=True, eq=False)
class SolverMesh:
    """The surface to deform, and its relation to the render mesh. Instances are compared by identity.

    Attributes
    ----------
    vertices : (n, 3) float64
        Welded positions in the mesh file's coordinates. Every vertex belongs to a face, and all its faces belong to one
        part that is connected at edges.
    faces : (t, 3) int64
        Triangles with an area, each once. Neighbours at an edge of two faces agree on the outside.
    of_render : (N,) int64
        The solver vertex that each render vertex follows.
    name : str
        Name of the mesh in error messages.
    repairs : Repairs
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    of_render: NDArray[np.int64]
    name: str = "mesh"
    repairs: Repairs = Repairs()

    @cached_property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, in which tolerances are given."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """(e, 2) int64 vertex indices, each undirected edge once."""
        return self._edges[0]

    @cached_property
    def components(self) -> NDArray[np.int32]:
        """(n,) int32: number of the connected part that each vertex belongs to."""
        a, b, c = self.faces.T
        return connected_components(len(self.vertices), np.concatenate([a, a]), np.concatenate([b, c]))

    @cached_property
    def vertex_areas(self) -> NDArray[np.float64]:
        """(n,) float64: a third of the area of the triangles at each vertex."""
        area = igl.doublearea(self.vertices, self.faces) / 6
        return np.bincount(self.faces.ravel(), np.repeat(area, 3), len(self.vertices)).astype(np.float64)

    def only(self, chosen: NDArray[np.bool_]) -> "SolverMesh":
        """Return the mesh of chosen vertices (n,) alone; connected parts are chosen as a whole."""
        number = np.cumsum(chosen) - 1
        faces = number[self.faces[chosen[self.faces[:, 0]]]]
        return SolverMesh(self.vertices[chosen], faces, np.arange(number[-1] + 1), self.name)

    @property
    def parts(self) -> int:
        """Number of connected parts."""
        return int(self.components.max()) + 1

    @property
    def border_edges(self) -> int:
        """Number of edges that belong to one face only."""
        return int(np.count_nonzero(self._edges[2] == 1))

    @property
    def nonmanifold_edges(self) -> int:
        """Number of edges that belong to three faces or more."""
        return int(np.count_nonzero(self._edges[2] > 2))

    @cached_property
    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        return edges_of(self.faces)


def weld(positions: NDArray[np.float64], triangles: NDArray[np.int64], name: str = "mesh") -> SolverMesh:
    """Make the solver mesh of a render mesh.

    Vertices at the same position are merged, so that texture and normal seams do not tear. Faces without area and
    repeated faces are dropped; the others are flipped so that neighbours agree on the outside. A surface with very few
    vertices is split. Render vertices without a face follow the nearest solver vertex.

    Parts that share no edge do not share vertices: an eye that is connected to its socket at a single point would turn
    out of it. `solver.surface.contacts.contacts` ties such parts all round. A render vertex of several such parts
    follows one of them.

    Parameters
    ----------
    positions : (N, 3) float
        Render vertices.
    triangles : (T, 3) int
        Indices into them.
    name : str
        Name of the mesh in error messages.

    Raises
    ------
    MeshError
        Positions that are not finite, indices out of range, or a mesh without a surface.
    """
    return _welded(np.asarray(positions, np.float64).tobytes(), np.asarray(triangles, np.int64).tobytes(), name)


@lru_cache(maxsize=1)
def _welded(position_bytes: bytes, triangle_bytes: bytes, name: str) -> SolverMesh:
    """Return what `weld` returns; a character is welded for display, for its limbs and for its model."""
    positions = np.frombuffer(position_bytes).reshape(-1, 3)
    triangles = np.frombuffer(triangle_bytes, dtype=np.int64).reshape(-1, 3)
    used = _used(positions, triangles, name)
    number = np.full(len(positions), -1)
    number[used] = np.arange(len(used))
    corners = number[triangles]
    diagonal = float(np.linalg.norm(np.ptp(positions[used], axis=0)))
    first, place_of = group_near(positions[used], WELD_TOLERANCE_DIAGONALS * diagonal)

    given = place_of[corners]
    has_area = _has_area(positions[used[first]], given)
    sides = edges_of(given[has_area])[1:]
    origin, solid = _split_at_points(given[has_area], len(first), *sides)
    place_of[corners[has_area]] = solid
    vertices = positions[used[first[origin]]]
    faces = solid[np.sort(distinct_rows(np.sort(solid, axis=1))[0])]
    if len(faces) < 4:
        raise MeshError(
            name,
            found=f"{len(faces)} faces with an area",
            expected="a surface of at least 4 triangles",
            fix="Choose a file that holds a surface, not points, lines or a single polygon.",
        )
    compact = np.full(len(vertices), -1)
    compact[faces] = 0
    kept = np.flatnonzero(compact == 0)
    compact[kept] = np.arange(len(kept))
    of_render = np.full(len(positions), -1)
    of_render[used] = compact[place_of]
    isolated = of_render < 0
    if isolated.any():
        of_render[isolated] = scipy.spatial.cKDTree(vertices[kept]).query(positions[isolated])[1]
    oriented = wound_outwards(vertices, faces)
    fine_vertices, fine_faces = vertices[kept], compact[oriented]
    while len(fine_vertices) < MIN_VERTICES:
        fine_vertices, fine_faces = _split(fine_vertices, fine_faces)
    repairs = Repairs(
        welded=len(used) - int(np.count_nonzero(np.bincount(place_of))),
        degenerate=len(given) - len(solid),
        doubled=len(solid) - len(faces),
        isolated=int(isolated.sum()),
        turned=int((oriented != faces).any(axis=1).sum()),
        split=len(fine_faces) - len(faces),
    )
    return SolverMesh(fine_vertices, fine_faces, of_render, name, repairs)


def _used(positions: NDArray[np.float64], triangles: NDArray[np.int64], name: str) -> NDArray[np.int64]:
    """Return the vertices that triangles use, ascending, after validating the mesh."""
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
            fix="Export the mesh again: the file is damaged.",
        )
    in_face = np.zeros(len(positions), dtype=bool)
    in_face[triangles] = True
    used = np.flatnonzero(in_face)
    if not np.ptp(positions[used], axis=0).any():
        raise MeshError(
            name,
            found="all vertices at one point",
            expected="a surface with an extent",
            fix="Check the scale that the mesh was exported with.",
        )
    return used


def _has_area(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which faces have three different corners that are not on a line."""
    a, b, c = (vertices[corner] for corner in faces.T)
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    squares = igl.squared_edge_lengths(vertices, faces)
    return (squares.min(axis=1) > 0) & (height > 1e-10 * squares.max(axis=1))


def _split_at_points(
    faces: NDArray[np.int64], count: int, of_side: NDArray[np.int64], faces_of_edge: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Give each part that is connected at edges its own copy of the vertices that it shares with other parts.

    Parameters
    ----------
    faces : (t, 3) int64
        May contain repeated faces.
    count : int
        Number of vertices.
    of_side, faces_of_edge
        From `edges_of`. They are also those of the result: faces that share an edge are in one part.

    Returns
    -------
    origin : (n,) int64
        The vertex that each one is a copy of; the original vertices come first.
    split : (t, 3) int64
        The faces with the new indices.
    """
    part = pieces(of_side, len(faces_of_edge))[:, None]
    owner = np.zeros(count, dtype=np.int64)
    owner[faces[::-1]] = part[::-1]  # the last assignment wins: the part that is first in the file
    foreign = owner[faces] != part
    pairs = np.column_stack([faces[foreign], np.broadcast_to(part, faces.shape)[foreign]])
    copies, copy_of = np.unique(pairs, axis=0, return_inverse=True)
    split = faces.copy()
    split[foreign] = count + copy_of.reshape(-1)
    return np.concatenate([np.arange(count), copies[:, 0]]), split


def _split(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Split every triangle into four at the middles of its sides, which are added after the existing vertices."""
    edges, of_side, _ = edges_of(faces)
    a, b, c = faces.T
    ab, bc, ca = len(vertices) + of_side.reshape(-1, 3).T
    quarters = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return np.concatenate([vertices, vertices[edges].mean(axis=1)]), quarters


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
