"""The solver mesh: a welded, repaired and sufficiently fine copy of a render mesh."""

from dataclasses import dataclass
from functools import cached_property

import igl
import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from puppetline.errors import MeshError
from solver.surface.disjoint_sets import join, number_sets
from solver.surface.near_points import group_near
from solver.surface.winding import edges_of, lexicographic_order, pieces, wound_outwards

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
        return _parts(self.faces, len(self.vertices))

    @cached_property
    def vertex_areas(self) -> NDArray[np.float64]:
        """(n,) float64: a third of the area of the triangles at each vertex."""
        area = igl.doublearea(self.vertices, self.faces) / 6
        return np.bincount(self.faces.ravel(), np.repeat(area, 3), len(self.vertices)).astype(np.float64)

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


@compiled
def _parts(faces, count):
    """Return the connected part of each vertex (count,), numbered in the order of their first vertices."""
    part = np.arange(count, dtype=np.int32)
    for f in range(len(faces)):
        for corner in range(1, 3):
            join(part, faces[f, 0], faces[f, corner])
    number_sets(part)
    return part


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
    positions = np.asarray(positions, dtype=np.float64)
    triangles = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
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
    may_repeat = _may_repeat(*sides)
    faces = solid[_first_of_doubles(solid)] if may_repeat else solid
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
    oriented = wound_outwards(vertices, faces, None if may_repeat else sides)
    del sides
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


@compiled
def _has_area(vertices, faces):
    """Return which faces have three different corners that are not on a line."""
    result = np.empty(len(faces), dtype=np.bool_)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        height, ab, bc, ca = 0.0, 0.0, 0.0, 0.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            height += ((b[y] - a[y]) * (c[z] - a[z]) - (b[z] - a[z]) * (c[y] - a[y])) ** 2
            ab += (b[x] - a[x]) ** 2
            bc += (c[x] - b[x]) ** 2
            ca += (a[x] - c[x]) ** 2
        result[f] = min(ab, bc, ca) > 0 and np.sqrt(height) > 1e-10 * max(ab, bc, ca)
    return result


def _first_of_doubles(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which faces do not have the same corners as an earlier face."""
    corners = np.sort(faces, axis=1)
    order = lexicographic_order(corners, int(faces.max(initial=-1)) + 1)
    again = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    first = np.ones(len(faces), dtype=bool)
    first[order[1:][again]] = False
    return first


@compiled
def _may_repeat(of_side, faces_of_edge):
    """Return whether a face may have the same corners as another one, which then shares two edges with it."""
    faces = np.zeros(len(faces_of_edge), dtype=np.int64)
    for side in range(len(of_side)):
        if faces_of_edge[of_side[side]] > 2:
            return True
        faces[of_side[side]] += side // 3
    for face in range(len(of_side) // 3):
        a, b, c = of_side[3 * face], of_side[3 * face + 1], of_side[3 * face + 2]
        if faces_of_edge[a] == 2 and (
            (faces_of_edge[b] == 2 and faces[a] == faces[b]) or (faces_of_edge[c] == 2 and faces[a] == faces[c])
        ):
            return True
    return False


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
    # only triangles whose bounding box is as near as the nearest vertex: libigl's tree of all triangles costs more
    candidates = mesh.faces[_near_any(points, mesh.vertices, mesh.faces)]
    _, face, nearest = igl.point_mesh_squared_distance(points, mesh.vertices, candidates)
    corners = candidates[np.atleast_1d(face)]
    a, b, c = np.moveaxis(mesh.vertices[corners], 1, 0)
    nearest = np.reshape(nearest, (-1, 3))
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    weight_b = np.einsum("ij,ij->i", np.cross(nearest - a, c - a), normal) / area
    weight_c = np.einsum("ij,ij->i", np.cross(b - a, nearest - a), normal) / area
    return corners, np.column_stack([1 - weight_b - weight_c, weight_b, weight_c])


@compiled
def _near_any(points, vertices, faces):
    """Return which faces have a bounding box that is as near to one of the points as the nearest vertex is."""
    near = np.zeros(len(faces), dtype=np.bool_)
    for point in points:
        least = np.inf
        for v in range(len(vertices)):
            x, y, z = vertices[v, 0] - point[0], vertices[v, 1] - point[1], vertices[v, 2] - point[2]
            least = min(least, x * x + y * y + z * z)
        least *= 1 + 1e-9
        for f in range(len(faces)):
            square = 0.0
            for axis in range(3):
                a, b, c = vertices[faces[f, 0], axis], vertices[faces[f, 1], axis], vertices[faces[f, 2], axis]
                away = max(min(a, b, c) - point[axis], point[axis] - max(a, b, c), 0.0)
                square += away * away
            near[f] |= square <= least
    return near
