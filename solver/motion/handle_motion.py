"""Rigid motions of handles, for programs that move a surface by joints."""

import numpy as np
from numpy.typing import NDArray

from solver.model import polar
from solver.model.reduced_model import ReducedModel
from solver.surface.mesh import SolverMesh


class HandleMotions:
    """Rigid motions of points on the surface.

    A point of the surface moves by the mean of the transforms around it (`ReducedModel.rows`). Its rigid motion has the
    nearest rotation to that mean, and takes the point to where the surface is.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
    handles : (h, 3) float64
        At least one rest position on the surface, mesh file's coordinates.
    """

    def __init__(self, model: ReducedModel, mesh: SolverMesh, handles: NDArray[np.float64]) -> None:
        self._rows = model.rows(mesh, handles)
        self._size, self._center = float(model.diagonal), model.center
        self._handles = (self._rows @ model.rest_controls) * self._size + self._center

    def of(self, R: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the motions in some frames.

        Parameters
        ----------
        R : (F, 4m, 3)
            Control variables, model units.

        Returns
        -------
        (F, h, 4, 3) float64
            Motions for row vectors, mesh file's coordinates.
        """
        shares = self._rows[:, 3::4]
        transforms = R.reshape(len(R), -1, 4, 3)[:, :, :3].astype(np.float64)
        linear = np.einsum("hm,fmij->fhij", shares, transforms, optimize=True)
        turns = polar.of_matrices(linear.reshape(-1, 3, 3)).reshape(linear.shape)
        places = (self._rows @ R.astype(np.float64)) * self._size + self._center
        offsets = places - np.einsum("hi,fhij->fhj", self._handles, turns)
        return np.concatenate([turns, offsets[:, :, None]], axis=2)
