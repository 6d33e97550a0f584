"""Completion of surfaces for display: consistent winding, normals, and double-sided materials for open parts."""

from dataclasses import replace

import igl
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from engine_bridge.character.surfaces.surface import Piece, Surface, count
from puppetline.errors import MeshError
from solver.surface.mesh import SolverMesh, weld
from solver.surface.winding import distinct_rows, edges_of, wound_outwards

MIN_SIZE = 1e-30
"""Minimum size of a surface whose areas can be compared."""

HARD_EDGE_COSINE, FLAT_EDGE_COSINE = np.cos(np.radians(40)), np.cos(np.radians(2))
"""Cosines of the angles between two faces beyond which their edge is hard, and beyond which it is not flat."""

UP = (0.0, 1.0, 0.0)
"""Normal of a vertex without a face of positive area."""


def shaded(surface: Surface, name: str) -> Surface:
    """Complete a surface without changing the order or number of its vertices and triangles.

    If no piece has normals, triangles that contradict their neighbours or face the inside of a closed part are flipped.
    Missing normals are computed: smooth ones across all vertices at one position, or those of the triangles for a
    faceted surface (`Surface.faceted`). A surface with mostly hard edges and no normals gets none, so that viewers use
    flat shading. Pieces of open parts get a double-sided material.

    Parameters
    ----------
    surface : Surface
    name : str
        Name of the surface in error messages.

    Raises
    ------
    MeshError
        There is no surface, see `solver.surface.mesh.weld`, or a tiny one.
    """
    positions = np.concatenate([piece.positions for piece in surface.pieces])
    starts = np.cumsum([0] + [len(piece.positions) for piece in surface.pieces])
    triangles = np.concatenate([piece.triangles + start for piece, start in zip(surface.pieces, starts, strict=False)])
    _check_size(positions, triangles, name)
    has_normals = any(piece.normals is not None for piece in surface.pieces)
    origin = surface.origin
    # with the positions that the character will have, so that it is not welded again
    mesh = weld((positions - origin).astype(np.float32) + origin, triangles, name)
    turned, is_open, normals = _shading(mesh, positions, triangles, has_normals, surface.faceted)
    notes = list(dict.fromkeys(surface.notes))
    if turned.any():
        triangles[turned] = triangles[turned, ::-1]
        notes.append(
            f"{count(int(turned.sum()), 'triangle')} of {len(triangles):,} faced the wrong way and were flipped."
        )
    places = np.cumsum([0] + [len(piece.triangles) for piece in surface.pieces])
    pieces = []
    for index, piece in enumerate(surface.pieces):
        own = slice(places[index], places[index + 1])
        computed = None if normals is None else normals[starts[index] : starts[index + 1]]
        sides = piece.material.double_sided or bool(is_open[own].any())
        pieces.append(
            replace(
                piece,
                triangles=triangles[own] - starts[index],
                normals=computed if piece.normals is None or computed is None else unit(piece.normals, computed),
                material=replace(piece.material, double_sided=sides),
            )
        )
    return replace(surface, pieces=pieces, notes=notes + _lost_normals(surface.pieces))


def _shading(
    mesh: SolverMesh, positions: NDArray[np.float64], triangles: NDArray[np.int64], has_normals: bool, faceted: bool
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64] | None]:
    """Return which triangles to flip, which are in open parts, and normals unless the surface is angular."""
    welded, vertices = mesh.of_render[triangles], mesh.vertices.copy()
    vertices[welded] = positions[triangles]
    is_right = has_normals or not mesh.repairs.turned + mesh.repairs.doubled  # the file's winding
    turned = np.zeros(len(triangles), dtype=np.bool_) if is_right else wrongly_wound(vertices, welded)
    triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    welded = np.where(turned[:, None], welded[:, ::-1], welded)
    is_open = in_open_part(welded, len(vertices))
    if faceted:
        return turned, is_open, _facet_normals(positions, triangles)
    if not has_normals and is_angular(vertices, mesh.faces):
        return turned, is_open, None
    first, is_back = _sides(welded)
    normals = unit(igl.per_vertex_normals(vertices, welded[first])[mesh.of_render], UP)
    if is_back.any():
        normals[np.setdiff1d(triangles[is_back], triangles[~is_back])] *= -1
    return turned, is_open, normals


def _check_size(positions: NDArray[np.float64], triangles: NDArray[np.int64], name: str) -> None:
    """Refuse a surface so small that its area underflows."""
    used = np.zeros(len(positions), dtype=np.bool_)
    used[triangles] = True
    size = float(np.ptp(positions[used], axis=0).max()) if used.any() else 0.0
    if 0 < size < MIN_SIZE:
        raise MeshError(
            name,
            found=f"a surface of size {size:.3g}",
            expected=f"a surface of size {MIN_SIZE:g} or more",
            fix="Check the scale that the mesh was exported with.",
        )


def wrongly_wound(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which triangles have the wrong winding, see `solver.surface.winding.wound_outwards`.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (t, 3) int64
        Degenerate triangles are never wrong.

    Returns
    -------
    (t,) bool
    """
    a, b, c = faces.T
    proper = faces[(a != b) & (b != c) & (c != a)]
    turned = np.zeros(len(faces), dtype=bool)
    turned[(a != b) & (b != c) & (c != a)] = (wound_outwards(vertices, proper) != proper).any(axis=1)
    return turned


def in_open_part(faces: NDArray[np.int64], vertices: int) -> NDArray[np.bool_]:
    """Return which of the (t, 3) faces are in a part with an edge where the surface ends or its winding flips.

    The edges of two equal faces with opposite windings are not such edges.
    """
    ends = faces[_unbalanced(faces)]
    if not len(ends):
        return np.zeros(len(faces), dtype=np.bool_)
    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    links = scipy.sparse.coo_matrix((np.ones(len(edges)), edges.T), shape=(vertices, vertices))
    part = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    is_open = np.zeros(len(part), dtype=np.bool_)
    is_open[part[ends[:, 0]]] = True
    return is_open[part[faces[:, 0]]]


def is_angular(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bool:
    """Return whether most of the length of edges that are not flat is hard, as in furniture and crystals."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    normals = unit(np.cross(b - a, c - a), UP)
    edges, of_side, _ = edges_of(faces)
    order = np.argsort(of_side, kind="stable")
    edge, face = of_side[order], order // 3
    shared = np.flatnonzero(edge[1:] == edge[:-1])
    cosine = np.einsum("ec,ec->e", normals[face[shared]], normals[face[shared + 1]])
    length = np.linalg.norm(np.subtract(*vertices[edges[edge[shared]].T]), axis=1)
    return bool(length[cosine < HARD_EDGE_COSINE].sum() > 0.5 * length[cosine < FLAT_EDGE_COSINE].sum())


def _unbalanced(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which faces (t,) have an edge that is not traversed equally often in both directions."""
    _, edge, _ = edges_of(faces)
    balance = np.bincount(edge, np.sign(np.roll(faces, -1, axis=1) - faces).ravel())
    a, b, c = (balance[edge] != 0).reshape(-1, 3).T
    return a | b | c


def _sides(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the first of all faces with the same vertices, and which of the (t,) faces are backs of these."""
    first, kind = distinct_rows(np.sort(faces, axis=1))
    order = np.argsort(faces, axis=1)
    is_even = (order[:, 1] - order[:, 0]) % 3 == 1
    return first, is_even != is_even[first[kind]]


def _facet_normals(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    normals = np.zeros_like(positions)
    normals[triangles] = np.cross(b - a, c - a)[:, None]
    return unit(normals, UP)


def unit(vectors: NDArray[np.float64], otherwise: ArrayLike) -> NDArray[np.float64]:
    """Return unit vectors (n, 3), with `otherwise` for vectors without a direction."""
    x, y, z = np.abs(vectors).T
    largest = np.maximum(np.maximum(x, y), z)[:, None]  # several times as fast as a maximum along rows
    good = (largest > 0) & np.isfinite(largest)
    vectors = np.where(good, vectors, otherwise) / np.where(good, largest, 1.0)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def _lost_normals(pieces: list[Piece]) -> list[str]:
    own = [piece.normals for piece in pieces if piece.normals is not None]
    lost = sum(int((~normals.any(axis=1) | ~np.isfinite(normals).all(axis=1)).sum()) for normals in own)
    return [f"{count(lost, 'normal')} had no direction and were computed."] if lost else []
