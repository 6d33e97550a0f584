"""How much the edges of a character are stretched over a clip, in memory that does not grow with it."""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.surface.mesh import SolverMesh

BIN_WIDTH = 0.0005
HIGHEST = 4.0
"""Stretches beyond this are counted as this."""

TABLES = 4
"""Counts that are added up only in the end: neighbours in time fall into the same bin, which would wait for itself."""


class EdgeStretch:
    """Counts |e| / |e_rest| of every edge in every frame.

    Parameters
    ----------
    mesh : SolverMesh
    """

    def __init__(self, mesh: SolverMesh) -> None:
        rest = mesh.vertices[mesh.edges]
        lengths = np.linalg.norm(rest[:, 0] - rest[:, 1], axis=1)
        self._edges = mesh.edges.astype(np.int32)
        self._bins_a_unit = (1 / (BIN_WIDTH * lengths)).astype(np.float32)
        self._tables = np.zeros((TABLES, round(HIGHEST / BIN_WIDTH)), dtype=np.int64)

    def add(self, positions: NDArray[np.float32]) -> None:
        """Count some frames: (n, 3, F) float32 solver vertices, in the units of the mesh."""
        _count(positions, self._edges, self._bins_a_unit, self._tables)

    def percentiles(self, *shares: float) -> tuple[float, ...]:
        """Return the stretch that this percentage of all edges in all frames does not exceed, to half a bin."""
        cumulated = np.cumsum(self._tables.sum(axis=0))
        places = [int(np.searchsorted(cumulated, share / 100 * cumulated[-1])) for share in shares]
        return tuple(BIN_WIDTH * (place + 0.5) for place in places)


@compiled
def _count(positions, edges, bins_a_unit, tables):
    """Count edge lengths into bins; what is beyond the last or no number falls into it."""
    frames, last = positions.shape[2], np.float32(tables.shape[1] - 1)
    stretch = np.empty(frames, dtype=np.int32)
    for j in range(len(edges)):
        a, b, scale = positions[edges[j, 0]], positions[edges[j, 1]], bins_a_unit[j]
        for f in range(frames):
            x, y, z = a[0, f] - b[0, f], a[1, f] - b[1, f], a[2, f] - b[2, f]
            place = np.sqrt(x * x + y * y + z * z) * scale
            stretch[f] = np.int32(place if place < last else last)
        for f in range(frames):
            tables[f % TABLES, stretch[f]] += 1
