"""Vertices in ten bytes: positions in 16 bits per axis of their bounding box, normals in an octahedral encoding.

The octahedral encoding projects unit normals on an octahedron, and unfolds it into a square.
"""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled

BOX_STEPS = 65535
"""Number of steps along each side of the box."""

SQUARE_STEPS = 32767
"""Number of steps along each half side of the square."""


def quantised(
    positions: NDArray[np.float32], normals: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.uint16], NDArray[np.int16]]:
    """Return the bounding box of vertices, and positions and normals as integers.

    Parameters
    ----------
    positions, normals : (n, 3) float32
        Finite; a normal of zero becomes +z.

    Returns
    -------
    box : (2, 3) float32
        Lower and upper corner.
    places : (n, 3) uint16
        Positions in steps of the box. The error of each coordinate is at most half a step plus the rounding of float32.
    folded : (n, 2) int16
        Normals as points of the square.
    """
    box = np.empty((2, 3), dtype=np.float32)
    places, folded = np.empty(positions.shape, dtype=np.uint16), np.empty((len(normals), 2), dtype=np.int16)
    _quantise(positions, normals, box, places, folded)
    return box, places, folded


def positions_of(box: NDArray[np.float32], places: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return the (n, 3) float32 positions of steps in a box."""
    return box[0] + places.astype(np.float32) * ((box[1] - box[0]) / np.float32(BOX_STEPS))


def normals_of(folded: NDArray[np.int16]) -> NDArray[np.float32]:
    """Unfold (n, 2) points of the square into (n, 3) float32 unit normals."""
    u, v = np.maximum(folded.astype(np.float32) / np.float32(SQUARE_STEPS), -1).T
    z = 1 - np.abs(u) - np.abs(v)
    beyond = np.maximum(-z, 0)
    normals = np.column_stack([u - np.copysign(beyond, u), v - np.copysign(beyond, v), z])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@compiled
def _quantise(positions, normals, box, places, folded):
    one, half = np.float32(1), np.float32(0.5)
    for axis in range(3):
        low = high = np.float64(positions[0, axis])
        for v in range(1, len(positions)):
            place = np.float64(positions[v, axis])
            low, high = min(low, place), max(high, place)
        box[0, axis], box[1, axis] = low, high
        scale = BOX_STEPS / (high - low) if high > low else 0.0
        for v in range(len(positions)):
            places[v, axis] = np.uint16((positions[v, axis] - low) * scale + 0.5)
    for v in range(len(normals)):
        x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
        length = abs(x) + abs(y) + abs(z)
        by = one / length if length > 0 else np.float32(0)
        x, y = x * by, y * by
        if z < 0:  # the lower half is folded outwards over the edges
            x, y = ((one - abs(y)) * (one if x >= 0 else -one), (one - abs(x)) * (one if y >= 0 else -one))
        folded[v, 0] = np.int16(np.floor(x * np.float32(SQUARE_STEPS) + half))
        folded[v, 1] = np.int16(np.floor(y * np.float32(SQUARE_STEPS) + half))
