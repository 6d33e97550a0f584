"""Statistics of the stretch of a character's edges over a clip, in constant memory."""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.surface.mesh import SolverMesh

BIN_WIDTH = 0.0005
"""Width of a bin of the histogram."""

MAX_STRETCH = 4.0
"""Largest stretch of the histogram; a larger one is counted in the last bin."""

TABLE_COUNT = 4
"""Number of histograms that are added up at the end: successive frames fall into the same bin, and increments of one
counter would wait for each other."""


class EdgeStretch:
    """A histogram of |e| / |e_rest| of every edge in every frame.

    Parameters
    ----------
    mesh : SolverMesh
    """

    def __init__(self, mesh: SolverMesh) -> None:
        rest = mesh.vertices[mesh.edges]
        lengths = np.linalg.norm(rest[:, 0] - rest[:, 1], axis=1)
        self._edges = mesh.edges.astype(np.int32)
        self._bins_a_unit = (1 / (BIN_WIDTH * lengths)).astype(np.float32)
        self._tables = np.zeros((TABLE_COUNT, round(MAX_STRETCH / BIN_WIDTH)), dtype=np.int64)

    def add(self, positions: NDArray[np.float32]) -> None:
        """Add frames: (n, 3, F) float32 solver vertices, in the units of the mesh."""
        _count(positions, self._edges, self._bins_a_unit, self._tables)

    def percentiles(self, *shares: float) -> tuple[float, ...]:
        """Return percentiles of the stretch of all edges in all frames, accurate to half a bin."""
        cumulated = np.cumsum(self._tables.sum(axis=0))
        places = [int(np.searchsorted(cumulated, share / 100 * cumulated[-1])) for share in shares]
        return tuple(BIN_WIDTH * (place + 0.5) for place in places)


@compiled
def _count(positions, edges, bins_a_unit, tables):
    """Count edge lengths; the last bin includes larger lengths and NaN."""
    frames, last = positions.shape[2], np.float32(tables.shape[1] - 1)
    stretch = np.empty(frames, dtype=np.int32)
    for j in range(len(edges)):
        a, b, scale = positions[edges[j, 0]], positions[edges[j, 1]], bins_a_unit[j]
        for f in range(frames):
            x, y, z = a[0, f] - b[0, f], a[1, f] - b[1, f], a[2, f] - b[2, f]
            place = np.sqrt(x * x + y * y + z * z) * scale
            stretch[f] = np.int32(place if place < last else last)
        for f in range(frames):
            tables[f % TABLE_COUNT, stretch[f]] += 1
