"""Closed triangle meshes of signed distances, with a given number of vertices and well-shaped triangles.

Marching cubes in the cells near the surface, which are found from coarse to fine, make too many vertices. The shortest
edges are collapsed first, which removes slivers. Rounds of edge flips towards valence 6 and tangential smoothing follow
(isotropic remeshing of Botsch and Kobbelt 2004 without splits); each round projects the vertices onto the surface.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import igl
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from .sdf import Array

Faces = NDArray[np.int64]
Distance = Callable[[Array], Array]

VERTEX_SURPLUS = 1.5
"""Ratio of the vertices of marching cubes to those of the result."""
REMESHING_ROUNDS = 6
"""Number of rounds of flipping and smoothing."""
DISTANCE_SLACK = 2.0
"""Largest factor by which distances, warps included, may overestimate without missing a cell that is crossed."""


@dataclass(frozen=True)
class Focus:
    """A region with smaller triangles: `zoom` times as fine at its centre, and as elsewhere beyond two radii.

    The mesh is made in a space in which the region is enlarged; `apply` maps its points to the character's space. Near
    the centre it divides by `zoom`, and a Gaussian reduces the effect with the distance.
    """

    center: tuple[float, float, float]
    radius: float
    zoom: float

    def apply(self, points: Array) -> Array:
        """Return points (n, 3) of the enlarged space in the character's space."""
        local = points - np.array(self.center)
        shrink = (1.0 - 1.0 / self.zoom) * np.exp(-np.einsum("ij,ij->i", local, local) / (2.0 * self.radius**2))
        return points - shrink[:, None] * local

    def swell(self) -> float:
        """Return the largest distance by which `apply` moves a point, in metres."""
        return (1.0 - 1.0 / self.zoom) * self.radius * float(np.exp(-0.5))


def mesh(distance: Distance, low: Array, high: Array, vertices: int, foci: Sequence[Focus] = ()) -> tuple[Array, Faces]:
    """Triangulate the zero level of a distance.

    Parameters
    ----------
    distance : callable
        Points (n, 3) to signed distances (n,), negative inside.
    low, high : (3,) float64
        A box that encloses the surface.
    vertices : int
        Number of vertices of the mesh; met exactly if all collapses succeed.
    foci : sequence of Focus
        Regions with smaller triangles.

    Returns
    -------
    vertices : (n, 3) float64
    faces : (t, 3) int64
        Oriented outwards.
    """

    def warp(points: Array) -> Array:
        for focus in foci:
            points = focus.apply(points)
        return points

    def enlarged(points: Array) -> Array:
        return distance(warp(points))

    swell = sum(focus.swell() for focus in foci)
    low, extent = low - swell, float((high - low).max()) + 2 * swell
    v, f = _march(enlarged, low, extent, extent / 64)
    area = float(igl.doublearea(v, f).sum()) / 2
    # marching a plane makes |n_x| + |n_y| + |n_z| vertices per cell face: 3/2 on average over all directions
    v, f = _march(enlarged, low, extent, float(np.sqrt(1.5 * area / (VERTEX_SURPLUS * vertices))))
    genus_faces = len(f) - 2 * len(v)  # −2 χ, which edge collapses preserve
    v, f, _, _ = igl.decimate(np.asfortranarray(v), np.asfortranarray(f.astype(np.int32)), 2 * vertices + genus_faces)
    f = np.ascontiguousarray(f)
    edge = float(igl.avg_edge_length(v, f))
    for _ in range(REMESHING_ROUNDS):
        for _ in range(3):
            f = _flip(v, f)
        v = _project(enlarged, _smooth(v, f, 3), f, edge / 2)
    return warp(_project(enlarged, v, f, edge / 2)), f


def _march(distance: Distance, low: Array, extent: float, step: float) -> tuple[Array, Faces]:
    """Run marching cubes on the cells of size `step` that the surface may cross."""
    margin = 2 * step
    depth = int(np.ceil(np.log2((extent + 2 * margin) / step)))
    origin = low - margin
    start = min(depth, 4)
    cells = np.stack(np.meshgrid(*[np.arange(2**start)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for level in range(start, depth + 1):
        size = step * 2 ** (depth - level)
        crossed = np.abs(distance(origin + (cells + 0.5) * size)) < DISTANCE_SLACK * np.sqrt(0.75) * size
        cells = cells[crossed]
        if level < depth:
            children = np.stack(np.meshgrid(*[np.arange(2)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
            cells = (2 * cells[:, None] + children).reshape(-1, 3)
    corners, index, _ = igl.unique_sparse_voxel_corners(origin, step, depth, cells)
    positions = origin + corners * step
    v, f, _ = igl.marching_cubes(distance(positions), positions, index, 0.0)
    component = igl.facet_components(f)[1]  # all but the largest are closed cavities inside the solid
    f = f[component == np.bincount(component).argmax(), ::-1]
    used, f = np.unique(f, return_inverse=True)
    return v[used], f.reshape(-1, 3)


def _flip(v: Array, f: Faces) -> Faces:
    """Flip edges, none adjacent, if that brings the valences around two almost coplanar triangles closer to 6."""
    f = f.copy()
    ends = f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    key = ends.min(axis=1) * len(v) + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    one, two = order[::2], order[1::2]  # the half-edges of an edge: a → b opposite c, b → a opposite d
    apex = f[:, [2, 0, 1]].ravel()
    a, b, c, d = ends[one, 0], ends[one, 1], apex[one], apex[two]

    valence = np.bincount(f.ravel(), minlength=len(v))
    gain = valence[a] + valence[b] - valence[c] - valence[d] - 2
    sorted_key = key[one]
    wanted = np.minimum(c, d) * len(v) + np.maximum(c, d)
    at = np.minimum(np.searchsorted(sorted_key, wanted), len(sorted_key) - 1)
    pick = np.flatnonzero((gain > 0) & (valence[a] > 4) & (valence[b] > 4) & (sorted_key[at] != wanted))
    a, b, c, d, gain, one, two = (x[pick] for x in (a, b, c, d, gain, one, two))

    old, new = [(a, b, c), (b, a, d)], [(a, d, c), (d, b, c)]
    normals = [_normals(v, *corners) for corners in old + new]
    flat = np.min([np.einsum("ij,ij->i", normals[0], n) for n in normals[1:]], axis=0) > 0.8
    worth = np.minimum(*[_quality(v, *t) for t in new]) > 0.5 * np.minimum(*[_quality(v, *t) for t in old])
    pick = np.flatnonzero(flat & worth)

    quads = np.stack([a, b, c, d], axis=1)[pick]
    priority = gain[pick] * len(key) + pick  # distinct, so that each vertex has one winner
    best = np.full(len(v), -1)
    np.maximum.at(best, quads.ravel(), np.repeat(priority, 4))
    pick = pick[(best[quads] == priority[:, None]).all(axis=1)]
    f[one[pick] // 3] = np.stack([a, d, c], axis=1)[pick]
    f[two[pick] // 3] = np.stack([d, b, c], axis=1)[pick]
    return f


def _normals(v: Array, a: Faces, b: Faces, c: Faces) -> Array:
    """Return unit normals (n, 3) of triangles given by their corners' indices."""
    n = np.cross(v[b] - v[a], v[c] - v[a])
    return n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300)


def _quality(v: Array, a: Faces, b: Faces, c: Faces) -> Array:
    """Return the ratio of area to the sum of squared edges (n,), which does not depend on size."""
    ab, bc, ca = v[b] - v[a], v[c] - v[b], v[a] - v[c]
    squares = sum(np.einsum("ij,ij->i", e, e) for e in (ab, bc, ca))
    return np.linalg.norm(np.cross(ab, ca), axis=1) / np.maximum(squares, 1e-300)


def _smooth(v: Array, f: Faces, rounds: int) -> Array:
    """Move each vertex half-way to the mean of its neighbours, within its tangent plane."""
    ends = f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    neighbours = sparse.csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(v), len(v)))
    degree = np.bincount(ends[:, 0], minlength=len(v))[:, None]
    for _ in range(rounds):
        normal = igl.per_vertex_normals(v, f)
        pull = 0.5 * (np.asarray(neighbours @ v) / degree - v)
        v = v + pull - np.einsum("ij,ij->i", pull, normal)[:, None] * normal
    return v


def _project(distance: Distance, v: Array, f: Faces, reach: float) -> Array:
    """Move vertices along their normals by one secant step to the zero level, at most `reach`."""
    normal = igl.per_vertex_normals(v, f)
    width = 0.1 * reach
    value = distance(v)
    slope = (distance(v + width * normal) - value) / width
    return v - np.clip(value * slope / np.maximum(slope * slope, 0.1), -reach, reach)[:, None] * normal
