"""A standing human whose bones are Unity's, posed by forward kinematics.

Coordinates are Unity's: left-handed, metres, y up; the body faces +z in a T-pose and its right side is at +x. Turning a
vector by a quaternion is the same formula in either handedness, so nothing here needs to know it.
"""

import math
from collections.abc import Mapping

from capture.body import typical

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""x, y, z, w; of length 1."""

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)

_HIP_OUT, _SHOULDER_OUT, _COLLAR_OUT = 0.080, 0.185, 0.020
_HIP_DOWN = math.sqrt(typical("hip_left") ** 2 - _HIP_OUT**2)
_SHOULDER_DOWN = math.sqrt(typical("shoulder_left") ** 2 - _SHOULDER_OUT**2)
_VERTEBRA = typical("shoulder_center") / 3
_TOES_AHEAD = 0.072
_TOES_DOWN = math.sqrt(typical("foot_left") ** 2 - _TOES_AHEAD**2)


def _side(name: str, out: float) -> dict[str, tuple[str, Vector]]:
    return {
        f"{name}UpperLeg": ("Hips", (out * _HIP_OUT, -_HIP_DOWN, 0.0)),
        f"{name}LowerLeg": (f"{name}UpperLeg", (0.0, -typical("knee_left"), 0.0)),
        f"{name}Foot": (f"{name}LowerLeg", (0.0, -typical("ankle_left"), 0.0)),
        f"{name}Shoulder": ("UpperChest", (out * _COLLAR_OUT, _VERTEBRA - _SHOULDER_DOWN, 0.0)),
        f"{name}UpperArm": (f"{name}Shoulder", (out * (_SHOULDER_OUT - _COLLAR_OUT), 0.0, 0.0)),
        f"{name}LowerArm": (f"{name}UpperArm", (out * typical("elbow_left"), 0.0, 0.0)),
        f"{name}Hand": (f"{name}LowerArm", (out * typical("wrist_left"), 0.0, 0.0)),
    }


SKELETON: dict[str, tuple[str, Vector]] = {
    "Spine": ("Hips", (0.0, typical("spine"), 0.0)),
    "Chest": ("Spine", (0.0, _VERTEBRA, 0.0)),
    "UpperChest": ("Chest", (0.0, _VERTEBRA, 0.0)),
    "Neck": ("UpperChest", (0.0, _VERTEBRA, 0.0)),
    "Head": ("Neck", (0.0, typical("head") / 2, 0.0)),
    **_side("Left", -1.0),
    **_side("Right", 1.0),
}
"""Each bone's parent and where it begins in the parent's frame, parents first. Lengths are those of `capture.body`."""

_NOWHERE: Vector = (0.0, 0.0, 0.0)


def _joints(side: str, name: str, out: float) -> dict[str, tuple[str, Vector]]:
    return {
        f"shoulder_{side}": (f"{name}UpperArm", _NOWHERE),
        f"elbow_{side}": (f"{name}LowerArm", _NOWHERE),
        f"wrist_{side}": (f"{name}Hand", _NOWHERE),
        f"hand_{side}": (f"{name}Hand", (out * typical("hand_left"), 0.0, 0.0)),
        f"hip_{side}": (f"{name}UpperLeg", _NOWHERE),
        f"knee_{side}": (f"{name}LowerLeg", _NOWHERE),
        f"ankle_{side}": (f"{name}Foot", _NOWHERE),
        f"foot_{side}": (f"{name}Foot", (0.0, -_TOES_DOWN, _TOES_AHEAD)),
    }


JOINTS: dict[str, tuple[str, Vector]] = {
    "hip_center": ("Hips", _NOWHERE),
    "spine": ("Spine", _NOWHERE),
    "shoulder_center": ("Neck", _NOWHERE),
    "head": ("Head", (0.0, typical("head") / 2, 0.0)),
    **_joints("left", "Left", -1.0),
    **_joints("right", "Right", 1.0),
}
"""Where each of our joints is: a bone, and a place in its frame."""


def _moved_by(joint: str) -> str:
    """Return the bone whose rotation puts a joint where it is, of those that every humanoid of Unity's has."""
    bone, place = JOINTS[joint]
    if place == _NOWHERE and bone != "Hips":
        bone = SKELETON[bone][0]
    while bone in ("Chest", "UpperChest", "Neck", "LeftShoulder", "RightShoulder"):
        bone = SKELETON[bone][0]
    return bone


MOVED_BY: dict[str, str] = {joint: _moved_by(joint) for joint in JOINTS}
"""The bone without which nothing is known about a joint."""


def places(hips: tuple[Vector, Quaternion], rotations: Mapping[str, Quaternion]) -> list[Vector]:
    """Return where the joints of `JOINTS` are.

    Parameters
    ----------
    hips : (vector, quaternion)
        In the world.
    rotations : mapping of str to quaternion
        Of each bone of `SKELETON`, in its parent's frame; a bone that is not there is as in the T-pose.

    Returns
    -------
    list of vector
        Metres, in the order of `JOINTS`.
    """
    frames = {"Hips": hips}
    for bone, (parent, begin) in SKELETON.items():
        start, turn = frames[parent]
        frames[bone] = (moved(start, turn, begin), product(turn, rotations.get(bone, IDENTITY)))
    return [moved(*frames[bone], place) for bone, place in JOINTS.values()]


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """Return the rotation that turns by the second and then by the first: Hamilton's product."""
    a, b, c, d = first
    x, y, z, w = second
    return (
        d * x + a * w + b * z - c * y,
        d * y + b * w + c * x - a * z,
        d * z + c * w + a * y - b * x,
        d * w - a * x - b * y - c * z,
    )


def moved(start: Vector, turn: Quaternion, place: Vector) -> Vector:
    """Return a place in a frame, in the world: start + turn(place)."""
    a, b, c, d = turn
    x, y, z = place
    u, v, w = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    return (
        start[0] + x + d * u + b * w - c * v,
        start[1] + y + d * v + c * u - a * w,
        start[2] + z + d * w + a * v - b * u,
    )
