"""Size of a performer: bone lengths, reach of each joint, height; and the rest pose."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, JOINTS, LIMBS, LOST, PARENTS

TYPICAL_BONE_METRES: dict[str, float] = {
    "spine": 0.069,
    "shoulder_center": 0.339,
    "head": 0.202,
    "shoulder": 0.20,
    "elbow": 0.263,
    "wrist": 0.247,
    "hand": 0.084,
    "hip": 0.104,
    "knee": 0.481,
    "ankle": 0.378,
    "foot": 0.091,
}
"""Distance of each joint from its parent: mean over the 15,860 frames of UTKinect-Action3D."""

LIMB_ROOTS = ("shoulder_left", "shoulder_right", "hip_left", "hip_right")
"""Joints at which arms and legs begin."""

TRUNK = LIMBS["trunk"][1:]
"""Joints of the trunk above the hips."""

HEAD_TOP_METRES, ANKLE_HEIGHT_METRES = 0.11, 0.09
"""Distances from the head joint to the top of the head, and from the sole to the ankle."""


HANGING = math.sin(math.radians(10)), -math.cos(math.radians(10))
"""Direction of arms that hang, outwards and up."""

UPRIGHT_WAYS: dict[str, tuple[float, float]] = {
    "shoulder": (1.0, 0.0),
    "hip": (1.0, 0.0),
    "elbow": HANGING,
    "wrist": HANGING,
    "hand": HANGING,
    "knee": (0.0, -1.0),
    "ankle": (0.0, -1.0),
}
"""Directions of bones of a person who stands upright, outwards and up; others point up."""

UPRIGHT_ANGLE = math.radians(25)
"""Largest angle from these directions of a bone that is taken to stand upright or to hang, in radians."""

MIN_WIDTH_METRES = 0.05
"""Smallest width of hips and shoulders that determines a heading, in metres."""


def typical_bone_length(joint: str) -> float:
    """Return the typical length in metres of the bone between a joint and its parent."""
    return TYPICAL_BONE_METRES[joint.removesuffix("_left").removesuffix("_right")]


def bone_lengths(pose: NDArray[np.float64]) -> dict[str, float]:
    """Measure the distance of each joint from its parent.

    If one of the two joints is unknown, the length is that of a typical body, scaled to the known bones.

    Parameters
    ----------
    pose : (20, 3) float64
        Metres; NaN for unknown joints.

    Returns
    -------
    dict
        Metres of the 19 bones, by the joint's name.
    """
    return completed_lengths(
        {
            joint: float(np.linalg.norm(pose[JOINT_INDEX[joint]] - pose[JOINT_INDEX[parent]]))
            for joint, parent in PARENTS.items()
        }
    )


def completed_lengths(measured: Mapping[str, float]) -> dict[str, float]:
    """Replace unknown bone lengths, which are NaN, by those of a typical body, scaled to the known bones."""
    known = [joint for joint, length in measured.items() if np.isfinite(length)]
    size = (
        sum(measured[joint] for joint in known) / sum(typical_bone_length(joint) for joint in known) if known else 1.0
    )
    return {
        joint: length if np.isfinite(length) else size * typical_bone_length(joint)
        for joint, length in measured.items()
    }


def reach(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the maximum distance of each joint from the root of its limb: the length of the bones between them.

    Arms begin at the shoulders and legs at the hips. The reach of the joints of the trunk, which move by leaning and
    crouching, is the length of the trunk from hips to head.

    Parameters
    ----------
    pose : (20, 3) float64
        Metres; NaN for unknown joints.

    Returns
    -------
    (20,) float64
        Metres.
    """
    bones = bone_lengths(pose)
    trunk = sum(bones[joint] for joint in TRUNK)
    lengths = np.full(len(JOINTS), trunk)
    for joint, parent in PARENTS.items():  # parents precede their children
        if joint not in (*TRUNK, *LIMB_ROOTS):
            before = 0.0 if parent in LIMB_ROOTS else lengths[JOINT_INDEX[parent]]
            lengths[JOINT_INDEX[joint]] = before + bones[joint]
    return lengths


def height(pose: NDArray[np.float64]) -> float:
    """Return the height in metres of a performer standing upright, from the bones of legs, trunk and head."""
    bones = bone_lengths(pose)
    legs = np.mean([bones[f"{bone}_{side}"] for bone in ("knee", "ankle") for side in ("left", "right")]) * 2
    return float(
        legs + bones["spine"] + bones["shoulder_center"] + bones["head"] + HEAD_TOP_METRES + ANKLE_HEIGHT_METRES
    )


def upright(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a pose in which a person stands upright with hanging arms, with the bone lengths and heading of another.

    Bones that are nearly in that direction, and the feet, keep theirs: a sensor's joints are not quite where a body's
    are.

    Parameters
    ----------
    pose : (20, 3) float64
        Metres, sensor coordinates; NaN for unknown joints, which stay unknown.

    Returns
    -------
    (20, 3) float64
    """
    across = np.zeros(3)
    for pair in ("hip", "shoulder"):
        way = pose[JOINT_INDEX[f"{pair}_right"]] - pose[JOINT_INDEX[f"{pair}_left"]]
        across += np.where(np.isfinite(way), way, 0.0) * [1, 0, 1]
    size = float(np.linalg.norm(across))
    right = across / size if size > MIN_WIDTH_METRES else np.array([1.0, 0.0, 0.0])
    lengths, out = bone_lengths(pose), pose.copy()
    for joint, parent in PARENTS.items():  # parents precede their children
        bone, _, side = joint.partition("_")
        here, before = JOINT_INDEX[joint], JOINT_INDEX[parent]
        if np.isnan(pose[before]).any():
            continue
        own = pose[here] - pose[before]
        outwards = right if side == "right" else -right
        way = UPRIGHT_WAYS.get(bone if joint != "shoulder_center" else joint, (0.0, 1.0))
        wanted = way[0] * outwards + np.array([0.0, way[1], 0.0])
        near = own @ wanted > math.cos(UPRIGHT_ANGLE) * np.linalg.norm(own)
        if bone == "foot" or near or not np.isfinite(own).all():
            out[here] = out[before] + own
        else:
            out[here] = out[before] + lengths[joint] * wanted
    return out


def not_upright(pose: NDArray[np.float64]) -> list[str]:
    """Return the joints of a pose (20, 3) whose bones `upright` turns: those of a pose that is no upright stand.

    Bones of shoulders, hips and hands do not count: how they lie in an upright stand differs from sensor to sensor.
    """
    parents = [JOINT_INDEX.get(PARENTS.get(joint, ""), JOINT_INDEX[joint]) for joint in JOINTS]
    stand = upright(pose)
    off = np.linalg.norm((stand - stand[parents]) - (pose - pose[parents]), axis=1)
    return [
        joint
        for joint, each in zip(JOINTS, off, strict=True)
        if each > 1e-6 and joint not in LIMB_ROOTS and not joint.startswith("hand")
    ]


def resting_pose(
    positions: NDArray[np.float64], confidence: NDArray[np.float32], first: int, count: int
) -> NDArray[np.float64]:
    """Return the pose at one time of a recording: each joint's median over a few frames.

    Parameters
    ----------
    positions : (T, 20, 3) float64
        Metres.
    confidence : (T, 20) float32
    first, count : int
        The frames to use. For a joint that is lost in all of them, the nearest frames in which it is known are used.

    Returns
    -------
    (20, 3) float64
        NaN for joints that are lost in all frames.
    """
    pose = np.full((len(JOINTS), 3), np.nan)
    for joint in range(len(JOINTS)):
        known = np.flatnonzero(confidence[:, joint] > LOST)
        apart = np.maximum(0, np.maximum(first - known, known - (first + count - 1)))
        chosen = known[apart == 0] if np.any(apart == 0) else known[np.argsort(apart, kind="stable")[:count]]
        if len(chosen):
            pose[joint] = np.median(positions[chosen, joint], axis=0)
    return pose
