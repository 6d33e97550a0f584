"""The solver mesh: welded, clean and fine enough, and which render vertex follows which of its vertices."""

from dataclasses import dataclass
from functools import cached_property

import igl
import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from puppetline.errors import MeshError
from solver.surface.winding import edges_of, in_order, outwards, pieces

WELD_TOLERANCE = 1e-6
"""Render vertices no farther apart than this, as a fraction of the diagonal, are one solver vertex."""

BLOCK = 64
"""Cells, a weld tolerance wide, along each side of a block."""

LEAST_VERTICES = 100
"""A coarser surface is split until it has as many, so that isolines have triangles to cross: a cube has 8."""


@dataclass(frozen=True)
class Repairs:
    """What was done to a render mesh to make the solver mesh of it; counts of vertices or faces.

    Attributes
    ----------
    welded : int
        Vertices that follow the same solver vertex as an earlier one at their place.
    degenerate, doubled : int
        Faces without area, and faces between the same three vertices as another one.
    isolated : int
        Vertices in no face that is left; they follow the nearest vertex that is.
    turned : int
        Faces whose two sides were exchanged, so that neighbours agree and closed surfaces face outwards.
    split : int
        Faces that were added because the surface was too coarse.
    """

    welded: int = 0
    degenerate: int = 0
    doubled: int = 0
    isolated: int = 0
    turned: int = 0
    split: int = 0

    def describe(self) -> list[str]:
        """Say in words what was done: a line for each kind, none for a mesh that was fine."""
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
    """One surface to deform, and its relation to the mesh that is rendered. Equal to itself only.

    Attributes
    ----------
    vertices : (n, 3) float64
        Welded positions in the mesh file's coordinates; every one belongs to a face, and all its faces to one part
        that hangs together at edges.
    faces : (t, 3) int64
        Triangles without zero area and without doubles; neighbours over an edge of two faces agree on the outside.
    of_render : (N,) int64
        For each render vertex the solver vertex whose motion it follows.
    name : str
        What error messages call it.
    repairs : Repairs
        How it differs from the render mesh.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    of_render: NDArray[np.int64]
    name: str = "mesh"
    repairs: Repairs = Repairs()

    @cached_property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, the unit of every tolerance."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """(e, 2) vertex indices, each undirected edge once."""
        return self._edges[0]

    @cached_property
    def components(self) -> NDArray[np.int32]:
        """(n,) number of the connected part that each vertex belongs to."""
        n = len(self.vertices)
        a, b = self.edges.T
        return scipy.sparse.csgraph.connected_components(
            scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False
        )[1]

    @cached_property
    def vertex_areas(self) -> NDArray[np.float64]:
        """(n,) float64: a third of the area of the triangles at each vertex."""
        area = igl.doublearea(self.vertices, self.faces) / 6
        return np.bincount(self.faces.ravel(), np.repeat(area, 3), len(self.vertices)).astype(np.float64)

    @property
    def parts(self) -> int:
        """How many connected parts there are."""
        return int(self.components.max()) + 1

    @property
    def border_edges(self) -> int:
        """How many edges belong to one face only."""
        return int(np.count_nonzero(self._edges[2] == 1))

    @property
    def nonmanifold_edges(self) -> int:
        """How many edges belong to three faces or more."""
        return int(np.count_nonzero(self._edges[2] > 2))

    @cached_property
    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        return edges_of(self.faces)


def weld(positions: NDArray[np.float64], triangles: NDArray[np.int64], name: str = "mesh") -> SolverMesh:
    """Make the solver mesh of a render mesh.

    Vertices at one place become one, so that texture and normal seams do not tear; faces that then have no area or
    stand there twice are dropped, the others turned so that neighbours agree on the outside. A surface with very few
    vertices is split. Render vertices in no face follow the nearest solver vertex.

    Parts that share no edge each have their own vertex where they meet: at a point an eye would turn out of its
    socket, while `solver.surface.contacts.contacts` ties it all round. A render vertex of several such
    parts follows one of them.

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
    used = _used(positions, triangles, name)
    number = np.full(len(positions), -1)
    number[used] = np.arange(len(used))
    corners = number[triangles]
    diagonal = float(np.linalg.norm(np.ptp(positions[used], axis=0)))
    first, place_of = _places(positions[used], WELD_TOLERANCE * diagonal)

    given = place_of[corners]
    has_area = _has_area(positions[used[first]], given)
    origin, solid = _parted_at_points(given[has_area], len(first))
    place_of[corners[has_area]] = solid
    vertices = positions[used[first[origin]]]
    faces = solid[_first_of_doubles(solid)]
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
    oriented = outwards(vertices, faces)
    fine_vertices, fine_faces = vertices[kept], compact[oriented]
    while len(fine_vertices) < LEAST_VERTICES:
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
    _, first, cell_of = np.unique(_codes(cells), return_index=True, return_inverse=True)
    near = np.flatnonzero(_may_have_neighbours(cells[first]))
    a, b = near[scipy.spatial.cKDTree(points[first[near]]).query_pairs(tolerance, output_type="ndarray")].T
    count = len(first)
    label = scipy.sparse.csgraph.connected_components(
        scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count)), directed=False
    )[1]
    _, first, place_of = np.unique(label[cell_of], return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[place_of]


def _codes(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return one number for the three of each cell: each is at most 1 / `WELD_TOLERANCE`, less than 2²¹."""
    return (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]


def _may_have_neighbours(cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell which cells are at the wall of a block of cells, or share their block with others: the rest stands alone."""
    block, inside = np.divmod(cells, BLOCK)
    at_wall = ((inside == 0) | (inside == BLOCK - 1)).any(axis=1)
    _, block_of, cells_in = np.unique(_codes(block), return_inverse=True, return_counts=True)
    return at_wall | (cells_in[block_of] > 1)


def _used(positions: NDArray[np.float64], triangles: NDArray[np.int64], name: str) -> NDArray[np.int64]:
    """Return the vertices that triangles use, ascending, if all is as it should be."""
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
    """Say which faces have three different corners that are not on a line."""
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
    """Say which faces are not between the same corners as an earlier one."""
    corners = np.sort(faces, axis=1)
    order = in_order(corners, int(faces.max(initial=-1)) + 1)
    again = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    first = np.ones(len(faces), dtype=bool)
    first[order[1:][again]] = False
    return first


def _parted_at_points(faces: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Give each part that hangs together at edges its own copy of a vertex that it shares with others.

    Parameters
    ----------
    faces : (t, 3) int64
        Doubled ones may be among them: they belong to the part of the face that they double.
    count : int
        How many vertices there are.

    Returns
    -------
    origin : (n,) int64
        The vertex that each one is a copy of: the vertices that were there, then the copies.
    parted : (t, 3) int64
        The faces between them.
    """
    edges, of_side, _ = edges_of(faces)
    part = pieces(of_side, len(edges))[:, None]
    owner = np.zeros(count, dtype=np.int64)
    owner[faces[::-1]] = part[::-1]  # the last one written stays: the part that comes first in the file
    foreign = owner[faces] != part
    pairs = np.column_stack([faces[foreign], np.broadcast_to(part, faces.shape)[foreign]])
    copies, copy_of = np.unique(pairs, axis=0, return_inverse=True)
    parted = faces.copy()
    parted[foreign] = count + copy_of.reshape(-1)
    return np.concatenate([np.arange(count), copies[:, 0]]), parted


def _split(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Split every triangle into four at the middles of its sides, which come after the vertices that are there."""
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
    # only triangles that reach as near as the nearest vertex: to sort all of them takes longer than to look at each
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
    """Say of each face whether its bounding box is as near to one of the points as the nearest vertex is."""
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
