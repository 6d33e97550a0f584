"""How far handles may go before the character tears, found by trying it on the reduced model."""

import numpy as np
from numpy.typing import NDArray

from solver.deformer import Deformer
from solver.mesh import SolverMesh
from solver.reduced_model import ReducedModel, position_matrix

PROBES = np.array([0.025, 0.05, 0.08, 0.12, 0.17, 0.23, 0.3, 0.4])
"""Displacements that are tried, fractions of the diagonal."""

STRAIN_LIMIT = 1.35
"""Mean strain of the worst edges at which a handle has reached its end."""

WORST = 0.01
"""Share of all edges that counts as the worst."""

SAMPLED_EDGES = 4000

SETTLE = 8
"""Rotation updates for each probe; each starts from the one before."""


def handle_reach(
    model: ReducedModel, mesh: SolverMesh, handles: NDArray[np.float64], moving: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Measure each handle's reach along the six axis directions.

    A handle is drawn away while all others stay, until the worst hundredth of the edges is, on average, stretched by
    `STRAIN_LIMIT` or squeezed to its inverse. Along its own length a limb has little room and sideways much, so the
    directions differ.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
    handles : (h, 3) float64
        Rest positions, mesh file's coordinates.
    moving : (h,) bool
        Handles that are not to move are not tried.

    Returns
    -------
    (h, 3, 2) float64
        Along −x, +x, −y, +y, −z, +z; mesh units, never less than the smallest probe; the largest for still handles.
    """
    deformer = Deformer(model, mesh, handles, iterations=SETTLE)
    strain = _EdgeStrain(model, mesh)
    reach = np.full((len(handles), 3, 2), PROBES[-1])
    for handle in map(int, np.flatnonzero(moving)):
        for axis in range(3):
            for side, sign in enumerate((-1.0, 1.0)):
                reach[handle, axis, side] = _probe(deformer, strain, handle, axis, sign)
    return reach * model.diagonal


def _probe(deformer: Deformer, strain: "_EdgeStrain", handle: int, axis: int, sign: float) -> float:
    deformer.reset()
    before, worst_before = 0.0, 1.0
    for distance in PROBES:
        targets = deformer.handles.copy()
        targets[handle, axis] += sign * distance * deformer.model.diagonal
        worst = strain.worst(deformer.solve(targets))
        if worst > STRAIN_LIMIT:
            share = (STRAIN_LIMIT - worst_before) / (worst - worst_before)
            return max(before + share * (distance - before), PROBES[0])
        before, worst_before = distance, worst
    return before


class _EdgeStrain:
    """Strain of a sample of edges, straight from the control variables."""

    def __init__(self, model: ReducedModel, mesh: SolverMesh) -> None:
        edges = mesh.edges[np.linspace(0, len(mesh.edges) - 1, min(SAMPLED_EDGES, len(mesh.edges))).astype(int)]
        ends = [
            position_matrix(
                model.to_model(mesh.vertices[end]), model.ladder[end].astype(np.float64), model.weights, model.isolines
            )
            for end in edges.T
        ]
        self._edges = ends[1] - ends[0]
        self._rest = np.linalg.norm(self._edges @ model.rest_controls, axis=1)

    def worst(self, R: NDArray[np.float64]) -> float:
        """Return the mean strain max(stretch, 1 / stretch) over the worst hundredth of the edges."""
        stretch = np.linalg.norm(self._edges @ R, axis=1) / self._rest
        strain = np.maximum(stretch, 1 / np.maximum(stretch, 1e-6))
        count = max(1, int(WORST * len(strain)))
        return float(np.partition(strain, -count)[-count:].mean())
