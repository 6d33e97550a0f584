"""Propagation fields and their ladders of isolines (Section 3.1, Eq. 2-3).

A field is a smooth function on the surface; its isolines are levels k = 0 … n_iso − 1, evenly spaced in value, half a
step away from both ends so that each of them crosses triangles. Where a vertex stands on that ladder is a single
number t: the integer part names the isoline below, the fraction blends towards the next one.
"""

from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.surface import tufted
from solver.surface.contacts import TOUCHING, Contacts
from solver.surface.dissection import nested_dissection
from solver.surface.mesh import SolverMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

FIELD_TIE = 100.0
"""Conductance of a contact between two parts that touch, where a cotangent is about 1: fields hardly jump there."""

LOOSE = 1e-5
"""Conductance of a contact at a joint between two parts, as a share of that of others."""

SHIFT = -0.1
"""Where the shift-invert mode works, in units of 1 / area as eigenvalues are: just outside the spectrum."""

PANEL = 2
"""Columns that SuperLU brings up to date together: those of a surface's factor have little in common, and more of them
take a third more time."""

TOLERANCE = 1e-7
"""Of eigenvalues, relative: fields then err by less than the float32 in which ladder coordinates are kept."""

RESTARTS = 300
"""Of ARPACK, which needs a handful where there is a solution."""


def laplacian(mesh: SolverMesh) -> "tuple[csr_matrix, NDArray[np.float64]]":
    """Build the surface operator of a character, each of its parts by itself.

    Cotangents on the tufted cover, whose edges are flipped until it is Delaunay (Sharp and Crane, *A Laplacian for
    Nonmanifold Triangle Meshes*, 2020): slivers and edges of many faces do no harm, and no weight is negative.

    Returns
    -------
    L : (n, n) sparse float64
        Negative semidefinite, rows summing to zero.
    mass : (n,) float64
        Area of each vertex: a third of that of its triangles in the cover.
    """
    L, mass = tufted.laplacian(mesh.vertices, mesh.faces)
    return scipy.sparse.csr_matrix(-L), np.maximum(mass, 1e-12 * mass.max())


def for_fields(
    L: "csr_matrix", ties: Contacts, diagonal: float, holds: NDArray[np.bool_] | None = None
) -> "csr_matrix":
    """Tie parts in the operator whose eigenvectors become fields: what touches then lies between the same isolines.

    Contacts (k,) that do not hold while bones move are tied loosely: fields may jump there, and stay unique.
    """
    loose = 1.0 if holds is None else np.where(holds, 1.0, LOOSE)
    return _tied(L, ties, FIELD_TIE * loose * _nearness(ties, diagonal))


def for_energy(L: "csr_matrix", ties: Contacts, mass: NDArray[np.float64], diagonal: float) -> "csr_matrix":
    """Tie parts in the operator of the energy.

    An integral over the surface, like the energy itself: a contact counts as much as the area it stands for, that of
    its vertex or of the surface opposite, whichever is less, lest a large triangle tear at a small one.
    """
    area = np.minimum(mass[ties.vertices], np.einsum("kc,kc->k", ties.blend, mass[ties.corners]))
    return _tied(L, ties, area / (TOUCHING * diagonal) ** 2 * _nearness(ties, diagonal))


def _nearness(ties: Contacts, diagonal: float) -> NDArray[np.float64]:
    """Return 1 for parts that touch, and less with the square of the distance for those that keep one."""
    touching = TOUCHING * diagonal
    return (touching / np.maximum(touching, ties.gap)) ** 2


def _tied(L: "csr_matrix", ties: Contacts, weight: NDArray[np.float64]) -> "csr_matrix":
    """Add Σ weight · jump² to the form of −L: rows still sum to zero, and L stays negative semidefinite."""
    jump = ties.difference(L.shape[0])
    return scipy.sparse.csr_matrix(L - jump.T @ scipy.sparse.diags(weight) @ jump) if len(weight) else L


def propagation_fields(
    L: "csr_matrix", mass: NDArray[np.float64], vertices: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Solve −L e = λ M e for the smoothest functions, the constant one left out.

    The generalised problem makes a field independent of how densely a region is triangulated. ARPACK works in
    shift-invert mode from a fixed start, and each field's entry of largest size is made positive, so that a mesh always
    gives the same fields; no result depends on that sign.

    Parameters
    ----------
    L : (n, n) sparse
        From `for_fields`.
    mass : (n,) float64
    vertices : (n, 3) float64
        Places by which the work is ordered; no result depends on them.
    count : int
        n_e, less than n − 1.

    Returns
    -------
    (n, count) float64
        Orthonormal in the mass inner product, eigenvalues ascending.

    Raises
    ------
    RuntimeError
        A matrix that is singular to SuperLU, or one on which ARPACK does not converge.
    """
    n, shift = L.shape[0], SHIFT / mass.sum()
    ordered = _Ordered(L, mass, vertices)
    inverse = scipy.sparse.linalg.LinearOperator((n, n), matvec=ordered.factor(shift).solve, dtype=np.float64)
    start = np.cos(ordered.order.astype(np.float64))
    values, found = scipy.sparse.linalg.eigsh(
        -ordered.L, k=count + 1, M=ordered.M, sigma=shift, OPinv=inverse, v0=start, tol=TOLERANCE, maxiter=RESTARTS
    )
    vectors = np.empty((n, count))
    vectors[ordered.order] = found[:, np.argsort(values)[1:]]
    largest = np.argmax(np.abs(vectors), axis=0)
    return vectors * np.sign(vectors[largest, np.arange(count)])


def smoothed(
    L: "csr_matrix",
    mass: NDArray[np.float64],
    vertices: NDArray[np.float64],
    values: NDArray[np.float64],
    length: float,
) -> NDArray[np.float64]:
    """Smooth functions on the surface: solve (M − length² L) f = M values.

    Parameters
    ----------
    L : (n, n) sparse
        From `for_fields`.
    mass : (n,) float64
    vertices : (n, 3) float64
        Places by which the work is ordered; no result depends on them.
    values : (n, k) float64
    length : float
        Over which a step is spread, in the units of L.

    Returns
    -------
    (n, k) float64
        Within the bounds of the values.
    """
    ordered = _Ordered(L, mass, vertices)
    result = np.empty_like(values)
    load = np.ascontiguousarray((mass[:, None] * values)[ordered.order]) / length**2
    result[ordered.order] = ordered.factor(-1 / length**2).solve(load)
    return result


class _Ordered:
    """L and M with their rows in an order that keeps factors sparse."""

    def __init__(self, L: "csr_matrix", mass: NDArray[np.float64], vertices: NDArray[np.float64]) -> None:
        self.order = nested_dissection(L.indptr, L.indices, vertices)
        self.L = scipy.sparse.csr_matrix(L[self.order][:, self.order])
        self.M = scipy.sparse.diags(mass[self.order])

    def factor(self, shift: float) -> "scipy.sparse.linalg.SuperLU":
        """Factor −L − shift M."""
        # what is tied all over is no surface any more, and no plane cuts it at a line: COLAMD fills that in far less
        ordering: Literal["NATURAL", "COLAMD"] = "NATURAL" if self.L.nnz <= 8 * len(self.order) else "COLAMD"
        matrix = scipy.sparse.csc_matrix(-self.L - shift * self.M)
        return scipy.sparse.linalg.splu(matrix, permc_spec=ordering, panel_size=PANEL, options={"SymmetricMode": True})


def ladder_coordinates(fields: NDArray[np.float64], isolines: int) -> NDArray[np.float64]:
    """Say where each vertex stands between the isolines of each field.

    Parameters
    ----------
    fields : (n, n_e) float64
    isolines : int
        n_iso, at least 2.

    Returns
    -------
    (n, n_e) float64
        In [0, n_iso − 1]; vertices beyond the outermost isolines belong to them wholly.
    """
    low, high = fields.min(axis=0), fields.max(axis=0)
    return np.clip((fields - low) / (high - low) * isolines - 0.5, 0.0, isolines - 1.0)


def field_weights(
    vertices: NDArray[np.float64], mass: NDArray[np.float64], fields: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weigh each field by how much of the shape it carries (Eq. 2-3), in the mass inner product, with sum 1.

    The weights scale columns of W and leave its span alone; they act through the interpolation of rotations W_δ and
    where the blend of fields is ambiguous.

    Returns
    -------
    (n_e,) float64
    """
    size = np.linalg.norm((fields * mass[:, None]).T @ vertices, axis=1)
    return size / size.sum()


def blends(ladder: NDArray[np.float64], isolines: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Say which two isolines of each field a vertex lies between, and how far up.

    Parameters
    ----------
    ladder : (n, n_e) float64
    isolines : int

    Returns
    -------
    below : (n, n_e) int64
        At most n_iso − 2.
    upper : (n, n_e) float64
        Share of the isoline above; that below has the rest.
    """
    below = np.minimum(ladder.astype(np.int64), isolines - 2)
    return below, ladder - below


def interpolation(ladder: NDArray[np.float64], isolines: int) -> "csr_matrix":
    """Return φ, the local interpolation scheme: each vertex blends the two isolines of a field that it lies between.

    Used in pre-computation only; at run time the ladder coordinates say the same.

    Returns
    -------
    (n, n_e · n_iso) sparse float64
        Column i · n_iso + k belongs to isoline k of field i; a field's columns sum to 1 in each row.
    """
    n, count = ladder.shape
    below, upper = blends(ladder, isolines)
    column = below + isolines * np.arange(count)
    columns = np.stack([column, column + 1], axis=2).reshape(n, -1)
    values = np.stack([1 - upper, upper], axis=2).reshape(n, -1)
    starts = np.arange(n + 1) * columns.shape[1]
    return scipy.sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape=(n, count * isolines))
