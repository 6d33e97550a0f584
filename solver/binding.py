"""Vertices that follow a reduced model: its own, or those of a mesh that is rendered."""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from solver import kernels
from solver.deformer import Controls
from solver.mesh import SolverMesh
from solver.reduced_model import ReducedModel


class Binding:
    """Rest positions with their ladder coordinates: all that a vertex needs at run time.

    Parameters
    ----------
    model : ReducedModel
    rest : (n, 3) float
        Mesh file's coordinates.
    follows : (n,) int64
        The solver vertex whose ladder coordinates each of them takes.
    normals : (n, 3) float, optional
        Unit rest normals.
    """

    def __init__(
        self,
        model: ReducedModel,
        rest: NDArray[np.floating],
        follows: NDArray[np.int64],
        normals: NDArray[np.floating] | None = None,
    ) -> None:
        self.rest = np.ascontiguousarray(rest, dtype=np.float32)
        self.has_normals = normals is not None
        self.rest_normals = np.ascontiguousarray(np.zeros((0, 3)) if normals is None else normals, dtype=np.float32)
        self._ladder = model.ladder[follows]
        self._weights = model.weights
        self._isolines = model.isolines

    @classmethod
    def of_solver_mesh(cls, model: ReducedModel, mesh: SolverMesh) -> "Binding":
        """Bind the solver mesh itself."""
        return cls(model, mesh.vertices, np.arange(len(mesh.vertices)))

    def only(self, chosen: NDArray[np.integer]) -> "Binding":
        """Return the binding of some of the vertices, by index."""
        part = copy(self)
        part.rest, part._ladder = self.rest[chosen], self._ladder[chosen]
        part.rest_normals = self.rest_normals[chosen] if self.has_normals else self.rest_normals
        return part

    def vertices(self, controls: Controls) -> NDArray[np.float32]:
        """Return X = W R.

        Parameters
        ----------
        controls : (m, 3, 4) float32
            Absolute, or of a displacement: the result is of the same kind.

        Returns
        -------
        (n, 3) float32
            Mesh file's coordinates.
        """
        out = np.empty_like(self.rest)
        transforms = kernels.weighted(controls, self._weights)
        kernels.blend_vertices(self.rest, self._ladder, transforms, self._isolines, out)
        return out

    def normals(self, controls: Controls) -> NDArray[np.float32]:
        """Return the unit normals of the deformed surface.

        Parameters
        ----------
        controls : (m, 3, 4) float32
            Absolute.

        Returns
        -------
        (n, 3) float32

        Raises
        ------
        ValueError
            Bound without normals.
        """
        if not self.has_normals:
            raise ValueError("these vertices were bound without normals")
        out = np.empty_like(self.rest)
        transforms = kernels.weighted(controls, self._weights)
        kernels.blend_normals(self.rest_normals, self._ladder, transforms, self._isolines, out)
        return out
