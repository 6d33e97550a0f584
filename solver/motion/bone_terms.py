"""Terms of bones in the normal equations: the surface that they hold, and priors of the rotations."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.fields import blends, interpolation
from solver.model.reduced_model import ReducedModel
from solver.model.rotations import RotationMode
from solver.surface.mesh import SolverMesh

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

BONE_STIFFNESS = 40.0
"""Weight λ in units of trace(A) / trace(Wᵀ diag(m) W). With it, errors of a cartoon body's limbs are 2 to 6°; with
a weight of 10, they are 8°."""

BLEND_POWER = 2
"""Power p of a vertex's largest share, by which it is held less where bones blend. With 8, the surface is up to 1.3
times farther from artists' skins of animals; with 2, edges of people stretch to 1.21 instead of 1.18 at the 99th
percentile."""

PRIOR_WEIGHT = 1.0
"""Weight μ of a bone's rotation relative to the surface's covariance; a weight of 4 has the same result."""

DISTANT_BONE_WEIGHT = 1e-3
"""Weight of the mean rotation of all bones relative to that of nearby bones."""


@dataclass(frozen=True, eq=False)
class BoneTerms:
    """Terms of the surface that b bones hold in the normal equations.

    Attributes
    ----------
    normal : (4m, 4m) float64
        λ Wᵀ diag(m) W.
    pull : (4m, 4b) float64
        λ Wᵀ diag(m s_b) [X 1] for each bone; times the stack of T_b in model units, it is the right-hand side.
    """

    normal: NDArray[np.float64]
    pull: NDArray[np.float64]


def bone_terms(model: ReducedModel, mesh: SolverMesh, scale: float) -> BoneTerms:
    """Add up the terms λ Σ_v m_v ‖W_v R − Σ_b s_vb [x_v 1] T_b‖² of held vertices.

    s_vb are the model's shares of the bones, and m_v = Σ_b s_vb a_v / Σ_u s_ub a_u, with the areas a, times
    (max_b s_vb)^p. All bones thus have about the same weight: with weights by area, the head and hands of a cartoon
    body would outweigh its arms.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
    scale : float
        Trace of the energy's matrix.
    """
    unknowns, count = len(model.A), len(model.bones)
    normal, pull = np.zeros((unknowns, unknowns)), np.zeros((unknowns, 4 * count))
    if not count:
        return BoneTerms(normal, pull)
    shares, area = model.held_shares(), mesh.vertex_areas
    mass = area * (shares @ (1 / np.maximum(shares.T @ area, 1e-300)))
    mass *= shares.max(axis=1).toarray().ravel() ** BLEND_POWER
    below, upper = blends(model.isoline_coordinates.astype(np.float64), model.isolines)
    rest = model.to_model(mesh.vertices)
    per_bone = shares.indptr, shares.indices, shares.data
    _add_held(rest, below, upper, model.weights, model.isolines, mass, *per_bone, normal, pull)
    normal = np.tril(normal) + np.tril(normal, -1).T
    trace = np.trace(normal)
    stiffness = BONE_STIFFNESS * scale / trace if trace > 0 else 0.0
    return BoneTerms(stiffness * normal, stiffness * pull)


@compiled
def _add_held(rest, below, upper, weights, isolines, mass, starts, bones, shares, normal, pull):
    """Add the lower triangle of Wᵀ diag(m) W to `normal`, and Wᵀ diag(m s_b) [X 1] to `pull`.

    Parameters
    ----------
    rest : (n, 3) float64
    below, upper : (n, n_e)
        From `fields.blends`.
    weights : (n_e,) float64
        Field weights.
    isolines : int
    mass : (n,) float64
    starts, bones, shares
        Sparse shares (n, b) of the bones, by rows.
    normal : (4m, 4m) float64
    pull : (4m, 4b) float64
    """
    count = len(weights)
    column, blend = np.empty(2 * count, dtype=np.int64), np.empty(2 * count)
    h, outer = np.ones(4), np.empty((4, 4))
    for v in range(len(rest)):
        if mass[v] == 0:
            continue
        for i in range(count):
            column[2 * i] = 4 * (i * isolines + below[v, i])
            column[2 * i + 1] = column[2 * i] + 4
            blend[2 * i], blend[2 * i + 1] = weights[i] * (1 - upper[v, i]), weights[i] * upper[v, i]
        h[0], h[1], h[2] = rest[v, 0], rest[v, 1], rest[v, 2]
        for r in range(4):
            for c in range(4):
                outer[r, c] = mass[v] * h[r] * h[c]
        for j in range(2 * count):
            for k in range(j + 1):
                _add_block(normal, column[j], column[k], blend[j] * blend[k], outer)
            for entry in range(starts[v], starts[v + 1]):
                _add_block(pull, column[j], 4 * bones[entry], blend[j] * shares[entry], outer)


@compiled(inner=True, forceinline=True)
def _add_block(matrix, row, column, factor, block):
    for r in range(4):
        for c in range(4):
            matrix[row + r, column + c] += factor * block[r, c]


def rotation_weights(model: ReducedModel, mode: RotationMode) -> "csr_matrix":
    """Return the weight of each rotation in each vertex: (n, r) sparse float64, rows sum to 1 or n_e."""
    if mode != "clusters":
        return interpolation(model.isoline_coordinates.astype(np.float64), model.isolines)
    n = len(model.cluster)
    return scipy.sparse.csr_matrix((np.ones(n), model.cluster, np.arange(n + 1)))


def bone_shares(
    together: "csr_matrix", area: NDArray[np.float64], bone: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """Return the share of each bone in the area of each rotation.

    Parameters
    ----------
    together : (n, r) sparse float64
        From `rotation_weights`.
    area : (n,) float64
    bone : (n,) int64
        Bone of each vertex; −1 for none.
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


def nearby_motions(model: ReducedModel, mesh: SolverMesh) -> NDArray[np.float64]:
    """Return the map from the stack of the bones' T_b to the mean of those near each isoline.

    Returns
    -------
    (4m, 4b) float64
    """
    count = len(model.bones)
    around = interpolation(model.isoline_coordinates.astype(np.float64), model.isolines)
    shares = _with_mean(bone_shares(around, mesh.vertex_areas, model.regions.owner, count))
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


def nearby_rotations(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the map from the stack of the bones' T_b to the mean of the rotations of the bones nearby.

    Parameters
    ----------
    shares : (r, b) float64
        Shares of the bones in the area, held or not.

    Returns
    -------
    (3r, 4b) float64
    """
    return _of_linear_parts(_with_mean(shares))


def _with_mean(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add a small share of the mean of all bones, for parts of the surface without a bone."""
    return shares + DISTANT_BONE_WEIGHT * shares.mean(axis=0)


def _of_linear_parts(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3r, 4b) map that adds up the linear parts of b motions with (r, b) weights."""
    return np.einsum("rb,xk->rxbk", weights, np.eye(3, 4)).reshape(3 * len(weights), -1)
