"""What bones add to a reduced model: the surface that they hold, and the turns that they draw the rotations to."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.model.fields import interpolation
from solver.model.reduced_model import ReducedModel, position_matrix
from solver.model.rotations import RotationMode
from solver.surface.mesh import SolverMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

BONE_STIFFNESS = 40.0
"""λ in units of trace(A) / trace(Σ_b W_bᵀ M_b W_b): limbs of a cartoon body are then off by 2 to 6°, at 10 by 8°."""

PRIOR_WEIGHT = 1.0
"""μ: what a bone's rotation counts against the surface's covariance; at 4 the result is the same."""

DISTANT_BONE_WEIGHT = 1e-3
"""What the mean rotation of all bones counts beside that of the bones nearby."""


@dataclass(frozen=True, eq=False)
class BoneTerms:
    """The surface that b bones hold, in the normal equations.

    Attributes
    ----------
    normal : (4m, 4m) float64
        λ Σ_b W_bᵀ M_b W_b.
    pull : (4m, 4b) float64
        λ W_bᵀ M_b [X_b 1] for each bone: times the stack of T_b, in model units, the right-hand side.
    """

    normal: NDArray[np.float64]
    pull: NDArray[np.float64]


def bone_terms(model: ReducedModel, mesh: SolverMesh, scale: float) -> BoneTerms:
    """Add up the rows of the vertices that each bone holds, weighted by their share of its area.

    So each bone counts the same: by area, the head and the hands of a cartoon body would outweigh its arms.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
    scale : float
        Trace of the energy's matrix.
    """
    unknowns, count = len(model.A), len(model.bones)
    normal, pull = np.zeros((unknowns, unknowns)), np.zeros((unknowns, 4 * count))
    affine = np.tile(np.eye(4), (unknowns // 4, 1))  # W of it is [X 1]
    for bone in range(count):
        held = model.regions.of(bone)
        if not len(held):
            continue
        W = position_matrix(
            model.to_model(mesh.vertices[held]), model.ladder[held].astype(np.float64), model.weights, model.isolines
        )
        there = np.unique(W.indices)
        area = mesh.vertex_areas[held]
        dense = np.sqrt(area / max(float(area.sum()), 1e-300))[:, None] * W[:, there].toarray()
        product = dense.T @ dense
        normal[np.ix_(there, there)] += product
        pull[there, 4 * bone : 4 * bone + 4] = product @ affine[there]
    trace = np.trace(normal)
    stiffness = BONE_STIFFNESS * scale / trace if trace > 0 else 0.0
    return BoneTerms(stiffness * normal, stiffness * pull)


def turned_together(model: ReducedModel, mode: RotationMode) -> "csr_matrix":
    """Return by how much each vertex takes part in each rotation: (n, r) sparse float64, rows sum to 1 or n_e."""
    if mode != "clusters":
        return interpolation(model.ladder.astype(np.float64), model.isolines)
    n = len(model.cluster)
    return scipy.sparse.csr_matrix((np.ones(n), model.cluster, np.arange(n + 1)))


def bone_shares(
    together: "csr_matrix", area: NDArray[np.float64], bone: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """Return the share of the area of what turns together that each bone has.

    Parameters
    ----------
    together : (n, r) sparse float64
        From `turned_together`.
    area : (n,) float64
    bone : (n,) int64
        That each vertex counts for; −1 for none.
    count : int
        Number of bones.

    Returns
    -------
    (r, b) float64
    """
    of_bone = np.zeros((len(bone), count))
    some = np.flatnonzero(bone >= 0)
    of_bone[some, bone[some]] = area[some]
    return (together.T @ of_bone) / np.maximum(together.T @ area, 1e-300)[:, None]


def blended(model: ReducedModel, mesh: SolverMesh) -> NDArray[np.float64]:
    """Return the map from the stack of the bones' T_b to the mean of those near each isoline, by their shares.

    Returns
    -------
    (4m, 4b) float64
    """
    count = len(model.bones)
    around = interpolation(model.ladder.astype(np.float64), model.isolines)
    shares = _with_the_rest(bone_shares(around, mesh.vertex_areas, model.regions.owner, count))
    total = shares.sum(axis=1, keepdims=True)
    whole: NDArray[np.float64] = np.where(total > 0, shares / np.maximum(total, 1e-300), 1 / count)
    return np.kron(whole, np.eye(4)).astype(np.float64)


def prior(shares: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the map from the stack of the bones' T_b to the stack of μ Σ_b a_cb s_c Q_b.

    Parameters
    ----------
    shares : (r, b) float64
        a_cb.
    size : (r,) float64
        s_c.

    Returns
    -------
    (3r, 4b) float64
    """
    return _of_linear_parts(PRIOR_WEIGHT * shares * size[:, None])


def turns_nearby(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the map from the stack of the bones' T_b to the mean of the rotations of the bones nearby.

    Parameters
    ----------
    shares : (r, b) float64
        Of the area that belongs to the bones, held or not.

    Returns
    -------
    (3r, 4b) float64
    """
    return _of_linear_parts(_with_the_rest(shares))


def _with_the_rest(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add a little of what all bones do on average: some surface has no bone."""
    return shares + DISTANT_BONE_WEIGHT * shares.mean(axis=0)


def _of_linear_parts(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3r, 4b) map that adds up the linear parts of b motions with (r, b) weights."""
    return np.einsum("rb,xk->rxbk", weights, np.eye(3, 4)).reshape(3 * len(weights), -1)
