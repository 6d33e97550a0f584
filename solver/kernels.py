"""The hot loops: control variables to vertices. Each is compiled on first use and kept compiled on disk."""

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True, fastmath=True, nogil=True)
def _blend(position, transforms, isolines, t):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Blend the transforms of the two isolines that a vertex lies between, summed over the fields, into t (12,)."""
    t[:] = 0
    for i in range(len(position)):
        below = min(int(position[i]), isolines - 2)
        upper = position[i] - np.float32(below)
        lower = np.float32(1) - upper
        row = i * isolines + below
        for c in range(12):
            t[c] += lower * transforms[row, c] + upper * transforms[row + 1, c]


@numba.njit(cache=True, fastmath=True, nogil=True)
def blend_vertices(rest, ladder, transforms, isolines, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """X = W R without W: blend two isolines a field and apply the sum to the rest position.

    Parameters
    ----------
    rest, out : (n, 3) float32
    ladder : (n, n_e) float32
    transforms : (n_e · n_iso, 12) float32
        Rows of the 3 × 4 transforms, field weights multiplied in.
    isolines : int
    """
    t = np.empty(12, dtype=np.float32)
    for v in range(len(ladder)):
        _blend(ladder[v], transforms, isolines, t)
        x, y, z = rest[v, 0], rest[v, 1], rest[v, 2]
        for axis in range(3):
            out[v, axis] = t[4 * axis] * x + t[4 * axis + 1] * y + t[4 * axis + 2] * z + t[4 * axis + 3]


@numba.njit(cache=True, fastmath=True, nogil=True)
def blend_normals(normals, ladder, transforms, isolines, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Turn rest normals by the cofactor of the blended linear part, which keeps hard edges and needs no neighbours.

    Parameters
    ----------
    normals, out : (n, 3) float32
        Unit length.
    ladder, transforms, isolines
        As in `blend_vertices`.
    """
    t = np.empty(12, dtype=np.float32)
    for v in range(len(ladder)):
        _blend(ladder[v], transforms, isolines, t)
        a, b, c0 = t[0], t[1], t[2]
        d, e, f = t[4], t[5], t[6]
        g, h, k = t[8], t[9], t[10]
        x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
        u = (e * k - f * h) * x + (f * g - d * k) * y + (d * h - e * g) * z
        w = (c0 * h - b * k) * x + (a * k - c0 * g) * y + (b * g - a * h) * z
        q = (b * f - c0 * e) * x + (c0 * d - a * f) * y + (a * e - b * d) * z
        length = np.sqrt(u * u + w * w + q * q)
        scale = np.float32(1) / length if length > 0 else np.float32(0)
        out[v, 0], out[v, 1], out[v, 2] = u * scale, w * scale, q * scale


@numba.njit(cache=True, nogil=True)
def add_to_histogram(positions, edges, rest_lengths, width, histogram):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Count edge stretches |e| / |e_rest| into bins of equal width from 0.

    Parameters
    ----------
    positions : (n, 3) float32
    edges : (e, 2) int32
    rest_lengths : (e,) float32
    width : float
    histogram : (bins,) int64
        Added to; what lies beyond falls into the last bin.
    """
    last = len(histogram) - 1
    for j in range(len(edges)):
        a, b = edges[j, 0], edges[j, 1]
        x = positions[a, 0] - positions[b, 0]
        y = positions[a, 1] - positions[b, 1]
        z = positions[a, 2] - positions[b, 2]
        stretch = np.sqrt(x * x + y * y + z * z) / rest_lengths[j]
        histogram[int(stretch / width) if stretch < last * width else last] += 1


def weighted(controls: NDArray[np.float32], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    """Multiply the field weights into controls and lay each transform out as a row of 12, as the loops want them.

    Parameters
    ----------
    controls : (m, 3, 4) float32
    weights : (n_e,) float64

    Returns
    -------
    (m, 12) float32
    """
    per_isoline = np.repeat(weights, len(controls) // len(weights)).astype(np.float32)
    return controls.reshape(-1, 12) * per_isoline[:, None]


@numba.njit(cache=True, nogil=True)
def prominences(values, order, starts, neighbours):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Return how far each local maximum of a function on a graph rises over the pass to a higher one.

    Vertices are flooded from the top; where two basins meet, the lower summit's prominence is known.

    Parameters
    ----------
    values : (n,) float64
    order : (n,) int64
        Vertices by descending value.
    starts : (n + 1,) int
    neighbours : (2e,) int
        Adjacency in compressed rows.

    Returns
    -------
    (n,) float64
        0 for what is no maximum; the highest summit's is the range of the values.
    """
    n = len(values)
    basin = np.full(n, -1)
    result = np.zeros(n)
    for v in order:
        best = -1
        for j in range(starts[v], starts[v + 1]):
            root = neighbours[j]
            if basin[root] < 0:
                continue
            while basin[root] != root:
                basin[root] = basin[basin[root]]
                root = basin[root]
            if best < 0:
                best = root
            elif root != best:
                low, high = (root, best) if values[root] < values[best] else (best, root)
                result[low] = values[low] - values[v]
                basin[low] = high
                best = high
        basin[v] = v if best < 0 else best
    summit = order[0]
    result[summit] = values[summit] - values[order[n - 1]]
    return result
