"""The space inside a character, divided into cells. Touching parts are united; flat cloth has no cells."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from puppetline.compiled import compiled
from solver.surface.mesh import SolverMesh

CELL_COUNT = 60_000
"""Approximate number of cells in a character; a limb with a sixtieth of its length as thickness is three cells
thick."""

MAX_CELLS_PER_AXIS = 400
"""Maximum number of cells along an axis."""

FLAT_RATIO = 0.1
"""Ratio of thickness to length below which a character is flat, such as one that is cut out of paper."""

FLAT_CELL_COUNT = 6_000
"""Approximate number of cells that the outline of a flat character covers."""

FLAT_CELLS_PER_AXIS = 100
"""Number of cells along the longest axis with which an outline is measured first, and of a surface that encloses
nothing."""


@dataclass(frozen=True, eq=False)
class Solid:
    """Cells inside a character.

    Attributes
    ----------
    size : float
        Edge length of a cell.
    centers : (n, 3) float64
    depth : (n,) float64
        Distance from each centre to the edge of the nearest cell outside: approximately that to the surface.
    """

    size: float
    centers: NDArray[np.float64]
    depth: NDArray[np.float64]

    def along(self, basis: NDArray[np.float64]) -> "Solid":
        """Return the solid in coordinates along the rows of a basis (3, 3), by which its cells are sorted."""
        centers = self.centers @ basis.T
        order = np.lexsort(centers.T[::-1])
        return replace(self, centers=centers[order], depth=self.depth[order])


@lru_cache(maxsize=1)
def solid_of(mesh: SolverMesh) -> Solid:
    """Return the cells inside a character, in its mesh's coordinates; the last ones are kept."""
    return fill(mesh.vertices, mesh.faces, mesh.components)


def fill(vertices: NDArray[np.float64], faces: NDArray[np.int64], components: NDArray[np.int32]) -> Solid:
    """Fill a surface with cells.

    A cell is inside if the generalised winding number (Jacobson et al. 2013), averaged over the six directions of the
    axes, is at least a half: the surface may have holes, and its parts may overlap. Each direction contributes 0 to 1,
    so that one ray through holes of several parts does not outvote the others. A flat character (see `FLAT_RATIO`) is
    made as thick everywhere as its outline is wide. A surface that encloses nothing has the cells that hold its
    vertices.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (t, 3) int64
    components : (n,) int32
        Part of each vertex; a part that is inside out is turned.
    """
    extent = np.ptp(vertices, axis=0)
    if extent.min() < FLAT_RATIO * extent.max():
        size, inside = _inflated(vertices, faces)
    else:
        size, inside = _enclosed(vertices, faces, components)
    origin = _origin(vertices, size, np.array(inside.shape))
    if not inside.any():  # as in sheets that cross each other
        inside[tuple(np.rint((vertices - origin) / size).astype(int).T)] = True
    depth = ndimage.distance_transform_edt(inside) - 0.5
    return Solid(size, origin + size * np.argwhere(inside), size * depth[inside])


def _enclosed(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], components: NDArray[np.int32]
) -> tuple[float, NDArray[np.bool_]]:
    """Return the size of the cells, and which of them the surface encloses."""
    faces, volume = _outside_out(vertices, faces, components)
    longest = float(np.ptp(vertices, axis=0).max())
    # an integer number of cells, so that rounding errors of the volume do not move them
    count = round(longest / (volume / CELL_COUNT) ** (1 / 3)) if volume > 0 else FLAT_CELLS_PER_AXIS
    size = longest / min(count, MAX_CELLS_PER_AXIS)
    counts = _counts(vertices, size)
    winding = np.zeros(counts)
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3, axis]
        scaled = ((vertices - _origin(vertices, size, counts)) / size)[:, others]
        winding += np.moveaxis(_crossings(scaled, faces, counts[others]), [0, 1, 2], others)
    return size, winding >= 1.5


def _inflated(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> tuple[float, NDArray[np.bool_]]:
    """Return the same for a flat character: a cell is inside if it is nearer to the plane than to the outline.

    This is a simple form of the inflation in Igarashi et al. 1999, "Teddy".
    """
    extent = np.ptp(vertices, axis=0)
    flat = int(extent.argmin())
    axes = [(flat + 1) % 3, (flat + 2) % 3, flat]
    size = float(extent.max()) / FLAT_CELLS_PER_AXIS
    covered = _outline(vertices[:, axes], faces, size)
    finer = round(FLAT_CELLS_PER_AXIS * (FLAT_CELL_COUNT / max(int(covered.sum()), 1)) ** 0.5)
    size = float(extent.max()) / min(finer, MAX_CELLS_PER_AXIS)
    depth = ndimage.distance_transform_edt(_outline(vertices[:, axes], faces, size))
    layers = 2 * int(depth.max()) + 2
    inside = np.abs(np.arange(layers) - (layers - 1) / 2) < depth[:, :, None]
    return size, np.moveaxis(inside, [0, 1, 2], axes)


def _outline(vertices: NDArray[np.float64], faces: NDArray[np.int64], size: float) -> NDArray[np.bool_]:
    """Return which cells of a plane the surface covers, seen along the last axis."""
    counts = _counts(vertices, size)
    counts[2] = 1
    scaled = (vertices - _origin(vertices, size, counts)) / size
    scaled[:, 2] = 0.5
    edges = scaled[faces[:, 1:], :2] - scaled[faces[:, :1], :2]
    turned = np.where((np.linalg.det(edges) < 0)[:, None], faces[:, ::-1], faces)
    return _crossings(scaled, turned, counts)[:, :, 0] > 0


def _counts(vertices: NDArray[np.float64], size: float) -> NDArray[np.int64]:
    """Return the number of cells along each axis: even, so that a symmetric body has symmetric cells."""
    return 2 * np.ceil(np.ptp(vertices, axis=0) / (2 * size)).astype(np.int64) + 2


def _origin(vertices: NDArray[np.float64], size: float, counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the centre of the first cell; the cells lie around the middle."""
    return vertices.min(axis=0) + np.ptp(vertices, axis=0) / 2 - size * (counts - 1) / 2


def _outside_out(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], components: NDArray[np.int32]
) -> tuple[NDArray[np.int64], float]:
    """Turn the parts that enclose a negative volume; also return the sum of all volumes."""
    part = components[faces[:, 0]]
    corners = vertices[faces] - vertices.mean(axis=0)
    for_part = np.bincount(part, np.linalg.det(corners) / 6)
    turned = np.where((for_part < 0)[part, None], faces[:, ::-1], faces)
    return turned, float(np.abs(for_part).sum())


@compiled
def _crossings(vertices, faces, counts):
    """Return the winding number of the surface around each cell, seen along the last axis from both sides, on average.

    Parameters
    ----------
    vertices : (n, 3) float64
        In cells; cell i's centre is at i.
    faces : (t, 3) int64
    counts : (3,) int64

    Returns
    -------
    counts float64
        1 inside a closed surface, 0 outside, a half if there is a hole on one side.
    """
    crossed = np.zeros((counts[0], counts[1], counts[2] + 1))
    for a, b, c in faces:
        ax, ay, bx, by, cx, cy = (
            vertices[a, 0],
            vertices[a, 1],
            vertices[b, 0],
            vertices[b, 1],
            vertices[c, 0],
            vertices[c, 1],
        )
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0:
            continue
        for i in range(max(0, int(np.ceil(min(ax, bx, cx)))), min(counts[0] - 1, int(np.floor(max(ax, bx, cx)))) + 1):
            for j in range(
                max(0, int(np.ceil(min(ay, by, cy)))), min(counts[1] - 1, int(np.floor(max(ay, by, cy)))) + 1
            ):
                u = ((cx - bx) * (j - by) - (cy - by) * (i - bx)) / area
                v = ((ax - cx) * (j - cy) - (ay - cy) * (i - cx)) / area
                w = 1 - u - v
                if u < 0 or v < 0 or w < 0:
                    continue
                height = u * vertices[a, 2] + v * vertices[b, 2] + w * vertices[c, 2]
                above = min(max(int(np.ceil(height)), 0), counts[2])
                crossed[i, j, above] += 1.0 if area > 0 else -1.0
    result = np.zeros((counts[0], counts[1], counts[2]))
    for i in range(counts[0]):
        for j in range(counts[1]):
            total = 0.0
            for k in range(counts[2] + 1):
                total += crossed[i, j, k]
            below = 0.0
            for k in range(counts[2]):
                below += crossed[i, j, k]
                result[i, j, k] = (min(max(-below, 0.0), 1.0) + min(max(total - below, 0.0), 1.0)) / 2
    return result
