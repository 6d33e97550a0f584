"""Orientations of a performer's bones: their convention, and conversions to it.

Orientations are unit quaternions (w, x, y, z), an array (…, 20, 4) in the order of `capture.skeleton.JOINTS`. The
orientation of a joint rotates axes that are fixed in the bone that *begins* at the joint (the forearm for the elbow) to
sensor coordinates. It is NaN where it is unknown. Each recording has its own axes in the bones; only changes of
orientation have a meaning.

BVH and the Azure Kinect store the orientation of a bone at the joint where it begins, the Kinect v2 where it ends.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, JOINTS, OPPOSITE, PARENTS

NORM_TOLERANCE = 0.01
"""Maximum deviation of a quaternion's length from 1. Sensors write zeros for an unknown orientation."""

_CHILDREN = {
    parent: child
    for child, parent in PARENTS.items()
    if parent not in ("hip_center", "shoulder_center") or child in ("spine", "head")
}


def unknown(shape: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Return unknown orientations (…, 20, 4): NaN."""
    return np.full((*shape, len(JOINTS), 4), np.nan)


def unit_or_unknown(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a copy of quaternions (…, 4) with NaN for those whose length is not 1."""
    with np.errstate(invalid="ignore", over="ignore"):
        norm = np.linalg.norm(orientations, axis=-1, keepdims=True)
        return np.where(np.abs(norm - 1) < NORM_TOLERANCE, orientations, np.nan)


def move_to_bone_starts(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert orientations (…, 20, 4) of the bones that end at the joints to those of the bones that begin there."""
    out = np.full_like(orientations, np.nan)
    for joint, child in _CHILDREN.items():
        out[..., JOINT_INDEX[joint], :] = orientations[..., JOINT_INDEX[child], :]
    return out


def rotated(orientations: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return orientations (…, 4) in the coordinates that a (3, 3) rotation maps the present ones to."""
    x, y, z, w = scipy.spatial.transform.Rotation.from_matrix(rotation).as_quat()
    a, b = np.array([w, x, y, z]), np.moveaxis(orientations, -1, 0)
    return np.stack(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ],
        axis=-1,
    )


def mirrored(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the orientations (…, 20, 4) of the mirrored skeleton (see `capture.skeleton.mirrored`).

    The mirror image of a rotation about an axis is the opposite rotation about the mirrored axis: (w, x, −y, −z).
    """
    return orientations[..., OPPOSITE, :] * np.array([1.0, 1.0, -1.0, -1.0])


def to_character_axes(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return orientations (…, 4) in character axes: half a turn about y, as in `capture.skeleton`."""
    w, x, y, z = np.moveaxis(orientations, -1, 0)
    return np.stack([-y, z, w, -x], axis=-1)


def interpolated(
    before: NDArray[np.float64], after: NDArray[np.float64], part: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return orientations (t, 4) at a part (t, 1) of the shorter way from `before` to `after`.

    Where the part is 0, the result is exactly `before`.
    """
    nearer = np.where(np.einsum("tq,tq->t", before, after)[:, None] < 0, -after, after)
    blend = before + part * (nearer - before)
    with np.errstate(invalid="ignore"):
        return np.where(part == 0, before, blend / np.linalg.norm(blend, axis=-1, keepdims=True))
