"""Limits of the motion of limbs, found by moving them on the reduced model until their edges are strained too much."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.model.binding import Binding
from solver.model.reduced_model import ReducedModel
from solver.motion.deformer import Deformer, to_file_units
from solver.surface.mesh import SolverMesh

PROBE_DIAGONALS = np.array([0.025, 0.05, 0.08, 0.12, 0.17, 0.23, 0.3, 0.4])
"""Displacements that are probed, as fractions of the diagonal."""

MAX_STRAIN = 1.3
"""Largest mean strain of the most strained edges within a limb's reach."""

WORST_EDGE_SHARE = 0.01
"""Share of all edges that are the most strained ones."""

MAX_SAMPLED_EDGES = 4000
"""Largest number of edges whose strain is measured."""

UPDATES_PER_PROBE = 8
"""Rotation updates per probe, each of which starts from the previous one."""


def limb_reach(deformer: Deformer, mesh: SolverMesh, limbs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measure the reach of each limb along the six axis directions.

    A limb's handles are moved together while all others stay, until the mean strain of the most strained hundredth of
    the edges is `MAX_STRAIN`: stretched by this factor or compressed to its inverse. Directions differ because a limb
    can move less along its length than sideways.

    Parameters
    ----------
    deformer : Deformer
        Of the character and its handles; its state does not change.
    mesh : SolverMesh
        The character.
    limbs : (l, h) float64
        Displacement of each handle per unit of the limb's; 0 for handles of other limbs.

    Returns
    -------
    (l, 3, 2) float64
        Along −x, +x, −y, +y, −z, +z; mesh units, between the smallest and the largest probe. A limb without handles
        has the largest.
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
    """Return the reach of the handles along a (h, 3) direction, in model units."""
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
        # in model units: far from the origin, float32 is too coarse for edges
        self._model = replace(model, center=np.zeros(3), diagonal=np.asarray(1.0))
        self._ends = Binding(self._model, model.to_model(mesh.vertices[ends]), ends)
        self._rest = self._lengths(self._ends.rest)

    def worst(self, R: NDArray[np.float64]) -> float:
        """Return the mean strain max(stretch, 1 / stretch) of the most strained hundredth of the edges."""
        stretch = self._lengths(self._ends.vertices(to_file_units(R, self._model))) / self._rest
        strain = np.maximum(stretch, 1 / np.maximum(stretch, 1e-6))
        count = max(1, int(WORST_EDGE_SHARE * len(strain)))
        return float(np.partition(strain, -count)[-count:].mean())

    def _lengths(self, positions: NDArray[np.float32]) -> NDArray[np.float32]:
        tails, heads = np.split(positions, 2)
        return np.linalg.norm(heads - tails, axis=1)
