"""Fields of large surfaces, from a coarse version of the surface.

Fields are smooth, and the factorisation of a large matrix takes more time and memory than everything else together.
They are therefore computed on a sample of the vertices and interpolated on the full surface. A few steps of an
iteration there remove the rough part of the error (`solver.model.relaxation`), which is all that bends the surface
visibly.
"""

from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.model import fields
from solver.model.relaxation import relaxed
from solver.surface.coarsening import coarse_surface
from solver.surface.mesh import SolverMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MAX_EXACT_VERTICES = 50_000
"""Number of vertices of the largest mesh whose fields are computed on all vertices."""

MIN_SAMPLES = 8_000
"""Number of samples of a mesh just above `MAX_EXACT_VERTICES`. Isoline coordinates are then exact to about 0.05."""

VERTICES_PER_SAMPLE = 50
"""Number of vertices per sample of the largest meshes; more would take more steps of the iteration."""

MAX_RESIDUAL = 100.0
"""Largest ‖M^(−1/2) (L e + λ M e)‖² / λ² of a sampled field, which is below 1 on a surface of one part. On characters
of many parts it is 300 to 1300, because contacts are stiff and the iteration converges slowly there. Edges would
stretch up to 3 % more, so exact fields are computed instead."""


class CoarseFields:
    """The operator of fields on a sample of a surface.

    Parameters
    ----------
    L : (n, n) sparse
        Operator of the fields, from `fields.field_operator`.
    connected : (n, n) sparse
        A matrix whose entries are at vertices between which fields are continuous, such as
        `fields.energy_operator`.
    mass : (n,) float64
    mesh : SolverMesh
        In the units of L.

    Attributes
    ----------
    samples : (c,) int64
        Vertices of the sample.
    areas : (c,) float64
        Area of each of them.
    """

    def __init__(self, L: "csr_matrix", connected: "csr_matrix", mass: NDArray[np.float64], mesh: SolverMesh) -> None:
        count = max(MIN_SAMPLES, len(mass) // VERTICES_PER_SAMPLE)
        coarse = coarse_surface(mesh.vertices, mesh.faces, connected, float(mass.sum()), count)
        self._L, self._mass, self._vertices = L, mass, mesh.vertices
        self._exact: fields.SurfaceOperator | None = None
        self._up = coarse.interpolation
        self._down = scipy.sparse.csr_matrix(self._up.T)
        self._coarse_L = scipy.sparse.csr_matrix(self._down @ (L @ self._up))
        self.areas = self._down @ mass
        self.samples = coarse.samples
        self._coarse = fields.SurfaceOperator(self._coarse_L, self.areas, mesh.vertices[coarse.samples])

    def propagation_fields(self, count: int) -> NDArray[np.float64]:
        """Return what `fields.SurfaceOperator.propagation_fields` returns, approximately."""
        coarse = self._coarse.propagation_fields(count)
        eigenvalues = -np.einsum("ck,ck->k", coarse, self._coarse_L @ coarse)
        rough = relaxed(self._L, self._mass, eigenvalues, _single(self._up @ coarse))
        energy, gram = _forms(self._L, self._mass, rough)
        values, mix = scipy.linalg.eigh(energy, gram)
        found = rough @ mix[1:, 1:]
        found += mix[0, 1:]
        residuals = _residuals(self._L, self._mass, found, values[1:])
        if not (residuals <= MAX_RESIDUAL).all():
            self._exact = fields.SurfaceOperator(self._L, self._mass, self._vertices)
            return self._exact.propagation_fields(count)
        return fields.with_fixed_signs(found)

    def smoothed(self, values: NDArray[np.float64], length: float) -> NDArray[np.float64]:
        """Return what `fields.SurfaceOperator.smoothed` returns, approximately."""
        if self._exact is not None:
            return self._exact.smoothed(values, length)
        load = self._mass[:, None] * values
        coarse_values = (self._down @ load) / self.areas[:, None]
        coarse = self._coarse.smoothed(coarse_values, length)
        shifts = np.full(values.shape[1], -1 / length**2)
        result = relaxed(self._L, self._mass, shifts, _single(self._up @ coarse), load / length**2)
        return np.clip(result.astype(np.float64), values.min(axis=0), values.max(axis=0))


def _single(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return values in the precision of isoline coordinates at run time."""
    return values.astype(np.float32, order="C")


def _forms(
    L: "csr_matrix", mass: NDArray[np.float64], x: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return −Bᵀ L B and Bᵀ M B for B, (n, 1 + k), the constant function and those in x."""
    B = np.column_stack([np.ones(len(x)), x])
    energy = -(B.T @ (L @ B))
    return (energy + energy.T) / 2, B.T @ (mass[:, None] * B)


def _residuals(
    L: "csr_matrix", mass: NDArray[np.float64], x: NDArray[np.floating], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far each function is from solving −L e = λ M e, see `MAX_RESIDUAL`."""
    load = L @ x + mass[:, None] * x * values
    return np.einsum("vk,vk,v->k", load, load, 1 / mass) / values**2
