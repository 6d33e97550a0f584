"""A typical human body with Unity's bones, posed by forward kinematics.

Coordinates are Unity's: left-handed, metres, y up. The body stands in a T-pose, faces +z and has its right side at +x.
The formula for the rotation of a vector by a quaternion is the same for both handednesses.
"""

import math
from collections.abc import Mapping

from capture.body import typical_bone_length

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""A unit quaternion x, y, z, w."""

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)

_HIP_OFFSET, _SHOULDER_OFFSET, _COLLAR_OFFSET = 0.080, 0.185, 0.020
_HIP_DOWN = math.sqrt(typical_bone_length("hip_left") ** 2 - _HIP_OFFSET**2)
_SHOULDER_DOWN = math.sqrt(typical_bone_length("shoulder_left") ** 2 - _SHOULDER_OFFSET**2)
_VERTEBRA_LENGTH = typical_bone_length("shoulder_center") / 3
_TOES_FORWARD = 0.072
_TOES_DOWN = math.sqrt(typical_bone_length("foot_left") ** 2 - _TOES_FORWARD**2)


def _side(name: str, sign: float) -> dict[str, tuple[str, Vector]]:
    return {
        f"{name}UpperLeg": ("Hips", (sign * _HIP_OFFSET, -_HIP_DOWN, 0.0)),
        f"{name}LowerLeg": (f"{name}UpperLeg", (0.0, -typical_bone_length("knee_left"), 0.0)),
        f"{name}Foot": (f"{name}LowerLeg", (0.0, -typical_bone_length("ankle_left"), 0.0)),
        f"{name}Shoulder": ("UpperChest", (sign * _COLLAR_OFFSET, _VERTEBRA_LENGTH - _SHOULDER_DOWN, 0.0)),
        f"{name}UpperArm": (f"{name}Shoulder", (sign * (_SHOULDER_OFFSET - _COLLAR_OFFSET), 0.0, 0.0)),
        f"{name}LowerArm": (f"{name}UpperArm", (sign * typical_bone_length("elbow_left"), 0.0, 0.0)),
        f"{name}Hand": (f"{name}LowerArm", (sign * typical_bone_length("wrist_left"), 0.0, 0.0)),
    }


SKELETON: dict[str, tuple[str, Vector]] = {
    "Spine": ("Hips", (0.0, typical_bone_length("spine"), 0.0)),
    "Chest": ("Spine", (0.0, _VERTEBRA_LENGTH, 0.0)),
    "UpperChest": ("Chest", (0.0, _VERTEBRA_LENGTH, 0.0)),
    "Neck": ("UpperChest", (0.0, _VERTEBRA_LENGTH, 0.0)),
    "Head": ("Neck", (0.0, typical_bone_length("head") / 2, 0.0)),
    **_side("Left", -1.0),
    **_side("Right", 1.0),
}
"""Parent of each bone, and its offset in the parent's axes; parents first. Lengths are those of `capture.body`."""

_ORIGIN: Vector = (0.0, 0.0, 0.0)


def _joints(side: str, name: str, sign: float) -> dict[str, tuple[str, Vector]]:
    return {
        f"shoulder_{side}": (f"{name}UpperArm", _ORIGIN),
        f"elbow_{side}": (f"{name}LowerArm", _ORIGIN),
        f"wrist_{side}": (f"{name}Hand", _ORIGIN),
        f"hand_{side}": (f"{name}Hand", (sign * typical_bone_length("hand_left"), 0.0, 0.0)),
        f"hip_{side}": (f"{name}UpperLeg", _ORIGIN),
        f"knee_{side}": (f"{name}LowerLeg", _ORIGIN),
        f"ankle_{side}": (f"{name}Foot", _ORIGIN),
        f"foot_{side}": (f"{name}Foot", (0.0, -_TOES_DOWN, _TOES_FORWARD)),
    }


JOINTS: dict[str, tuple[str, Vector]] = {
    "hip_center": ("Hips", _ORIGIN),
    "spine": ("Spine", _ORIGIN),
    "shoulder_center": ("Neck", _ORIGIN),
    "head": ("Head", (0.0, typical_bone_length("head") / 2, 0.0)),
    **_joints("left", "Left", -1.0),
    **_joints("right", "Right", 1.0),
}
"""Bone of each joint of `capture.skeleton`, and the joint's position in the bone's axes."""


def _driving_bone(joint: str) -> str:
    """Return the bone, of those that every Unity humanoid has, whose rotation determines a joint's position."""
    bone, offset = JOINTS[joint]
    if offset == _ORIGIN and bone != "Hips":
        bone = SKELETON[bone][0]
    while bone in ("Chest", "UpperChest", "Neck", "LeftShoulder", "RightShoulder"):
        bone = SKELETON[bone][0]
    return bone


DRIVING_BONES: dict[str, str] = {joint: _driving_bone(joint) for joint in JOINTS}
"""Bone that must have been received for each joint; without it, the joint is lost."""


def joint_positions(hips: tuple[Vector, Quaternion], rotations: Mapping[str, Quaternion]) -> list[Vector]:
    """Return the positions of the joints of `JOINTS`.

    Parameters
    ----------
    hips : (vector, quaternion)
        Position and rotation of the hips in world coordinates.
    rotations : mapping of str to quaternion
        Rotations of bones of `SKELETON` in their parents' axes; missing bones are in the T-pose.

    Returns
    -------
    list of vector
        Metres, in the order of `JOINTS`.
    """
    bones = {"Hips": hips}
    for bone, (parent, offset) in SKELETON.items():
        position, rotation = bones[parent]
        own_rotation = rotations.get(bone, IDENTITY)
        bones[bone] = (transformed(position, rotation, offset), quaternion_product(rotation, own_rotation))
    return [transformed(*bones[bone], offset) for bone, offset in JOINTS.values()]


def quaternion_product(first: Quaternion, second: Quaternion) -> Quaternion:
    """Return the Hamilton product, the rotation by `second` followed by the rotation by `first`."""
    a, b, c, d = first
    x, y, z, w = second
    return (
        d * x + a * w + b * z - c * y,
        d * y + b * w + c * x - a * z,
        d * z + c * w + a * y - b * x,
        d * w - a * x - b * y - c * z,
    )


def transformed(position: Vector, rotation: Quaternion, vector: Vector) -> Vector:
    """Return position + rotation(vector)."""
    a, b, c, d = rotation
    x, y, z = vector
    u, v, w = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    return (
        position[0] + x + d * u + b * w - c * v,
        position[1] + y + d * v + c * u - a * w,
        position[2] + z + d * w + a * v - b * u,
    )
