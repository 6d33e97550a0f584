"""Symmetric skin weights for symmetric surfaces."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.skinning.weights import VERTICES_PER_CHUNK, Weights, packed

TOLERANCE_DIAGONALS = 1e-4
"""Largest distance of a vertex from the mirror image of another one, in diagonals."""


def mirror_images(vertices: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the vertex at the mirror image of each vertex, about the plane in the middle of the bounding box.

    Parameters
    ----------
    vertices : (n, 3) float64
    normal : (3,) float64
        Unit normal of the plane.

    Returns
    -------
    (n,) int64
        −1 if there is none. The image of an image is the vertex itself.
    """
    along = vertices @ normal
    reflected = vertices - (2 * along - along.min() - along.max())[:, None] * normal
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    distance, image = cKDTree(vertices).query(reflected, distance_upper_bound=TOLERANCE_DIAGONALS * diagonal)
    found = np.where(np.isfinite(distance), image, -1)
    return np.where((found >= 0) & (found[found] == np.arange(len(found))), found, -1)


def symmetric(weights: Weights, images: NDArray[np.int64], opposite: NDArray[np.int64]) -> Weights:
    """Average the weights of each vertex with those of its mirror image.

    Parameters
    ----------
    weights : Weights
    images : (n,) int64
        From `mirror_images`.
    opposite : (b,) int64
        Each bone's counterpart on the other side; a bone in the middle is its own.

    Returns
    -------
    Weights
        With as many influences; vertices without an image keep theirs.
    """
    width = weights.weights.shape[1]
    parts = []
    for start in range(0, len(images), VERTICES_PER_CHUNK):
        rows = np.arange(start, min(start + VERTICES_PER_CHUNK, len(images)))
        twins = np.where(images[rows] >= 0, images[rows], rows)
        shares = np.zeros((len(rows), max(len(opposite), width)))
        place = np.arange(len(rows))[:, None]
        np.add.at(shares, (place, weights.bones[rows]), weights.weights[rows] / 2)
        bones = np.where(images[rows, None] >= 0, opposite[weights.bones[twins]], weights.bones[twins])
        np.add.at(shares, (place, bones), weights.weights[twins] / 2)
        chosen = np.argsort(-shares, axis=1, kind="stable")[:, :width]
        kept = np.take_along_axis(shares, chosen, axis=1)
        parts.append((kept / kept.sum(axis=1, keepdims=True), chosen))
    return packed(*(np.concatenate(each) for each in zip(*parts, strict=True)))
