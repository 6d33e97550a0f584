"""Joint orders of other skeletons, and their conversion to the 20 joints of `capture.skeleton`.

An order has one entry per joint of the other skeleton: the joint's name in `capture.skeleton`, or None if none of the
20 joints corresponds to it.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

import capture
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST

Float = TypeVar("Float", np.float32, np.float64)
JointOrder = Sequence[str | None]

JOINT_SETS: dict[str, tuple[str, ...]] = {
    name: tuple(joints.split())
    for name, joints in tomllib.loads(
        (Path(capture.__file__).parent / "joint_sets.toml").read_text(encoding="utf-8")
    ).items()
}
"""Names of the joints of each set."""

_ENDS = {
    "mediapipe": (21, 42, 468, 478, 510, 520),
    "body_25": (42, 70, 112),
    "body_25b": (110,),
    "smpl_22": (23, 30, 33, 51, 105, 122),
}
"""How many landmarks of hands, face or feet may follow the joints of a set."""

HOLISTIC = {
    f"{name}_{len(JOINT_SETS[name]) + count}": (*JOINT_SETS[name], *(f"_{index}" for index in range(count)))
    for name, counts in _ENDS.items()
    for count in counts
}
"""Poses before the landmarks of hands and face, which no recording has in rows of their own."""
JOINT_SETS |= {**HOLISTIC, "quest_70": JOINT_SETS["quest_84"][:70]}  # Meta Quest's body without legs

_NAMES = {"spine_base": "hip_center", "pelvis": "hip_center", "spine_mid": "spine", "spine_navel": "spine"}
_NAMES |= {"torso": "spine", "spine_shoulder": "shoulder_center"}


def order_of(name: str) -> JointOrder:
    """Return the order of a sensor's set of joints; a neck without a joint below is where Kinect v1 has that joint."""
    joints = JOINT_SETS[name]
    names = _NAMES if "spine_shoulder" in joints else {**_NAMES, "neck": "shoulder_center"}
    return tuple(names.get(joint, joint if joint in JOINT_INDEX else None) for joint in joints)


K25, K32, MSR_ACTION3D = order_of("kinect_v2"), order_of("azure_kinect"), order_of("msr_action3d")
"""Kinect v2 (K25[:21] is the order of files without tips and thumbs), Azure Kinect and MSR Action3D."""

NITE15 = order_of("nite")
"""OpenNI 2 with NiTE 2. Requires `synthesise_missing`."""

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
