"""Propagation fields and their isolines (Section 3.1, Eq. 2-3).

A field is a smooth function on the surface. Its isolines k = 0 … n_iso − 1 are evenly spaced in value, half a step away
from both ends so that each of them crosses triangles. The *isoline coordinate* t of a vertex is its position among
them: the integer part is the isoline below, the fraction blends towards the next one.
"""

from typing import TYPE_CHECKING, Literal

import numpy as np
import robust_laplacian
import scipy
from numpy.typing import NDArray

from solver.surface.contacts import TOUCH_DIAGONALS, Contacts
from solver.surface.dissection import nested_dissection
from solver.surface.mesh import SolverMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

CONTACT_CONDUCTANCE = 100.0
"""Conductance of a contact between two parts that touch, so large that fields hardly jump; a cotangent is about 1."""

JOINT_CONDUCTANCE_SHARE = 1e-5
"""Conductance of a contact at a joint between two parts, relative to other contacts."""

EIGENVALUE_SHIFT = -0.1
"""Shift of ARPACK's shift-invert mode, in units of 1 / area: just outside the spectrum."""

COLUMNS_PER_SOLVE = 4
"""Number of right-hand sides that are solved at once, to save memory."""

MAX_SAMPLES = 10_000
"""Approximate largest number of vertices that represent a surface where a part of its vertices is enough."""

PANEL_COLUMNS = 2
"""Number of columns in a panel of SuperLU. The columns of a surface's factor have little in common; larger panels take
a third more time."""

EIGENVALUE_TOLERANCE = 1e-7
"""Relative tolerance of eigenvalues, with which errors of fields are below the float32 precision of isoline
coordinates."""

MAX_RESTARTS = 300
"""Largest number of restarts of ARPACK, which needs a few if there is a solution."""


def laplacian(mesh: SolverMesh) -> "tuple[csr_matrix, NDArray[np.float64]]":
    """Build the Laplacian of a character, without contacts between its parts.

    It is the cotangent Laplacian of the tufted cover, for surfaces with slivers, borders and edges of many faces (N.
    Sharp and K. Crane, *A Laplacian for Nonmanifold Triangle Meshes*, SGP 2020).

    Returns
    -------
    L : (n, n) sparse float64
        Negative semidefinite, rows sum to zero.
    mass : (n,) float64
        Area of each vertex, more than 0.
    """
    L, areas = robust_laplacian.mesh_laplacian(mesh.vertices, mesh.faces)
    np.negative(L.data, out=L.data)  # a second matrix would need as much memory
    mass = areas.diagonal()
    return L.T, np.maximum(mass, 1e-12 * mass.max())  # symmetric; transposed, its columns are rows


def field_operator(
    L: "csr_matrix", ties: Contacts, diagonal: float, holds: NDArray[np.bool_] | None = None
) -> "csr_matrix":
    """Add contacts to the operator whose eigenvectors become fields, so that they are continuous from part to part.

    Contacts (k,) that do not hold while bones move have a small conductance: fields may jump there, and stay unique.
    """
    loose = 1.0 if holds is None else np.where(holds, 1.0, JOINT_CONDUCTANCE_SHARE)
    return _tied(L, ties, CONTACT_CONDUCTANCE * loose * _nearness(ties, diagonal))


def energy_operator(L: "csr_matrix", ties: Contacts, mass: NDArray[np.float64], diagonal: float) -> "csr_matrix":
    """Add contacts to the operator of the energy.

    Like the energy, this is an integral over the surface: the weight of a contact is the smaller of the areas of its
    vertex and of the surface opposite, so that a large triangle does not distort a small one.
    """
    area = np.minimum(mass[ties.vertices], np.einsum("kc,kc->k", ties.blend, mass[ties.corners]))
    return _tied(L, ties, area / (TOUCH_DIAGONALS * diagonal) ** 2 * _nearness(ties, diagonal))


def _nearness(ties: Contacts, diagonal: float) -> NDArray[np.float64]:
    """Return 1 for contacts that touch, and less with the square of the distance for others."""
    touching = TOUCH_DIAGONALS * diagonal
    return (touching / np.maximum(touching, ties.gap)) ** 2


def _tied(L: "csr_matrix", ties: Contacts, weight: NDArray[np.float64]) -> "csr_matrix":
    """Add Σ weight · jump² to the quadratic form of −L: rows still sum to zero, L stays negative semidefinite."""
    jump = ties.difference(L.shape[0])
    return scipy.sparse.csr_matrix(L - jump.T @ scipy.sparse.diags(weight) @ jump) if len(weight) else L


class SurfaceOperator:
    """An operator on functions of a surface, factored in an elimination order that keeps factors sparse.

    Parameters
    ----------
    L : (n, n) sparse
        From `field_operator`.
    mass : (n,) float64
    vertices : (n, 3) float64
        Positions for the elimination order; no result depends on them.

    Attributes
    ----------
    samples : slice
        Vertices that represent the surface: all of a small one.
    areas : (c,) float64
        Area of each of them.
    """

    def __init__(self, L: "csr_matrix", mass: NDArray[np.float64], vertices: NDArray[np.float64]) -> None:
        self.samples = slice(None, None, max(1, len(mass) // MAX_SAMPLES))
        self.areas = mass[self.samples]
        self._order = nested_dissection(L.indptr, L.indices, vertices)
        self._L = scipy.sparse.csr_matrix(L[self._order][:, self._order])
        self._mass = mass[self._order]
        self._M = scipy.sparse.diags(self._mass)

    def propagation_fields(self, count: int) -> NDArray[np.float64]:
        """Solve −L e = λ M e for the smoothest functions except the constant one.

        The generalised problem makes fields independent of the density of the mesh. ARPACK starts from a fixed vector,
        and the entry of largest size is made positive in each field, so that a mesh always has the same fields. No
        result depends on that sign.

        Parameters
        ----------
        count : int
            n_e, less than n − 1.

        Returns
        -------
        (n, count) float64
            Orthonormal in the mass inner product, by ascending eigenvalue.

        Raises
        ------
        RuntimeError
            SuperLU finds the matrix singular, or ARPACK does not converge.
        """
        n, shift = len(self._order), EIGENVALUE_SHIFT / self._mass.sum()
        inverse = scipy.sparse.linalg.LinearOperator((n, n), matvec=self._factor(shift).solve, dtype=np.float64)
        values, found = scipy.sparse.linalg.eigsh(
            -self._L,
            k=count + 1,
            M=self._M,
            sigma=shift,
            OPinv=inverse,
            v0=np.cos(self._order.astype(np.float64)),
            tol=EIGENVALUE_TOLERANCE,
            maxiter=MAX_RESTARTS,
        )
        vectors = np.empty((n, count))
        vectors[self._order] = found[:, np.argsort(values)[1:]]
        return with_fixed_signs(vectors)

    def smoothed(self, values: NDArray[np.float64], length: float) -> NDArray[np.float64]:
        """Smooth functions on the surface: solve (M − length² L) f = M values.

        Parameters
        ----------
        values : (n, k) float64
        length : float
            Length over which a step is spread, in the units of L.

        Returns
        -------
        (n, k) float64
            Within the bounds of the values.
        """
        result = np.empty_like(values)
        load = np.ascontiguousarray(self._mass[:, None] * values[self._order]) / length**2
        result[self._order] = self._factor(-1 / length**2).solve(load)
        return result

    def _factor(self, shift: float) -> "scipy.sparse.linalg.SuperLU":
        """Factor −L − shift M."""
        return _factored(-self._L - shift * self._M)


def solve(matrix: "csr_matrix", load: NDArray[np.float64], vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve a symmetric positive definite matrix on the vertices of a surface for (n, k) right-hand sides."""
    order = nested_dissection(matrix.indptr, matrix.indices, vertices)
    factor, result = _factored(matrix[order][:, order]), np.empty_like(load)
    for start in range(0, load.shape[1], COLUMNS_PER_SOLVE):
        columns = slice(start, start + COLUMNS_PER_SOLVE)
        result[order, columns] = factor.solve(np.ascontiguousarray(load[order, columns]))
    return result


def _factored(matrix: "csr_matrix") -> "scipy.sparse.linalg.SuperLU":
    """Factor a matrix whose rows are in an order by nested dissection."""
    # with contacts everywhere the graph is not a surface, so that planes do not cut it at a line: COLAMD is better
    ordering: Literal["NATURAL", "COLAMD"] = "NATURAL" if matrix.nnz <= 8 * matrix.shape[0] else "COLAMD"
    return scipy.sparse.linalg.splu(
        scipy.sparse.csc_matrix(matrix), permc_spec=ordering, panel_size=PANEL_COLUMNS, options={"SymmetricMode": True}
    )


def with_fixed_signs(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, k) vectors with the sign that makes their entry of largest size positive."""
    largest = np.argmax(np.abs(vectors), axis=0)
    return vectors * np.sign(vectors[largest, np.arange(vectors.shape[1])])


def compute_isoline_coordinates(fields: NDArray[np.float64], isolines: int) -> NDArray[np.float64]:
    """Compute the position of each vertex among the isolines of each field.

    Parameters
    ----------
    fields : (n, n_e) float64
    isolines : int
        n_iso, at least 2.

    Returns
    -------
    (n, n_e) float64
        In [0, n_iso − 1]; vertices beyond the outermost isolines are clamped to them.
    """
    low, high = fields.min(axis=0), fields.max(axis=0)
    return np.clip((fields - low) / (high - low) * isolines - 0.5, 0.0, isolines - 1.0)


def field_weights(
    vertices: NDArray[np.float64], mass: NDArray[np.float64], fields: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute the weight of each field: its share of the shape (Eq. 2-3) in the mass inner product, with sum 1.

    The weights scale columns of W and do not change its span. They act through the interpolation of rotations W_δ, and
    where the blend of fields is ambiguous.

    Returns
    -------
    (n_e,) float64
    """
    size = np.linalg.norm((fields * mass[:, None]).T @ vertices, axis=1)
    return size / size.sum()


def blends(isoline_coordinates: NDArray[np.float64], isolines: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Split isoline coordinates into the isoline below and the fraction above it.

    Parameters
    ----------
    isoline_coordinates : (n, n_e) float64
    isolines : int

    Returns
    -------
    below : (n, n_e) int64
        At most n_iso − 2.
    upper : (n, n_e) float64
        Weight of the isoline above; that of the isoline below is the rest.
    """
    below = np.minimum(isoline_coordinates.astype(np.int64), isolines - 2)
    return below, isoline_coordinates - below


def interpolation(isoline_coordinates: NDArray[np.float64], isolines: int) -> "csr_matrix":
    """Return φ, the local interpolation: each vertex blends the two isolines of a field that it lies between.

    It is used in pre-computation only; at run time isoline coordinates replace it.

    Returns
    -------
    (n, n_e · n_iso) sparse float64
        Column i · n_iso + k belongs to isoline k of field i; the columns of a field sum to 1 in each row.
    """
    n, count = isoline_coordinates.shape
    below, upper = blends(isoline_coordinates, isolines)
    column = below + isolines * np.arange(count)
    columns = np.stack([column, column + 1], axis=2).reshape(n, -1)
    values = np.stack([1 - upper, upper], axis=2).reshape(n, -1)
    starts = np.arange(n + 1) * columns.shape[1]
    return scipy.sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(n, count * isolines))
