"""Joint orders of other skeletons, and their conversion to the 20 joints of `capture.skeleton`.

An order has one entry per joint of the other skeleton: the joint's name in `capture.skeleton`, or None if none of the
20 joints corresponds to it.
"""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST

Float = TypeVar("Float", np.float32, np.float64)
JointOrder = Sequence[str | None]

_ARM_LEG = ("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot")
_LEFT_ARM, _LEFT_LEG = (tuple(f"{part}_left" for part in limb) for limb in _ARM_LEG)
_RIGHT_ARM, _RIGHT_LEG = (tuple(f"{part}_right" for part in limb) for limb in _ARM_LEG)

K25: JointOrder = (
    *("hip_center", "spine", None, "head"),
    *_LEFT_ARM,
    *_RIGHT_ARM,
    *_LEFT_LEG,
    *_RIGHT_LEG,
    *("shoulder_center", None, None, None, None),
)
"""Kinect v2. Its neck, hand tips and thumbs are skipped; K25[:21] is the order of files without tips and thumbs."""

K32: JointOrder = (
    *("hip_center", "spine", None, "shoulder_center"),
    *(None, *_LEFT_ARM, None, None),
    *(None, *_RIGHT_ARM, None, None),
    *_LEFT_LEG,
    *_RIGHT_LEG,
    *("head", None, None, None, None, None),
)
"""Azure Kinect. Its neck is where Kinect v1 has the shoulder centre; chest, clavicles, tips and face are skipped."""

NITE15: JointOrder = (
    *("head", "shoulder_center"),
    *("shoulder_left", "shoulder_right", "elbow_left", "elbow_right", "hand_left", "hand_right"),
    "spine",
    *("hip_left", "hip_right", "knee_left", "knee_right", "foot_left", "foot_right"),
)
"""OpenNI 2 with NiTE 2; its torso becomes the spine. Requires `synthesise_missing`."""

MSR_ACTION3D: JointOrder = (
    *("shoulder_left", "shoulder_right", "shoulder_center", "spine", "hip_left", "hip_right", "hip_center"),
    *("elbow_left", "elbow_right", "wrist_left", "wrist_right", "hand_left", "hand_right"),
    *("knee_left", "knee_right", "ankle_left", "ankle_right", "foot_left", "foot_right"),
    "head",
)

_MISSING: dict[str, dict[str, float]] = {
    "hip_center": {"hip_left": 0.5, "hip_right": 0.5},
    # In the 20-joint recordings of UTKinect-Action3D, the spine is at 0.17 of the way from hip centre to shoulder
    # centre, the wrist at 0.75 from elbow to hand and the ankle at 0.85 from knee to foot (medians).
    "spine": {"hip_center": 0.83, "shoulder_center": 0.17},
    "wrist_left": {"elbow_left": 0.25, "hand_left": 0.75},
    "wrist_right": {"elbow_right": 0.25, "hand_right": 0.75},
    "ankle_left": {"knee_left": 0.15, "foot_left": 0.85},
    "ankle_right": {"knee_right": 0.15, "foot_right": 0.85},
}
"""Joints that a 15-joint skeleton lacks, each with the weights of the joints that replace it."""


def to_kinect20(
    order: JointOrder, positions: NDArray[np.float64], confidence: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Convert joints to the order of `capture.skeleton.JOINTS`.

    Parameters
    ----------
    order : sequence of (str or None)
        The J joints of the other skeleton.
    positions : (..., J, 3) float64
        Metres, sensor coordinates; any value if the confidence is 0.
    confidence : (..., J) float32

    Returns
    -------
    positions : (..., 20, 3) float64
        NaN for joints that are lost or missing in `order`.
    confidence : (..., 20) float32
        0 for the same joints.
    """
    reordered = _reordered(order, confidence[..., None], LOST)[..., 0]
    return np.where(reordered[..., None] == LOST, np.nan, _reordered(order, positions, np.nan)), reordered


def orientations_to_kinect20(order: JointOrder, orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert orientations (..., J, 4) to the order of `capture.skeleton.JOINTS`, with NaN for missing joints."""
    return _reordered(order, orientations, np.nan)


def _reordered(order: JointOrder, values: NDArray[Float], missing: float) -> NDArray[Float]:
    source = [index for index, name in enumerate(order) if name is not None]
    target = [JOINT_INDEX[name] for name in order if name is not None]
    reordered = np.full((*values.shape[:-2], len(JOINTS), values.shape[-1]), missing, dtype=values.dtype)
    reordered[..., target, :] = values[..., source, :]
    return reordered


def synthesise_missing(
    positions: NDArray[np.float64], confidence: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Add the joints that 15-joint skeletons lack: hip centre, spine, wrists and ankles.

    A lost joint becomes a fixed weighted mean of its neighbours if none of them is lost. Its confidence is the lowest
    of its neighbours, and at most inferred.

    Parameters
    ----------
    positions : (..., 20, 3) float64
        NaN for lost joints.
    confidence : (..., 20) float32

    Returns
    -------
    positions : (..., 20, 3) float64
    confidence : (..., 20) float32
    """
    positions, confidence = positions.copy(), confidence.copy()
    for name, weights in _MISSING.items():
        joint = JOINT_INDEX[name]
        sources = [JOINT_INDEX[source] for source in weights]
        certainty = np.minimum(confidence[..., sources].min(axis=-1), INFERRED)
        fill = (confidence[..., joint] == LOST) & (certainty > LOST)
        mean = np.einsum("...jc,j->...c", positions[..., sources, :], np.array(list(weights.values())))
        positions[fill, joint] = mean[fill]
        confidence[fill, joint] = certainty[fill]
    return positions, confidence
