"""How much the edges of a character are stretched over a clip, in memory that does not grow with it."""

import numpy as np
from numpy.typing import NDArray

from solver import kernels
from solver.mesh import SolverMesh

BIN_WIDTH = 0.0005
HIGHEST = 4.0
"""Stretches beyond this are counted as this."""


class EdgeStretch:
    """Counts |e| / |e_rest| of every edge in every frame.

    Parameters
    ----------
    mesh : SolverMesh
    """

    def __init__(self, mesh: SolverMesh) -> None:
        rest = mesh.vertices[mesh.edges]
        self._edges = mesh.edges.astype(np.int32)
        self._rest = np.linalg.norm(rest[:, 0] - rest[:, 1], axis=1).astype(np.float32)
        self._histogram = np.zeros(round(HIGHEST / BIN_WIDTH), dtype=np.int64)

    def add(self, positions: NDArray[np.float32]) -> None:
        """Count one frame of (n, 3) float32 solver vertices, in the units of the mesh."""
        kernels.add_to_histogram(positions, self._edges, self._rest, BIN_WIDTH, self._histogram)

    def percentiles(self, *shares: float) -> tuple[float, ...]:
        """Return the stretch that this percentage of all edges in all frames does not exceed, to half a bin."""
        cumulated = np.cumsum(self._histogram)
        places = [int(np.searchsorted(cumulated, share / 100 * cumulated[-1])) for share in shares]
        return tuple(BIN_WIDTH * (place + 0.5) for place in places)
