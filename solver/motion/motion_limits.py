"""How far limbs may go before the character tears, found by trying it on the reduced model."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.model.binding import Binding
from solver.model.reduced_model import ReducedModel
from solver.motion.deformer import Deformer, to_file_units
from solver.surface.mesh import SolverMesh

PROBE_DIAGONALS = np.array([0.025, 0.05, 0.08, 0.12, 0.17, 0.23, 0.3, 0.4])
"""Displacements that are tried, fractions of the diagonal."""

MAX_STRAIN = 1.3
"""Mean strain of the worst edges at which a limb has reached its end."""

WORST_EDGE_SHARE = 0.01
"""Share of all edges that counts as the worst."""

MAX_SAMPLED_EDGES = 4000

UPDATES_PER_PROBE = 8
"""Rotation updates for each probe; each starts from the one before."""


def limb_reach(deformer: Deformer, mesh: SolverMesh, limbs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measure how far each limb may go along the six axis directions.

    A limb's handles are drawn away together while all others stay, until the worst hundredth of the edges is, on
    average, stretched by `MAX_STRAIN` or squeezed to its inverse. Along its own length a limb has little room and
    sideways much, so the directions differ.

    Parameters
    ----------
    deformer : Deformer
        Of the character and its handles; it is not moved.
    mesh : SolverMesh
        The character.
    limbs : (l, h) float64
        How far each handle goes when a limb goes 1; 0 for handles that are not of that limb.

    Returns
    -------
    (l, 3, 2) float64
        Along −x, +x, −y, +y, −z, +z; mesh units, from the smallest probe to the largest, which is also what a limb
        without handles gets.
    """
    trial, strain = deformer.another(UPDATES_PER_PROBE), _EdgeStrain(deformer.model, mesh)
    reach = np.full((len(limbs), 3, 2), PROBE_DIAGONALS[-1])
    for limb, along in enumerate(limbs):
        if not along.any():
            continue
        for axis in range(3):
            for side, sign in enumerate((-1.0, 1.0)):
                reach[limb, axis, side] = _probe(trial, strain, np.outer(along, sign * np.eye(3)[axis]))
    return reach * deformer.model.diagonal


def _probe(deformer: Deformer, strain: "_EdgeStrain", direction: NDArray[np.float64]) -> float:
    """Return how far, in model units, the handles can go along a (h, 3) direction."""
    deformer.reset()
    before, worst_before = 0.0, 1.0
    for distance in PROBE_DIAGONALS:
        R = deformer.solve(deformer.handles + distance * deformer.model.diagonal * direction)
        worst = strain.worst(R)
        if worst > MAX_STRAIN:
            share = (MAX_STRAIN - worst_before) / (worst - worst_before)
            return float(max(before + share * (distance - before), PROBE_DIAGONALS[0]))
        before, worst_before = float(distance), worst
    return before


class _EdgeStrain:
    """Strain of a sample of edges."""

    def __init__(self, model: ReducedModel, mesh: SolverMesh) -> None:
        edges = mesh.edges[np.linspace(0, len(mesh.edges) - 1, min(MAX_SAMPLED_EDGES, len(mesh.edges))).astype(int)]
        ends = edges.T.ravel()
        # in model units, whatever the mesh's: far from the origin a float32 holds no edge
        self._model = replace(model, center=np.zeros(3), diagonal=np.asarray(1.0))
        self._ends = Binding(self._model, model.to_model(mesh.vertices[ends]), ends)
        self._rest = self._lengths(self._ends.rest)

    def worst(self, R: NDArray[np.float64]) -> float:
        """Return the mean strain max(stretch, 1 / stretch) over the worst hundredth of the edges."""
        stretch = self._lengths(self._ends.vertices(to_file_units(R, self._model))) / self._rest
        strain = np.maximum(stretch, 1 / np.maximum(stretch, 1e-6))
        count = max(1, int(WORST_EDGE_SHARE * len(strain)))
        return float(np.partition(strain, -count)[-count:].mean())

    def _lengths(self, positions: NDArray[np.float32]) -> NDArray[np.float32]:
        tails, heads = np.split(positions, 2)
        return np.linalg.norm(heads - tails, axis=1)
