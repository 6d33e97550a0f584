"""How the bones of a performer are turned, beside where its joints are: the convention, and how logs become it.

Orientations are unit quaternions (w, x, y, z), an array (…, 20, 4) in the order of `capture.skeleton.JOINTS`. That of a
joint turns axes that are fixed in the bone *beginning* at the joint (the elbow's in the forearm) to the sensor frame,
NaN where it is not known. How these axes lie in the bone is each log's own: only how they turn counts.

BVH and the Azure Kinect have the orientation at the joint where a bone begins, the Kinect v2 where it ends.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, JOINTS, OPPOSITE, PARENTS

NORM_TOLERANCE = 0.01
"""How far the length of a quaternion may be from 1; sensors write zeros for an unknown one."""

_CHILDREN = {
    parent: child
    for child, parent in PARENTS.items()
    if parent not in ("hip_center", "shoulder_center") or child in ("spine", "head")
}


def checked(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions (…, 4) as they are; NaN for what is none of unit length."""
    with np.errstate(invalid="ignore", over="ignore"):
        norm = np.linalg.norm(orientations, axis=-1, keepdims=True)
        return np.where(np.abs(norm - 1) < NORM_TOLERANCE, orientations, np.nan)


def of_bones_that_begin(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take orientations (…, 20, 4) of the bones that end at the joints to those that begin there."""
    out = np.full_like(orientations, np.nan)
    for joint, child in _CHILDREN.items():
        out[..., JOINT_INDEX[joint], :] = orientations[..., JOINT_INDEX[child], :]
    return out


def turned(orientations: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return orientations (…, 4) in a frame that a (3, 3) rotation takes the old one to."""
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
    """Return the orientations (…, 20, 4) of the skeleton seen in a mirror, as `capture.skeleton.mirrored` does.

    The mirror image of a rotation about an axis is the opposite one about the axis' image: (w, x, −y, −z).
    """
    return orientations[..., OPPOSITE, :] * np.array([1.0, 1.0, -1.0, -1.0])


def to_character_axes(orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return orientations (…, 4) in character axes: half a turn about y, as in `capture.skeleton`."""
    w, x, y, z = np.moveaxis(orientations, -1, 0)
    return np.stack([-y, z, w, -x], axis=-1)


def between(before: NDArray[np.float64], after: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return orientations (t, 4) a part (t, 1) of the way between others, the shorter way round.

    Where a part is 0 it is the first, to the bit.
    """
    nearer = np.where(np.einsum("tq,tq->t", before, after)[:, None] < 0, -after, after)
    blend = before + part * (nearer - before)
    with np.errstate(invalid="ignore"):
        return np.where(part == 0, before, blend / np.linalg.norm(blend, axis=-1, keepdims=True))


def none(shape: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Return unknown orientations (…, 20, 4)."""
    return np.full((*shape, len(JOINTS), 4), np.nan)
