"""Skin weights with which rigid bones move a surface as the reduced model does.

In a set of poses t, a vertex with the rest position p is at x(t) = W R(t) in the reduced model, and at T_b(t) p if it
moves with bone b alone. Its weights minimise

    Σ_t ‖Σ_b w_b (T_b(t) p − x(t))‖² + λ ‖w‖²,    Σ_b w_b = 1,  w ≥ 0,

with at most a few weights other than 0. Both T_b(t) p and x(t) are linear, so that sums over the poses are computed
once for all vertices: S_bc = Σ_t T_b T_cᵀ, and H_b = Σ_t T_b Rᵀ. The squares of x(t) are missing in these sums, but
with Σ_b w_b = 1 they only add a constant.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, hstack

from puppetline.compiled import compiled
from solver.model.reduced_model import ReducedModel
from solver.surface.mesh import SolverMesh

MAX_INFLUENCES = 4
"""Number of bones per vertex that all players support (glTF 2.0, section 3.7.3.3)."""

CANDIDATE_BONES = 8
"""Number of bones that are tried for a vertex: those that alone move it with the smallest error."""

REGULARISATION_WEIGHT = 1e-6
"""λ per pose, in squared diagonals. Near a joint, where the motion does not determine weights, they become even."""

NEGLIGIBLE_WEIGHT = 1e-3
"""Largest weight that is left out."""

SQUARE_BOUND = 4.0
"""Upper bound of the squared distance of a vertex from the character's middle, in squared diagonals."""

VERTICES_PER_CHUNK = 65_536
"""Number of vertices that are computed at once, to save memory."""

TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True)
class Weights:
    """Skin weights of vertices.

    Attributes
    ----------
    weights : (n, k) float32
        Weights in descending order, whose sum is 1.
    bones : (n, k) uint16
        Bone of each weight, 0 if the weight is 0.
    """

    weights: NDArray[np.float32]
    bones: NDArray[np.uint16]


def fit(
    model: ReducedModel,
    mesh: SolverMesh,
    controls: NDArray[np.floating],
    motions: NDArray[np.floating],
    *,
    rest: NDArray[np.float64] | None = None,
    influences: int = MAX_INFLUENCES,
) -> Weights:
    """Fit the weights of bones to the surface of a reduced model in some poses.

    A part of the surface that one bone holds as a whole moves with that bone only.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
        The mesh of the model, with n vertices.
    controls : (F, 4m, 3)
        Control variables of the poses, model units.
    motions : (F, b, 4, 3)
        Motions of the bones in these poses for row vectors, mesh file's coordinates. The bones of the model are first.
    rest : (n, 3) float64, optional
        Positions that the bones move, mesh file's coordinates; by default the rest positions of the mesh.
    influences : int, optional
        Maximum number of bones per vertex.

    Returns
    -------
    Weights
        Of the n vertices.
    """
    transforms = _in_model_units(motions.astype(np.float64), model)
    count = transforms.shape[1]
    by_bone = transforms.transpose(1, 2, 0, 3).reshape(4 * count, -1)
    squares = (by_bone @ by_bone.T).reshape(count, 4, count, 4).transpose(0, 2, 1, 3)
    mixed = np.tensordot(controls.astype(np.float64), by_bone.reshape(4 * count, -1, 3), axes=((0, 2), (1, 2)))
    points = np.column_stack([model.to_model(mesh.vertices if rest is None else rest), np.ones(len(mesh.vertices))])
    products = np.empty((len(points), count))
    for start in range(0, len(points), VERTICES_PER_CHUNK):
        rows = np.arange(start, min(start + VERTICES_PER_CHUNK, len(points)))
        W = model.position_matrix(mesh.vertices[rows], rows)
        products[rows] = np.einsum("nbi,ni->nb", (W @ mixed).reshape(-1, count, 4), points[rows])
    shares, bones = np.zeros((len(points), influences)), np.zeros((len(points), influences), dtype=np.int64)
    rigid = model.regions.whole_parts(mesh)
    _fit(points, np.ascontiguousarray(squares), products, float(len(controls)), rigid, shares, bones)
    return packed(shares, bones)


def as_matrix(weights: Weights, bones: int) -> csr_matrix:
    """Return weights as a sparse matrix (n, bones)."""
    rows, columns = np.nonzero(weights.weights)
    values = weights.weights[rows, columns].astype(np.float64)
    return csr_matrix((values, (rows, weights.bones[rows, columns])), shape=(len(weights.weights), bones))


def blend_lines(rest: NDArray[np.floating], weights: csr_matrix) -> csr_matrix:
    """Return the matrix (n, 4B) that blends motions: w_j x of all bones, then w_j y, w_j z and w_j.

    Parameters
    ----------
    rest : (n, 3)
    weights : (n, B) sparse
    """
    columns = (*np.split(rest.astype(np.float64), 3, axis=1), np.ones((len(rest), 1)))
    return hstack([weights.multiply(column) for column in columns]).tocsr()


def packed(shares: NDArray[np.float64], bones: NDArray[np.int64]) -> Weights:
    """Sort weights (n, k) with the sum 1, and round them so that their sum stays 1."""
    order = np.argsort(-shares, axis=1, kind="stable")
    weights = np.take_along_axis(shares, order, axis=1).astype(np.float32)
    weights[:, 0] = 1 - weights[:, 1:].sum(axis=1)
    chosen = np.take_along_axis(bones, order, axis=1)
    return Weights(weights, np.where(weights > 0, chosen, 0).astype(np.uint16))


def _in_model_units(motions: NDArray[np.float64], model: ReducedModel) -> NDArray[np.float64]:
    """Convert motions (F, b, 4, 3) from the mesh file's coordinates."""
    out = motions.copy()
    out[:, :, 3] += np.einsum("i,fbij->fbj", model.center, motions[:, :, :3]) - model.center
    out[:, :, 3] /= float(model.diagonal)
    return out


@compiled
def _fit(rest, squares, products, frames, rigid, shares, bones):
    """Write the weights of each vertex, and their bones.

    Parameters
    ----------
    rest : (n, 4) float64
        Rest positions and 1, model units.
    squares : (b, b, 4, 4) float64
        S of all pairs of bones.
    products : (n, b) float64
        Σ_t T_b(t) p · x(t).
    frames : float
        Number of poses.
    rigid : (n,) int64
        The only bone of a vertex; −1 for none.
    shares : (n, k) float64
        Zeros; written to.
    bones : (n, k) int64
        Zeros; written to.
    """
    count = products.shape[1]
    size = min(count, CANDIDATE_BONES)
    error, Q, L = np.empty(count), np.empty((size, size)), np.empty((size, size))
    active, w, rows = np.empty(size, dtype=np.bool_), np.empty(size), np.empty(size, dtype=np.int64)
    chosen = np.empty(size, dtype=np.int64)
    for v in range(len(rest)):
        if rigid[v] >= 0:
            shares[v, 0], bones[v, 0] = 1.0, rigid[v]
            continue
        for b in range(count):
            error[b] = _square(rest[v], squares[b, b]) - 2 * products[v, b]
        _smallest(error, chosen)
        for i in range(size):
            for j in range(i + 1):
                b, c = chosen[i], chosen[j]
                Q[i, j] = _square(rest[v], squares[b, c]) - products[v, b] - products[v, c] + SQUARE_BOUND * frames
                Q[j, i] = Q[i, j]
            Q[i, i] += REGULARISATION_WEIGHT * frames
        for i in range(size):
            active[i] = True
        _few(Q, shares.shape[1], active, w, L, rows)
        place = 0
        for i in range(size):
            if active[i]:
                shares[v, place], bones[v, place] = w[i], chosen[i]
                place += 1


@compiled(inner=True)
def _smallest(values, chosen):
    """Write the indices of the smallest values, in ascending order; the values are overwritten."""
    for k in range(len(chosen)):
        least = 0
        for i in range(1, len(values)):
            if values[i] < values[least]:
                least = i
        chosen[k] = least
        values[least] = np.inf


@compiled(inner=True)
def _square(p, S):
    """Return pᵀ S p."""
    total = 0.0
    for i in range(4):
        total += p[i] * (S[i, 0] * p[0] + S[i, 1] * p[1] + S[i, 2] * p[2] + S[i, 3] * p[3])
    return total


@compiled(inner=True)
def _few(Q, limit, active, w, L, rows):
    """Minimise wᵀ Q w on the simplex with at most `limit` weights that are not negligible; the others are inactive."""
    while True:
        count = _least_squares(Q, active, w, L, rows)
        least = rows[0]
        for i in range(1, count):
            if w[rows[i]] < w[least]:
                least = rows[i]
        if count == 1 or (count <= limit and w[least] > NEGLIGIBLE_WEIGHT):
            return
        active[least] = False


@compiled(inner=True)
def _least_squares(Q, active, w, L, rows):
    """Minimise wᵀ Q w with Σ w = 1 over the active unknowns, w = Q⁻¹ 1 / 1ᵀ Q⁻¹ 1; return how many there are.

    Q = L Lᵀ is positive definite. The active unknowns are written to `rows`.
    """
    count = 0
    for i in range(len(w)):
        w[i] = 0.0
        if active[i]:
            rows[count] = i
            count += 1
    for i in range(count):
        total = 1.0
        for j in range(i + 1):
            value = Q[rows[i], rows[j]]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(max(value, TINY)) if i == j else value / L[j, j]
        for j in range(i):
            total -= L[i, j] * w[rows[j]]
        w[rows[i]] = total / L[i, i]
    whole = 0.0
    for i in range(count - 1, -1, -1):
        value = w[rows[i]]
        for k in range(i + 1, count):
            value -= L[k, i] * w[rows[k]]
        w[rows[i]] = value / L[i, i]
        whole += w[rows[i]]
    for i in range(count):
        w[rows[i]] /= whole
    return count
