"""The rigid motion of bones whose skin weights are known, for all frames at once.

Minimises Σ_v ‖Σ_j w_vj (R_j u_v + t_j) − x_v‖² by taking one bone after the other: with the others held, the best
rotation is a polar decomposition (B. H. Le, Z. Deng, *Smooth Skinning Decomposition with Rigid Bones*, 2012, section
4.2). Sums over vertices are taken once: x = W R is linear in the control variables, so that no frame touches a vertex.
Each frame goes through the same continuous steps from the same kind of start: what is close in time stays close.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, hstack

from solver.model import polar

SWEEPS = 30
"""Times that each bone is taken; from the 20th on the error changes in its third digit only."""

AFFINITY = 0.01
"""Share of a pull that keeps a bone with the vertices that are mostly its own: bones could drift apart unseen."""

AFFINITY_POWER = 4
"""Power of the weight by which such a vertex counts."""


@dataclass(frozen=True)
class Moments:
    """Sums over the vertices of a skin; ũ is the rest position [x y z 1].

    Attributes
    ----------
    rest : (B, 4, B, 4) float64
        Σ w_j w_k ũ ũᵀ.
    own : (B, 4) float64
        Σ p_j ũ, with p_j ∝ w_j^4 so that its sum over vertices is that of w_j.
    controls, own_controls : (B, 4, 4m) float64
        Σ w_j ũ W and Σ p_j ũ W: times R, the moments of a pose.
    """

    rest: NDArray[np.float64]
    own: NDArray[np.float64]
    controls: NDArray[np.float64]
    own_controls: NDArray[np.float64]


def moments(rest: NDArray[np.float64], weights: csr_matrix, W: csr_matrix) -> Moments:
    """Sum a skin up.

    Parameters
    ----------
    rest : (n, 3) float64
    weights : (n, B) sparse
        Each bone moves some vertex.
    W : (n, 4m) sparse
        What takes control variables to vertices.
    """
    bones = weights.shape[1]
    powers = weights.power(AFFINITY_POWER)
    own = csr_matrix(powers.multiply(_sums(weights) / _sums(powers)))
    lines, own_lines = blend_lines(rest, weights), blend_lines(rest, own)

    def by_bone(product: NDArray[np.float64]) -> NDArray[np.float64]:
        return product.reshape(4, bones, -1).swapaxes(0, 1)

    return Moments(
        rest=(lines.T @ lines).toarray().reshape(4, bones, 4, bones).transpose(1, 0, 3, 2),
        own=_sums(own_lines).reshape(4, bones).T,
        controls=by_bone((lines.T @ W).toarray()),
        own_controls=by_bone((own_lines.T @ W).toarray()),
    )


def solve(sums: Moments, frames: NDArray[np.floating]) -> NDArray[np.float64]:
    """Find how the bones move.

    Parameters
    ----------
    sums : Moments
    frames : (F, 4m, 3)
        Control variables.

    Returns
    -------
    (F, B, 3, 4) float64
        [rotation | translation] of each bone.
    """
    bones, count = len(sums.own), len(frames)
    # (F, 3, B, 4), so that the sum over all other bones is one matrix product
    own = np.einsum("bac,fcx->fxba", sums.own_controls, frames, optimize=True)
    wanted = np.einsum("bac,fcx->fxba", sums.controls, frames, optimize=True) + AFFINITY * own
    motion = np.empty((count, 3, bones, 4))
    for bone in range(bones):
        motion[:, :, bone] = _rigid(own[:, :, bone], sums.own[bone])
    for _ in range(SWEEPS):
        for bone in range(bones):
            others = sums.rest[:, :, bone].copy()
            others[bone] = 0
            moved = motion.reshape(-1, 4 * bones) @ others.reshape(4 * bones, 4)
            mass = sums.rest[bone, 3, bone] + AFFINITY * sums.own[bone]
            motion[:, :, bone] = _rigid(wanted[:, :, bone] - moved.reshape(count, 3, 4), mass)
    return motion.swapaxes(1, 2)


def _rigid(moment: NDArray[np.float64], mass: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (F, 3, 4) rigid motions that fit Σ x ũᵀ (F, 3, 4) best, given Σ ũ (4,)."""
    middle = mass[:3] / mass[3]
    turns = polar.of_matrices((moment[..., :3] - moment[..., 3:] * middle).reshape(-1, 3, 3))
    return np.concatenate([turns, moment[..., 3:] / mass[3] - (turns @ middle)[..., None]], axis=-1)


def blend_lines(rest: NDArray[np.floating], weights: csr_matrix) -> csr_matrix:
    """Return the (n, 4B) matrix that blends motions: w_j x of all bones, then w_j y, w_j z and w_j.

    Parameters
    ----------
    rest : (n, 3)
    weights : (n, B) sparse
    """
    columns = (*np.split(rest.astype(np.float64), 3, axis=1), np.ones((len(rest), 1)))
    return hstack([weights.multiply(column) for column in columns]).tocsr()


def carried(lines: csr_matrix, motion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a skin is carried: Σ_j w_j M_j ũ.

    Parameters
    ----------
    lines : (n, 4B) sparse
        From `blend_lines`.
    motion : (F, B, 3, 4) float64

    Returns
    -------
    (n, F, 3) float64
    """
    return (lines @ motion.transpose(3, 1, 0, 2).reshape(lines.shape[1], -1)).reshape(lines.shape[0], -1, 3)


def _sums(matrix: csr_matrix) -> NDArray[np.float64]:
    """Return the sum of each column."""
    return np.asarray(matrix.sum(axis=0), dtype=np.float64).ravel()
