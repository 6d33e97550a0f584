"""The body of a simulated performer: bones of constant length, posed by the moves of a few parts.

The bones are those of `capture.body.TYPICAL_BONE_METRES`. A part's values are metres as (out, up, forward), with *out*
away from the middle of the body on either side, or degrees as (forward, right, turn): bending forwards, leaning to the
performer's right, turning to the right.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, PchipInterpolator
from scipy.spatial.transform import Rotation

from capture.body import typical_bone_length
from capture.skeleton import JOINTS

Array = NDArray[np.float64]
Move = tuple[float, float, tuple[float, ...]]
"""Start and end of a move in seconds, and its target. Between its moves a part is still."""

SIDES = {"left": -1.0, "right": 1.0}
"""Sign of *out* along the sensor's x axis."""

FLOOR = -1.0
"""Height of the floor relative to a sensor on a table, in metres."""
ANKLE_REST = (0.115, 0.09, 0.0)
"""Position (out, up, forward) of a standing ankle relative to the point on the floor between the feet."""
HIPS_REST = 1.0
"""Height of `hip_center` above the floor, with slightly bent knees, so that the weight can be shifted."""

SHOULDER = (0.82, -0.57, -0.03)
HIP = (0.74, -0.67, 0.0)
FOOT = (0.15, -0.68, 0.72)
"""Directions (out, up, forward) of the bones to the shoulders, the hips and the feet, as of a Kinect."""
NECK = (0.0, 0.99, 0.1)
"""Direction of the bone from between the shoulders to the head."""
ELBOW = (0.3, -0.8, -0.45)
"""Direction in which an elbow bends, relative to the chest."""
KNEE_HINGE = (1.0, 0.0, 0.15)
"""Axis of a knee that points slightly outwards, relative to the pelvis."""

REST: dict[str, tuple[float, ...]] = {
    "hips": (0.0, 0.0, 0.0),
    "pelvis": (0.0, 0.0, 0.0),
    "trunk": (0.0, 0.0, 0.0),
    "head": (0.0, 0.0, 0.0),
    "hand_left": (0.11, -0.575, 0.07),
    "hand_right": (0.11, -0.575, 0.07),
    "ankle_left": (0.0, 0.0, 0.0),
    "ankle_right": (0.0, 0.0, 0.0),
    "foot_left": (0.0, 0.0, 0.0),
    "foot_right": (0.0, 0.0, 0.0),
}
"""The parts of the body, and the neutral pose in which every performance begins and ends.

hips : metres (right, up, forward) from the position of the hips at rest.
pelvis, trunk, head : degrees (forward, right, turn), the trunk on the pelvis and the head on the trunk.
hand_… : metres (out, up, forward) from the shoulder, relative to the trunk.
ankle_… : metres (out, up, forward) from its position at rest.
foot_… : degrees (forward, right, turn); forward is toes down.
"""


def interpolated(moves: Sequence[Move], rest: tuple[float, ...], times: Array) -> Array:
    """Interpolate the moves of one part: C², still between moves, without a stop between adjacent moves.

    Quintic Hermite pieces from key to key, with the slopes of Fritsch and Butland's monotone interpolation (PCHIP) and
    no acceleration at the keys.

    Parameters
    ----------
    moves : sequence of Move
        In order of time. A move begins no earlier than the end of its predecessor.
    rest : tuple of 3 floats
        Value of the part until its first move: its entry in `REST`.
    times : (T,) float64
        Seconds, increasing, from 0 or later to the end of the last move or later.

    Returns
    -------
    (T, 3) float64
        In the units of `REST`.
    """
    keys = [(0.0, rest)]
    for start, end, target in moves:
        if start > keys[-1][0]:
            keys.append((start, keys[-1][1]))
        keys.append((end, target))
    keys.append((float(times[-1]) + 1.0, keys[-1][1]))
    at = np.array([time for time, _ in keys])
    values = np.array([value for _, value in keys])
    # the slopes of a monotone interpolation prevent overshooting
    slopes = PchipInterpolator(at, values)(at, 1)
    return BPoly.from_derivatives(at, np.stack([values, slopes, np.zeros_like(values)], axis=1))(times)


def _turned(degrees: Array) -> Rotation:
    """Return the rotations for (T, 3) degrees (forward, right, turn) of a performer who faces the sensor."""
    return Rotation.from_euler("YXZ", -degrees[:, [2, 0, 1]], degrees=True)


def _bone(direction: tuple[float, ...], joint: str) -> Array:
    """Return the bone to a joint, (out, up, forward)."""
    return np.array(direction) / np.linalg.norm(direction) * typical_bone_length(joint)


def _bent(root: Array, end: Array, upper: float, lower: float, toward: Array) -> Array:
    """Return the joint (T, 3) between two bones from root to end, which bends in the direction `toward`."""
    along = end - root
    distance = np.linalg.norm(along, axis=1, keepdims=True)
    if np.any(distance >= upper + lower):
        worst = int(np.argmax(distance))
        raise ValueError(f"out of reach by {float(distance[worst, 0]) - upper - lower:.3f} m in frame {worst}")
    along = along / distance
    aside = toward - np.sum(toward * along, axis=1, keepdims=True) * along
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    forward = (distance**2 + upper**2 - lower**2) / (2 * distance)
    return root + forward * along + np.sqrt(upper**2 - forward**2) * aside


def _within_reach(target: Array, length: float) -> Array:
    """Limit hand positions (T, 3) relative to the shoulder smoothly, so that the elbow stays bent."""
    distance = np.linalg.norm(target, axis=1, keepdims=True)
    return target / (1 + (distance / length) ** 20) ** (1 / 20)


def posed(parts: Mapping[str, Array], distance: float) -> Array:
    """Return the joints of a performer who faces the sensor.

    Hips, trunk and head are computed from root to tip. Hands and ankles have given positions. Elbows and knees are at
    the place where two bones of known length meet; forearm and hand count as one bone.

    Parameters
    ----------
    parts : mapping
        For each part of `REST` its values (T, 3) float64, in the units given there.
    distance : float
        Distance from the sensor to the feet at rest, in metres.

    Returns
    -------
    (T, 20, 3) float64
        Joints in sensor coordinates (see `capture.skeleton`), in metres. Hands stay within the reach of the arms.

    Raises
    ------
    ValueError
        An ankle is out of reach of its leg.
    """
    spot = np.array([0.0, FLOOR, distance])
    ahead = np.array([1.0, 1.0, -1.0])
    pelvis = _turned(parts["pelvis"])
    chest = pelvis * _turned(parts["trunk"])
    skull = chest * _turned(parts["head"])
    up = (0.0, 1.0, 0.0)

    joints = {"hip_center": spot + (parts["hips"] + np.array([0.0, HIPS_REST, 0.0])) * ahead}
    joints["spine"] = joints["hip_center"] + pelvis.apply(_bone(up, "spine"))
    joints["shoulder_center"] = joints["spine"] + chest.apply(_bone(up, "shoulder_center"))
    joints["head"] = joints["shoulder_center"] + skull.apply(_bone(NECK, "head") * ahead)
    for side, sign in SIDES.items():
        out = np.array([sign, 1.0, -1.0])

        shoulder = joints["shoulder_center"] + chest.apply(_bone(SHOULDER, "shoulder") * out)
        forearm = typical_bone_length("wrist") + typical_bone_length("hand")
        target = _within_reach(parts[f"hand_{side}"], typical_bone_length("elbow") + forearm)
        hand = shoulder + chest.apply(target * out)
        elbow = _bent(shoulder, hand, typical_bone_length("elbow"), forearm, chest.apply(np.array(ELBOW) * out))
        joints |= {f"shoulder_{side}": shoulder, f"elbow_{side}": elbow, f"hand_{side}": hand}
        joints[f"wrist_{side}"] = elbow + (hand - elbow) * (typical_bone_length("wrist") / forearm)

        hip = joints["hip_center"] + pelvis.apply(_bone(HIP, "hip") * out)
        ankle = spot + (parts[f"ankle_{side}"] + np.array(ANKLE_REST)) * out
        hinge = pelvis.apply(np.array(KNEE_HINGE) * [1.0, 1.0, sign])
        knee = _bent(
            hip, ankle, typical_bone_length("knee"), typical_bone_length("ankle"), np.cross(hinge, ankle - hip)
        )
        foot = ankle + _turned(parts[f"foot_{side}"]).apply(_bone(FOOT, "foot") * out)
        joints |= {f"hip_{side}": hip, f"knee_{side}": knee, f"ankle_{side}": ankle, f"foot_{side}": foot}
    return np.stack([joints[name] for name in JOINTS], axis=1)
