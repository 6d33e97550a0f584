"""Skin weights of vertices for bones with known motion: sparse, convex, optimal in the least-squares sense.

With Σ w = 1, the error of a vertex in a frame is Σ_k w_k e_k, where e_k is its error by bone k alone. The weights
therefore minimise ‖E w‖² + λ ‖w − w_0‖² on the simplex. The second term keeps weights of neighbours similar if the
motion does not determine them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

MAX_INFLUENCES = 4
"""Maximum number of bones per vertex that all players support (glTF 2.0, section 3.7.3.3)."""

REGULARISATION_WEIGHT = 1e-6
"""λ per frame, in squared diagonals; among values from 1e-8 to 1e-3, it causes the fewest creases."""


def solve(missed: NDArray[np.float64], expected: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the weights of each vertex for a few candidate bones.

    From all candidates, the one with the most negative weight is removed repeatedly. If no weight is negative and there
    are more than `MAX_INFLUENCES`, the one whose removal costs least is removed (B. Hassibi, D. G. Stork, *Optimal
    Brain Surgeon*, 1993: w_k² / (H⁻¹)_kk).

    Parameters
    ----------
    missed : (n, K, 3F) float64
        E, the error of the vertex by each candidate alone in the F frames, in diagonals.
    expected : (n, K) float64
        Expected weights w_0.

    Returns
    -------
    (n, K) float64
        Weights, none negative and at most `MAX_INFLUENCES` per vertex not 0; their sum is 1.
    """
    count, candidates, _ = missed.shape
    likeness = REGULARISATION_WEIGHT * missed.shape[2] / 3
    # the last unknown is the multiplier of Σ w = 1
    system = np.ones((count, candidates + 1, candidates + 1))
    system[:, :-1, :-1] = missed @ missed.transpose(0, 2, 1) + likeness * np.eye(candidates)
    system[:, -1, -1] = 0
    right = np.column_stack([likeness * expected, np.ones(count)])
    taken = np.ones((count, candidates + 1), dtype=bool)
    weights = np.empty((count, candidates))
    todo = np.arange(count)
    while len(todo):
        there = taken[todo]
        inverse = np.linalg.inv(np.where(there[:, :, None] & there[:, None], system[todo], np.eye(candidates + 1)))
        weights[todo] = found = (inverse @ np.where(there, right[todo], 0)[..., None])[:, :-1, 0]
        there = there[:, :-1]
        outside = found.min(axis=1) < 0
        again = outside | (there.sum(axis=1) > MAX_INFLUENCES)
        stiffness = np.maximum(np.diagonal(inverse, axis1=1, axis2=2)[:, :-1], np.finfo(float).tiny)
        loss = np.where(outside[:, None], found, found**2 / stiffness)
        taken[todo[again], np.where(there, loss, np.inf).argmin(axis=1)[again]] = False
        todo = todo[again]
    return weights


def packed(weights: NDArray[np.float64], bones: NDArray[np.int64]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Convert weights to the layout in a file.

    Parameters
    ----------
    weights : (n, K) float64
        Weights, at most `MAX_INFLUENCES` per vertex not 0; their sum is 1.
    bones : (n, K) int64
        Bone of each weight, below 128.

    Returns
    -------
    weights : (n, 4) float32
        Weights, largest first; their sum is 1 up to rounding in the last two bits.
    bones : (n, 4) uint8
        Bone of each weight, 0 if the weight is 0.
    """
    missing = max(0, MAX_INFLUENCES - weights.shape[1])
    weights, bones = np.pad(weights, ((0, 0), (0, missing))), np.pad(bones, ((0, 0), (0, missing)))
    order = np.argsort(-weights, axis=1, kind="stable")[:, :MAX_INFLUENCES]
    largest = np.take_along_axis(weights, order, axis=1).astype(np.float32)
    largest[:, 0] = 1 - largest[:, 1:].sum(axis=1)
    return largest, np.where(largest > 0, np.take_along_axis(bones, order, axis=1), 0).astype(np.uint8)


def sparse(weights: NDArray[np.floating], bones: NDArray[np.integer], count: int) -> csr_matrix:
    """Return weights (n, K) of bones (n, K) as a sparse matrix (n, count)."""
    there = weights != 0
    rows = np.nonzero(there)[0]
    return csr_matrix((weights[there].astype(np.float64), (rows, bones[there])), shape=(len(weights), count))
