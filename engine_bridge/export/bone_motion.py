"""Rigid motion of bones with known skin weights, for all frames at once.

Minimises Σ_v ‖Σ_j w_vj (R_j u_v + t_j) − x_v‖² over one bone after the other: with the other bones fixed, the best
rotation is a polar decomposition (B. H. Le, Z. Deng, *Smooth Skinning Decomposition with Rigid Bones*, 2012, section
4.2). Because x = W R is linear in the control variables, sums over vertices are computed only once, not for each frame.
All frames start and iterate in the same way, and all steps are continuous, so that results do not jump between frames.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from solver.model import polar
from solver.skinning.weights import blend_lines

ITERATIONS = 30
"""Number of iterations over all bones; after the 20th, only the third digit of the error changes."""

AFFINITY_WEIGHT = 0.01
"""Weight of the term that keeps a bone near its vertices, because bones could drift apart without it."""

AFFINITY_POWER = 4
"""Exponent of skin weights in that term."""


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
        Σ w_j ũ W and Σ p_j ũ W, which times R are the moments of a pose.
    """

    rest: NDArray[np.float64]
    own: NDArray[np.float64]
    controls: NDArray[np.float64]
    own_controls: NDArray[np.float64]


def moments(rest: NDArray[np.float64], weights: csr_matrix, W: csr_matrix) -> Moments:
    """Return the sums over a skin.

    Parameters
    ----------
    rest : (n, 3) float64
    weights : (n, B) sparse
        Weights, where each bone moves at least one vertex.
    W : (n, 4m) sparse
        Matrix from control variables to vertices.
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
    """Return the motion of the bones.

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
    wanted = np.einsum("bac,fcx->fxba", sums.controls, frames, optimize=True) + AFFINITY_WEIGHT * own
    motion = np.empty((count, 3, bones, 4))
    for bone in range(bones):
        motion[:, :, bone] = _rigid(own[:, :, bone], sums.own[bone])
    for _ in range(ITERATIONS):
        for bone in range(bones):
            others = sums.rest[:, :, bone].copy()
            others[bone] = 0
            moved = motion.reshape(-1, 4 * bones) @ others.reshape(4 * bones, 4)
            mass = sums.rest[bone, 3, bone] + AFFINITY_WEIGHT * sums.own[bone]
            motion[:, :, bone] = _rigid(wanted[:, :, bone] - moved.reshape(count, 3, 4), mass)
    return motion.swapaxes(1, 2)


def _rigid(moment: NDArray[np.float64], mass: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rigid motions (F, 3, 4) that best fit Σ x ũᵀ (F, 3, 4), given Σ ũ (4,)."""
    middle = mass[:3] / mass[3]
    turns = polar.of_matrices((moment[..., :3] - moment[..., 3:] * middle).reshape(-1, 3, 3))
    return np.concatenate([turns, moment[..., 3:] / mass[3] - (turns @ middle)[..., None]], axis=-1)


def carried(lines: csr_matrix, motion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the positions of a skin: Σ_j w_j M_j ũ.

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
