"""The 20 Kinect joints, a frame of one performer, and the coordinate systems.

Sensor coordinates, used in all of `capture`, are right-handed and in metres: the origin is at the sensor, y points up,
z away from the sensor. The right side of a performer who faces the sensor is at +x. *Left* and *right* in a joint's
name are the performer's.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

LIMBS: dict[str, tuple[str, ...]] = {
    "trunk": ("hip_center", "spine", "shoulder_center", "head"),
    "left arm": ("shoulder_left", "elbow_left", "wrist_left", "hand_left"),
    "right arm": ("shoulder_right", "elbow_right", "wrist_right", "hand_right"),
    "left leg": ("hip_left", "knee_left", "ankle_left", "foot_left"),
    "right leg": ("hip_right", "knee_right", "ankle_right", "foot_right"),
}
"""Joints of each limb, from its root to its tip."""

JOINTS: tuple[str, ...] = tuple(joint for limb in LIMBS.values() for joint in limb)
"""Joint names in the order of the Kinect SDK v1, which is the order of every (20, …) array."""

JOINT_INDEX: dict[str, int] = {name: index for index, name in enumerate(JOINTS)}

_LIMB_PARENTS = {"arm": "shoulder_center", "leg": "hip_center"}
PARENTS: dict[str, str] = {
    joint: parent
    for limb, joints in LIMBS.items()
    for parent, joint in pairwise(joints if limb == "trunk" else (_LIMB_PARENTS[limb.split()[1]], *joints))
}
"""Neighbour of each joint towards the hips; the 19 pairs are the skeleton's bones."""

TRACKED = 1.0
"""Confidence of a joint that the sensor sees."""
INFERRED = 0.5
"""Confidence of a joint whose position the sensor infers."""
LOST = 0.0
"""Confidence of a lost joint. Its position is NaN in a recording, and the last known position after resampling."""

MAX_DISTANCE_METRES = 1000.0
"""Maximum distance of a joint from the origin along each axis; larger coordinates are errors of the sender."""


def swap_sides(name: str) -> str:
    """Return the name of a joint's or channel's counterpart on the other side of the body."""
    if name.endswith("_left"):
        return name.removesuffix("left") + "right"
    return name.removesuffix("right") + "left" if name.endswith("_right") else name


OPPOSITE: NDArray[np.intp] = np.array([JOINT_INDEX[swap_sides(name)] for name in JOINTS])
"""Index (20,) of each joint's counterpart on the other side of the body."""


@dataclass(frozen=True, slots=True)
class SkeletonFrame:
    """One performer at one time.

    Attributes
    ----------
    time : float
        Seconds.
    user : int
        User number.
    positions : (20, 3) float64
        Metres, sensor coordinates, in the order of `JOINTS`.
    confidence : (20,) float32
        `TRACKED`, `INFERRED`, `LOST`, or a value between them.
    orientations : (20, 4) float64, optional
        Orientations of the bones (`capture.orientations`), if the recording or sensor has them.
    channels : mapping of str to float, optional
        Values of channels (`capture.channels`) from 0 to 1; others are unknown.
    """

    time: float
    user: int
    positions: NDArray[np.float64]
    confidence: NDArray[np.float32]
    orientations: NDArray[np.float64] | None = None
    channels: Mapping[str, float] | None = None


def mirrored(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mirrored skeleton: x negated, left and right swapped.

    Parameters
    ----------
    positions : (..., 20, 3) float64
        Metres, sensor coordinates.

    Returns
    -------
    (..., 20, 3) float64
    """
    return positions[..., OPPOSITE, :] * np.array([-1.0, 1.0, 1.0])


def to_character_axes(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert sensor coordinates to those of a glTF character that faces +z: (−x, y, −z).

    Parameters
    ----------
    positions : (..., 3) float64
        Sensor coordinates.

    Returns
    -------
    (..., 3) float64
        Right-handed, y up; the performer's right side is at −x, like that of a character that faces +z.
    """
    return positions * np.array([-1.0, 1.0, -1.0])
