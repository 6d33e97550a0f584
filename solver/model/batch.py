"""Vertices of many frames at a time, for measuring the stretch, errors and normals of a recording.

The vertices of one *cell* of the surface lie between the same isolines of every field and blend the same transforms.
With u_i in [0, 1] the position between two isolines of field i, X = [x y z 1] (T + Σ_i u_i D_i), where T and D_i are
sums and differences of rows of R. They are gathered once per cell for all frames; then every vertex is one row of a
small matrix product.
"""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.reduced_model import ReducedModel
from solver.surface.mesh import SolverMesh

MAX_BATCH_FRAMES = 64
"""Largest number of frames in a batch."""

MIN_BATCH_FRAMES, MAX_BATCH_NUMBERS = 8, 6_000_000
"""Smallest number of frames in a batch, and the largest number of coordinates in a larger batch."""


class BatchBinding:
    """Rest positions with their isoline coordinates, sorted by cells.

    Parameters
    ----------
    model, rest, follows
        As for `solver.model.binding.Binding`.
    """

    def __init__(self, model: ReducedModel, rest: NDArray[np.floating], follows: NDArray[np.int64]) -> None:
        self._model, self._given = model, (rest, follows)
        isoline_coordinates = model.isoline_coordinates[follows]
        below = np.minimum(isoline_coordinates.astype(np.int32), model.isolines - 2)
        self._order = np.lexsort(below.T)
        below = below[self._order]
        new = np.ones(len(below), dtype=bool)
        new[1:] = (below[1:] != below[:-1]).any(axis=1)
        self._cells = np.append(np.flatnonzero(new), len(below))
        self._below = below[self._cells[:-1]] + model.isolines * np.arange(below.shape[1], dtype=np.int32)
        self._between = (isoline_coordinates[self._order] - below).astype(np.float32)
        places = model.to_model(rest[self._order].astype(np.float64))
        self._rest = np.column_stack([places, np.ones(len(places))]).astype(np.float32)

    @classmethod
    def of_solver_mesh(cls, model: ReducedModel, mesh: SolverMesh) -> "BatchBinding":
        """Bind the vertices of the solver mesh."""
        return cls(model, mesh.vertices, np.arange(len(mesh.vertices)))

    def __len__(self) -> int:
        """Return the number of vertices."""
        return len(self._order)

    def only(self, chosen: NDArray[np.integer]) -> "BatchBinding":
        """Return the binding of some of the vertices, by index."""
        rest, follows = self._given
        return BatchBinding(self._model, rest[chosen], follows[chosen])

    @property
    def batch_frames(self) -> int:
        """Number of frames to pass to `vertices` at a time."""
        return min(MAX_BATCH_FRAMES, max(MIN_BATCH_FRAMES, MAX_BATCH_NUMBERS // (3 * len(self))))

    def vertices(self, R: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return X = W R of several frames, in the mesh file's coordinates.

        Parameters
        ----------
        R : (F, 4m, 3)
            Control variables, model units.

        Returns
        -------
        (n, 3, F) float32
        """
        return self._blended(R, self._model.center)

    def displacements(self, R: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return W R in mesh units, relative to the middle of the character.

        Differences of control variables give displacements. Control variables give positions whose precision does not
        depend on the character's distance from the origin.
        """
        return self._blended(R, np.zeros(3))

    def largest_displacements(self, R: NDArray[np.floating]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Find the vertex with the largest displacement in each frame.

        Parameters
        ----------
        R : (F, 4m, 3)
            Differences of control variables, model units.

        Returns
        -------
        distance : (F,) float32
            Displacement of that vertex, mesh units.
        vertex : (F,) int64
        """
        largest, place = np.empty(len(R), dtype=np.float32), np.empty(len(R), dtype=np.int64)
        for start in range(0, len(R), self.batch_frames):
            part = slice(start, start + self.batch_frames)
            moved = self.displacements(R[part])
            square = np.einsum("nxf,nxf->nf", moved, moved)
            largest[part], place[part] = np.sqrt(square.max(axis=0)), square.argmax(axis=0)
        return largest, place

    def _blended(self, R: NDArray[np.floating], origin: NDArray[np.float64]) -> NDArray[np.float32]:
        out = np.empty((len(self._rest), 3 * len(R)), dtype=np.float32)
        lines, slopes = self._side_by_side(R, origin)
        _blend(self._rest, self._between, self._cells, self._below, lines, slopes, self._order, out)
        return out.reshape(len(out), 3, len(R))

    def _side_by_side(
        self, R: NDArray[np.floating], origin: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return each isoline's transform, all frames side by side, and its difference to the next isoline's."""
        model = self._model
        weights = np.repeat(model.weights * model.diagonal, model.isolines)
        lines = R.transpose(1, 2, 0).reshape(len(weights), 4, 3, len(R)) * weights[:, None, None, None]
        lines[: model.isolines, 3] += origin[:, None]  # added once, to the first field
        lines = lines.reshape(len(weights), 4, 3 * len(R))
        slopes = np.diff(lines, axis=0, append=0)
        return lines.astype(np.float32), slopes.astype(np.float32)


@compiled(inner=True)
def _gather(below, lines, slopes, cell):
    """Collect what a cell blends, T and then each D_i, into cell (4 + 4 n_e, columns)."""
    for i in range(len(below)):
        for c in range(4):
            for s in range(cell.shape[1]):
                cell[4 * (i + 1) + c, s] = slopes[below[i], c, s]
                cell[c, s] = lines[below[i], c, s] if i == 0 else cell[c, s] + lines[below[i], c, s]


@compiled(inner=True, fastmath=True)
def _place(rest, between, cell, out):
    """Blend one vertex into out (columns,)."""
    x, y, z, one = rest[0], rest[1], rest[2], rest[3]
    for s in range(len(out)):
        out[s] = x * cell[0, s] + y * cell[1, s] + z * cell[2, s] + one * cell[3, s]
    for i in range(len(between)):
        k = 4 * (i + 1)
        u = between[i]
        a, b, c = u * x, u * y, u * z
        for s in range(len(out)):
            out[s] += a * cell[k, s] + b * cell[k + 1, s] + c * cell[k + 2, s] + u * cell[k + 3, s]


@compiled
def _blend(rest, between, cells, below, lines, slopes, order, out):
    """Blend all vertices into out (n, columns), in their original order."""
    cell = np.empty((4 + 4 * between.shape[1], lines.shape[2]), dtype=np.float32)
    for number in range(len(below)):
        _gather(below[number], lines, slopes, cell)
        for v in range(cells[number], cells[number + 1]):
            _place(rest[v], between[v], cell, out[order[v]])
