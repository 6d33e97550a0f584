"""Joint orders of foreign skeletons, and how they become the project's 20 joints.

An order has one entry for each joint of the foreign skeleton: its name in `capture.skeleton`, or None where the 20
joints have no such joint.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST

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
"""Kinect v2. Its neck, hand tips and thumbs are not kept; K25[:21] is the order of logs without tips and thumbs."""

K32: JointOrder = (
    *("hip_center", "spine", None, "shoulder_center"),
    *(None, *_LEFT_ARM, None, None),
    *(None, *_RIGHT_ARM, None, None),
    *_LEFT_LEG,
    *_RIGHT_LEG,
    *("head", None, None, None, None, None),
)
"""Azure Kinect. Its neck is where Kinect v1 has the shoulder centre; chest, clavicles, tips and face are not kept."""

NITE15: JointOrder = (
    *("head", "shoulder_center"),
    *("shoulder_left", "shoulder_right", "elbow_left", "elbow_right", "hand_left", "hand_right"),
    "spine",
    *("hip_left", "hip_right", "knee_left", "knee_right", "foot_left", "foot_right"),
)
"""OpenNI 2 with NiTE 2; its torso becomes the spine. Needs `synthesise_missing`."""

CAD60: JointOrder = (
    *("head", "shoulder_center", "spine"),
    *("shoulder_left", "elbow_left", "shoulder_right", "elbow_right"),
    *("hip_left", "knee_left", "hip_right", "knee_right"),
    *("hand_left", "hand_right", "foot_left", "foot_right"),
)
"""CAD-60: the joints of NiTE in an order of its own. Needs `synthesise_missing`."""

MSR_ACTION3D: JointOrder = (
    *("shoulder_left", "shoulder_right", "shoulder_center", "spine", "hip_left", "hip_right", "hip_center"),
    *("elbow_left", "elbow_right", "wrist_left", "wrist_right", "hand_left", "hand_right"),
    *("knee_left", "knee_right", "ankle_left", "ankle_right", "foot_left", "foot_right"),
    "head",
)

UTD_MHAD: JointOrder = (
    *("head", "shoulder_center", "spine", "hip_center"),
    *_LEFT_ARM,
    *_RIGHT_ARM,
    *_LEFT_LEG,
    *_RIGHT_LEG,
)

_MISSING: dict[str, dict[str, float]] = {
    "hip_center": {"hip_left": 0.5, "hip_right": 0.5},
    # On the 20-joint recordings of UTKinect-Action3D the spine lies at 0.17 of the way from hip centre to shoulder
    # centre, the wrist at 0.75 from elbow to hand and the ankle at 0.85 from knee to foot (medians).
    "spine": {"hip_center": 0.83, "shoulder_center": 0.17},
    "wrist_left": {"elbow_left": 0.25, "hand_left": 0.75},
    "wrist_right": {"elbow_right": 0.25, "hand_right": 0.75},
    "ankle_left": {"knee_left": 0.15, "foot_left": 0.85},
    "ankle_right": {"knee_right": 0.15, "foot_right": 0.85},
}
"""What a 15-joint skeleton lacks, as a weighted mean of joints that it has or that stand higher in this table."""


def to_kinect20(
    order: JointOrder, positions: NDArray[np.float64], confidence: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Put foreign joints into the order of `capture.skeleton.JOINTS`, matched by name.

    Parameters
    ----------
    order : sequence of (str or None)
        The name of each foreign joint; J entries.
    positions : (..., J, 3) float64
        Metres, sensor frame; anything where the confidence is 0.
    confidence : (..., J) float32

    Returns
    -------
    positions : (..., 20, 3) float64
        NaN where a joint is lost or has no counterpart in `order`.
    confidence : (..., 20) float32
        0 in the same places.
    """
    source = [index for index, name in enumerate(order) if name is not None]
    target = [JOINT_INDEX[name] for name in order if name is not None]
    ours = np.full((*positions.shape[:-2], len(JOINTS), 3), np.nan)
    sure = np.full((*positions.shape[:-2], len(JOINTS)), LOST, dtype=np.float32)
    ours[..., target, :] = positions[..., source, :]
    sure[..., target] = confidence[..., source]
    ours[sure == LOST] = np.nan
    return ours, sure


def orientations_to_kinect20(order: JointOrder, orientations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Put orientations (..., J, 4) of foreign joints into the order of `capture.skeleton.JOINTS`, NaN for others."""
    source = [index for index, name in enumerate(order) if name is not None]
    target = [JOINT_INDEX[name] for name in order if name is not None]
    ours = np.full((*orientations.shape[:-2], len(JOINTS), 4), np.nan)
    ours[..., target, :] = orientations[..., source, :]
    return ours


def synthesise_missing(
    positions: NDArray[np.float64], confidence: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Fill the joints that 15-joint skeletons lack: hip centre, spine, wrists and ankles.

    A lost joint becomes a fixed weighted mean of its neighbours where all of them are known, and stays lost elsewhere.
    Its confidence is that of the least certain neighbour, but never more than inferred.

    Parameters
    ----------
    positions : (..., 20, 3) float64
        In the order of `capture.skeleton.JOINTS`, NaN where lost.
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
