"""Rest poses at the start of motion capture: programs write the pose in which a skeleton is bound before its motion."""

import math

import numpy as np
from numpy.typing import NDArray

from capture.cuts import cut_frames
from capture.skeleton import JOINT_INDEX, LIMBS

MOVING_SHARE = 0.25
"""Share of the joints that move too fast for a person between a rest pose and the motion: at least the arms'."""

STILL_METRES = 0.001
"""Largest distance of a joint from its place in the first frame while the rest pose lasts, in metres."""

SYMMETRY_COSINE = math.cos(math.radians(8))
"""Cosine of the largest angle between a bone and the mirror image of its counterpart in a rest pose."""

STRAIGHT_COSINE = math.cos(math.radians(25))
"""Cosine of the largest angle between thigh and shin, and between upper arm and forearm, in a rest pose."""


def resting_frames(times: NDArray[np.float64], positions: NDArray[np.float64], confidence: NDArray[np.float32]) -> int:
    """Return how many frames at the start of a clip are a rest pose that is not part of the motion.

    Parameters
    ----------
    times : (T,) float64
    positions : (T, 20, 3) float64
        Metres, in any axes.
    confidence : (T, 20) float32
    """
    _, cuts = cut_frames(times, positions, confidence, MOVING_SHARE)
    if not len(cuts) or not _is_rest_pose(positions[0]):
        return 0
    before = positions[: cuts[0]] - positions[0]
    return int(cuts[0]) if np.nanmax(np.abs(before)) <= STILL_METRES else 0


def in_place(rest: NDArray[np.float64], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a rest pose (20, 3) in the place and with the heading of the first of some frames (T, 20, 3), y up.

    Its feet are as high as the lower foot mostly is.
    """
    first = positions[0]
    angle = _heading(first) - _heading(rest)
    turn = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
    turned = rest @ turn.T
    ankles = [JOINT_INDEX["ankle_left"], JOINT_INDEX["ankle_right"]]
    hips = JOINT_INDEX["hip_center"]
    moved = first[hips] - turned[hips]
    moved[1] = np.nanmedian(np.nanmin(positions[:, ankles, 1], axis=1)) - np.nanmin(turned[ankles, 1])
    return turned + moved


def _heading(pose: NDArray[np.float64]) -> float:
    """Return the angle about y of the direction from the left hip to the right one."""
    across = pose[JOINT_INDEX["hip_right"]] - pose[JOINT_INDEX["hip_left"]]
    return math.atan2(-across[2], across[0])


def _is_rest_pose(pose: NDArray[np.float64]) -> bool:
    """Return whether a body (20, 3) has straight arms and legs, and both sides are alike."""
    across = _unit(pose[JOINT_INDEX["hip_right"]] - pose[JOINT_INDEX["hip_left"]])
    left, right = (
        _unit(np.concatenate([np.diff(pose[_joints(f"{side} {limb}")], axis=0) for limb in ("arm", "leg")]))
        for side in ("left", "right")
    )
    mirrored = left - 2 * (left @ across)[:, None] * across
    alike = np.einsum("ba,ba->b", mirrored, right) > SYMMETRY_COSINE
    straight = np.einsum("ba,ba->b", right[::2], right[1::2]) > STRAIGHT_COSINE
    return bool(alike.all() and straight.all())


def _joints(limb: str) -> list[int]:
    """Return the joints at both ends of a limb's two long bones."""
    return [JOINT_INDEX[name] for name in LIMBS[limb][:3]]


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore", divide="ignore"):
        unit: NDArray[np.float64] = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit
