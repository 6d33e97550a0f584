"""Vertices that follow a reduced model: those of the solver mesh, or of a render mesh."""

import threading
from copy import copy
from typing import Self

import numpy as np
from numpy.typing import NDArray

from solver.model import kernels
from solver.model.reduced_model import Controls, ReducedModel
from solver.model.simd_vector import LENGTH
from solver.surface import tangents
from solver.surface.mesh import SolverMesh


class _Tables(threading.local):
    """The buffers for `kernels` of each thread, so that a frame does not allocate any."""

    def __init__(self) -> None:
        self._by_length: dict[int, NDArray[np.float32]] = {}

    def of(self, rows: int) -> NDArray[np.float32]:
        """Return a (rows, 16) float32 table."""
        if rows not in self._by_length:
            self._by_length[rows] = np.zeros((rows, LENGTH), dtype=np.float32)
        return self._by_length[rows]


_tables = _Tables()


class Binding:
    """Rest positions with their isoline coordinates: the data of a vertex at run time.

    Parameters
    ----------
    model : ReducedModel
    rest : (n, 3) float
        Mesh file's coordinates.
    follows : (n,) int64
        The solver vertex whose isoline coordinates each vertex takes.
    """

    def __init__(self, model: ReducedModel, rest: NDArray[np.floating], follows: NDArray[np.int64]) -> None:
        self.rest = np.ascontiguousarray(rest, dtype=np.float32)
        self._isoline_coordinates = np.ascontiguousarray(model.isoline_coordinates[follows])
        self._weights = model.weights
        self._transforms = (len(model.weights) * model.isolines, 3, 4)

    @classmethod
    def of_solver_mesh(cls, model: ReducedModel, mesh: SolverMesh) -> "Binding":
        """Bind the vertices of the solver mesh."""
        return cls(model, mesh.vertices, np.arange(len(mesh.vertices)))

    def only(self, chosen: NDArray[np.integer]) -> Self:
        """Return the binding of some of the vertices, by index."""
        part = copy(self)
        part.rest, part._isoline_coordinates = self.rest[chosen], self._isoline_coordinates[chosen]
        return part

    def _check(self, controls: Controls, out: NDArray[np.float32]) -> None:
        """Check shapes: compiled loops do not check bounds."""
        if controls.shape != self._transforms or out.shape != self.rest.shape:
            raise ValueError(
                f"found controls {controls.shape} for vertices {out.shape}; "
                f"expected {self._transforms} for {self.rest.shape}"
            )

    def vertices(self, controls: Controls, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Return X = W R.

        Parameters
        ----------
        controls : (m, 3, 4) float32
            Of a pose, or of a difference of poses, for which the result is a displacement.
        out : (n, 3) float32, optional
            Written to, and returned.

        Returns
        -------
        (n, 3) float32
            Mesh file's coordinates.

        Raises
        ------
        ValueError
            Arrays of other shapes.
        """
        out = np.empty_like(self.rest) if out is None else out
        self._check(controls, out)
        kernels.blend_positions(
            self.rest, self._isoline_coordinates, controls, self._weights, _tables.of(len(controls)), out
        )
        return out


class ShadedBinding(Binding):
    """Vertices with normals that follow the deformed surface.

    Parameters
    ----------
    model, rest, follows
        As for `Binding`.
    normals : (n, 3) float
        Unit rest normals, smooth or with hard edges, which stay hard when the surface deforms.
    triangles : (t, 3) int64
        Indices of these vertices.
    """

    def __init__(
        self,
        model: ReducedModel,
        rest: NDArray[np.floating],
        follows: NDArray[np.int64],
        normals: NDArray[np.floating],
        triangles: NDArray[np.int64],
    ) -> None:
        super().__init__(model, rest, follows)
        self._tangents = tangents.tangents(normals)
        self._slopes = tangents.slopes(rest, triangles, self._isoline_coordinates, follows, normals, self._tangents)

    def only(self, chosen: NDArray[np.integer]) -> Self:
        """Return the binding of some of the vertices, by index."""
        part = super().only(chosen)
        part._tangents, part._slopes = self._tangents[chosen], self._slopes[chosen]
        return part

    def vertices_and_normals(
        self, controls: Controls, out: NDArray[np.float32] | None = None, normals: NDArray[np.float32] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the positions and the unit normals of the deformed surface.

        Parameters
        ----------
        controls : (m, 3, 4) float32
            Of a pose.
        out, normals : (n, 3) float32, optional
            Written to, and returned.

        Returns
        -------
        positions, normals : (n, 3) float32

        Raises
        ------
        ValueError
            Arrays of other shapes.
        """
        out = np.empty_like(self.rest) if out is None else out
        normals = np.empty_like(self.rest) if normals is None else normals
        self._check(controls, out)
        self._check(controls, normals)
        table = _tables.of(len(controls))
        kernels.blend_normals(
            self.rest,
            self._tangents,
            self._slopes,
            self._isoline_coordinates,
            controls,
            self._weights,
            table,
            out,
            normals,
        )
        return out, normals
