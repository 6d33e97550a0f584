"""The space inside a character, divided into cells. Touching parts are united; flat cloth has no cells."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from puppetline.compiled import compiled

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

TIE_DISTANCE_RATIO = 2.0
"""Maximum distance of parts that are tied to the rest in one step, as a multiple of the distance of the nearest
part."""

NEIGHBOR_STEPS = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)], dtype=np.int64
)
"""Offsets from a cell to its 13 neighbours in one half of space."""


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
    graph : (n, n) sparse float64
        Distances between the centres of neighbours and between parts that do not touch; each pair once.
    """

    size: float
    centers: NDArray[np.float64]
    depth: NDArray[np.float64]
    graph: csr_matrix


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
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(np.count_nonzero(inside))
    centers = origin + size * np.argwhere(inside)
    return Solid(size, centers, size * depth[inside], _joined(_graph(number, size), centers))


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


def _graph(number: NDArray[np.int64], size: float) -> csr_matrix:
    """Return the distances between the centres of neighbouring cells."""
    counts = np.array(number.shape)
    rows, columns, lengths = [], [], []
    for step in NEIGHBOR_STEPS:
        here = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(step, counts, strict=True))
        there = tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(step, counts, strict=True))
        both = (number[here] >= 0) & (number[there] >= 0)
        rows.append(number[here][both])
        columns.append(number[there][both])
        lengths.append(np.full(len(rows[-1]), size * np.sqrt(np.count_nonzero(step))))
    n = int(number.max()) + 1
    return csr_matrix(coo_matrix((np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), (n, n)))


def _joined(graph: csr_matrix, centers: NDArray[np.float64]) -> csr_matrix:
    """Tie parts that do not touch the rest to its nearest cell, the nearest parts first."""
    while True:
        count, part = connected_components(graph, directed=False)
        if count == 1:
            return graph
        largest = part == np.bincount(part).argmax()
        ties = _ties(centers, part, np.flatnonzero(largest), np.flatnonzero(~largest))
        near = ties.data <= TIE_DISTANCE_RATIO * ties.data.min()
        graph = csr_matrix(graph + coo_matrix((ties.data[near], (ties.row[near], ties.col[near])), graph.shape))


def _ties(
    centers: NDArray[np.float64], part: NDArray[np.int32], inside: NDArray[np.int64], outside: NDArray[np.int64]
) -> coo_matrix:
    """Return the distance (n, n) of each part that has cells outside, where it is nearest to the cells inside."""
    distance, nearest = (np.asarray(each) for each in cKDTree(centers[inside]).query(centers[outside]))
    by_distance = np.argsort(distance, kind="stable")
    _, first = np.unique(part[outside][by_distance], return_index=True)
    ties = by_distance[first]
    return coo_matrix((distance[ties], (outside[ties], inside[nearest[ties]])), (len(centers), len(centers)))


def parted(solid: Solid, left: NDArray[np.bool_], where: NDArray[np.bool_]) -> Solid:
    """Return a solid without the connections between its left and its right side in a region.

    A part that only the other side connected with the rest, such as a shoe, is tied to what is nearest on its own side.

    Parameters
    ----------
    solid : Solid
    left : (n,) bool
        Cells on the left side.
    where : (n,) bool
        Cells of the region.
    """
    steps = solid.graph.tocoo()
    kept = (left[steps.row] == left[steps.col]) | ~(where[steps.row] & where[steps.col])
    graph = csr_matrix((steps.data[kept], (steps.row[kept], steps.col[kept])), steps.shape)
    _, part = connected_components(graph, directed=False)
    body = part == np.bincount(part).argmax()
    if not (left & body).any() or not (~left & body).any():
        return solid
    for side in (left, ~left):
        ties = _ties(solid.centers, part, np.flatnonzero(side & body), np.flatnonzero(side & ~body))
        graph = csr_matrix(graph + ties)
    return replace(solid, graph=graph)
