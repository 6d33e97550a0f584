"""Skin weights of joints from those of bones.

Several joints can move with one bone: the further joints of a humanoid along its trunk, collar bones, toes. Any
division of the bone's weight among them gives the same motion. It is divided by how near they are, so that each is
useful to an animator.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from engine_bridge.rigging.joints import Joint
from solver.skinning.weights import Weights, packed

NEARNESS_POWER = 4
"""Exponent of the distances from joints; a higher one makes sharper borders."""

MIN_DISTANCE = 1e-6
"""Minimum distance from a joint, in sizes of the character, which keeps nearness finite."""

VERTICES_PER_CHUNK = 65_536
"""Number of vertices that are computed at once, to save memory."""


def joint_weights(weights: Weights, joints: Sequence[Joint], vertices: NDArray[np.float64]) -> Weights:
    """Divide the weights of bones among their joints.

    Parameters
    ----------
    weights : Weights
        Of the bones that joints move with, see `Joint.bone`.
    joints : sequence of Joint
        With at least one joint for each bone that has weights.
    vertices : (n, 3) float64
        Rest positions of the vertices.

    Returns
    -------
    Weights
        Of the joints, with as many influences. The weights of a bone's joints have the same sum as its own, because a
        vertex keeps one joint of each of its bones.
    """
    of_bone: dict[int, list[int]] = {}
    for row, joint in enumerate(joints):
        of_bone.setdefault(joint.bone, []).append(row)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    parts, shares = [], weights.weights.astype(np.float64)
    for start in range(0, len(vertices), VERTICES_PER_CHUNK):
        rows = slice(start, start + VERTICES_PER_CHUNK)
        parts.append(_divided(shares[rows], weights.bones[rows], joints, of_bone, vertices[rows] / size, size))
    return packed(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _divided(
    weights: NDArray[np.float64],
    bones: NDArray[np.uint16],
    joints: Sequence[Joint],
    of_bone: Mapping[int, list[int]],
    points: NDArray[np.float64],
    size: float,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the weights of joints (n, k), and the joints (n, k), for weights of bones (n, k)."""
    shares = np.zeros((len(points), len(joints)))
    first = np.zeros(shares.shape, dtype=bool)  # a joint of each bone that stays
    for bone in np.unique(bones[weights > 0]).tolist():
        own = np.array(of_bone[bone])
        whole = (weights * (bones == bone)).sum(axis=1)
        chosen = np.flatnonzero(whole)
        near = _nearness([joints[row] for row in own], points[chosen], size)
        shares[np.ix_(chosen, own)] = whole[chosen, None] * near
        first[chosen, own[near.argmax(axis=1)]] = True
    kept = np.argsort(-(shares + first), axis=1, kind="stable")[:, : weights.shape[1]]
    left = np.zeros_like(shares)
    np.put_along_axis(left, kept, np.take_along_axis(shares, kept, axis=1), axis=1)
    for own in (np.array(rows) for rows in of_bone.values() if len(rows) > 1):
        before, after = shares[:, own].sum(axis=1), left[:, own].sum(axis=1)
        left[:, own] *= np.divide(before, after, out=np.zeros_like(before), where=after > 0)[:, None]
    found = np.take_along_axis(left, kept, axis=1)
    missing = weights.shape[1] - kept.shape[1]
    return np.pad(found, ((0, 0), (0, missing))), np.pad(kept, ((0, 0), (0, missing)))


def _nearness(joints: Sequence[Joint], points: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return how near points (k, 3) are to the segments of joints, (k, joints), with the sum 1; in units of `size`."""
    heads = np.array([joint.head for joint in joints]) / size
    along = np.array([joint.tail for joint in joints]) / size - heads
    length = np.maximum(np.einsum("jx,jx->j", along, along), 1e-300)
    offset = points[:, None] - heads
    place = np.clip(np.einsum("kjx,jx->kj", offset, along) / length, 0, 1)
    distance = np.linalg.norm(offset - place[..., None] * along, axis=2)
    near = np.maximum(distance, MIN_DISTANCE) ** -NEARNESS_POWER
    return np.asarray(near / near.sum(axis=1, keepdims=True))
