"""Skin weights of vertices for bones whose motion is known: sparse, convex, the best in the least-squares sense.

With Σ w = 1 a vertex misses its place in a frame by Σ_k w_k e_k, where e_k is how far bone k alone would take it from
there. So the weights minimise ‖E w‖² + λ ‖w − w_0‖² on the simplex; the second term keeps neighbours alike where the
motion leaves the weights open.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

MAX_INFLUENCES = 4
"""Bones a vertex; players need support no more (glTF 2.0, section 3.7.3.3)."""

REGULARISATION = 1e-6
"""λ for each frame, in squared diagonals: of what is tried between 1e-8 and 1e-3, it leaves the fewest creases."""


def solve(missed: NDArray[np.float64], expected: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the weights of each vertex among a few candidates.

    Starting from all of them, the one with the most negative weight drops out, else, while there are too many, the one
    whose loss costs least (B. Hassibi, D. G. Stork, *Optimal Brain Surgeon*, 1993: w_k² / (H⁻¹)_kk).

    Parameters
    ----------
    missed : (n, K, 3F) float64
        E: by how much each candidate alone misses the vertex in the F frames, in diagonals.
    expected : (n, K) float64
        w_0.

    Returns
    -------
    (n, K) float64
        Of each vertex at most `MAX_INFLUENCES` that are not 0, none negative; their sum is 1.
    """
    count, candidates, _ = missed.shape
    likeness = REGULARISATION * missed.shape[2] / 3
    # the multiplier of Σ w = 1 is the last unknown
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
    """Bring weights into the form that a file holds.

    Parameters
    ----------
    weights : (n, K) float64
        Of each vertex at most `MAX_INFLUENCES` that are not 0; sum 1.
    bones : (n, K) int64
        The bone of each weight, below 128.

    Returns
    -------
    weights : (n, 4) float32
        Largest first; their sum is 1 to the last bit or the one before.
    bones : (n, 4) uint8
        0 where the weight is.
    """
    missing = max(0, MAX_INFLUENCES - weights.shape[1])
    weights, bones = np.pad(weights, ((0, 0), (0, missing))), np.pad(bones, ((0, 0), (0, missing)))
    order = np.argsort(-weights, axis=1, kind="stable")[:, :MAX_INFLUENCES]
    largest = np.take_along_axis(weights, order, axis=1).astype(np.float32)
    largest[:, 0] = 1 - largest[:, 1:].sum(axis=1)
    return largest, np.where(largest > 0, np.take_along_axis(bones, order, axis=1), 0).astype(np.uint8)


def sparse(weights: NDArray[np.floating], bones: NDArray[np.integer], count: int) -> csr_matrix:
    """Return (n, K) weights of (n, K) bones as a sparse (n, count) matrix."""
    there = weights != 0
    rows = np.nonzero(there)[0]
    return csr_matrix((weights[there].astype(np.float64), (rows, bones[there])), shape=(len(weights), count))
