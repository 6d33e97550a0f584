"""The proportions of a person's body, by which positions of one are told from others."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.body import TYPICAL_BONE_METRES, typical_bone_length
from capture.formats.placement import bone_length
from capture.skeleton import JOINT_INDEX, PARENTS
from puppetline.errors import SkeletonLogError

Floats = NDArray[np.float64]

TYPICAL_TRUNK_METRES = TYPICAL_BONE_METRES["spine"] + TYPICAL_BONE_METRES["shoulder_center"]

MAX_BONE_RATIO = 2.0
"""How many times longer or shorter than a typical person's a bone can be, beside the other bones."""

MAX_SIDES_RATIO = 1.7
"""How many times longer than on the other side a bone can be; noisy trackers have up to 1.45."""

MIN_THICKNESS, MIN_THICKNESS_WITHOUT_HIPS = 0.003, 0.08
"""Smallest size of a person in any direction, as a share of the largest one; standing in a T-pose, it is 0.02.

The second value is for positions without hips, whose depths no other proportion can tell from those in an image.
"""

MIN_POINTS = 7
"""Number of points that need not lie in a plane even in space; a frame has more."""

BONES = tuple(
    (joint, parent) for joint, parent in PARENTS.items() if joint.split("_")[0] in ("elbow", "wrist", "knee", "ankle")
)
"""The long bones of the limbs, by which a person is recognised."""

ENDS = {"wrist": "hand", "ankle": "foot"}
"""Joints at the ends of long bones, and the joints after them."""

MIN_GOOD_SHARE = 0.25
"""Smallest share of frames in which a bone is a person's, if it is not in the others."""


QUATERNION_TOLERANCE, QUATERNION_SHARE = 0.01, 0.9
"""How far the length of quaternions is from 1, in at least this share."""


def bone_ratios(points: Floats) -> Floats:
    """Return how much longer the long bones are than a typical person's (9,), relative to their median.

    The bones are upper arms, forearms, thighs and shins, by the medians of their lengths, and the trunk. NaN if
    unknown.
    """
    typical = [*(typical_bone_length(joint) for joint, _ in BONES), TYPICAL_TRUNK_METRES]
    with warnings.catch_warnings(action="ignore"):  # joints that are always lost
        lengths = [np.nanmedian(bone_length(points, *bone)) for bone in (*BONES, ("shoulder_center", "hip_center"))]
        ratios = np.array(lengths) / typical
        return ratios / np.nanmedian(ratios)


def without_stray_end(points: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Return points (T, 20, 3) without a wrist or an ankle where it is too far from the joint before, and a note.

    Trackers that see a body from several sides lose an end of a limb for long. It counts only if all other bones are a
    person's, and this one is in `MIN_GOOD_SHARE` of the frames: otherwise the joints may be others.
    """
    ratios = bone_ratios(points)
    wrong = np.flatnonzero(~_is_persons(ratios) & np.isfinite(ratios))
    if len(wrong) != 1 or wrong[0] == len(BONES) or BONES[wrong[0]][0].split("_")[0] not in ENDS:
        return points, ()
    joint, parent = BONES[wrong[0]]
    lengths = bone_length(points, joint, parent)
    with np.errstate(invalid="ignore", divide="ignore"):
        is_good = _is_persons(ratios[wrong[0]] * lengths / np.nanmedian(lengths))
    known = np.isfinite(lengths)
    if np.count_nonzero(is_good) < MIN_GOOD_SHARE * np.count_nonzero(known):
        return points, ()
    name, side = joint.split("_")
    points = points.copy()
    for lost in (joint, f"{ENDS[name]}_{side}"):
        points[~is_good, JOINT_INDEX[lost]] = np.nan
    count = f"{np.count_nonzero(known & ~is_good)} of {len(points)} frames"
    return points, (f"In {count}, {joint} is too far from or too close to {parent} for a person. It is lost there.",)


def _is_persons(ratios: Floats) -> NDArray[np.bool_]:
    """Return whether bones are as long as a person's, by their ratios to a typical one's."""
    is_near: NDArray[np.bool_] = np.abs(np.log(ratios)) < np.log(MAX_BONE_RATIO)
    return is_near


def refuse_flat(path: Path, points: Floats, least: float = MIN_THICKNESS) -> None:
    """Check that points (T, J, 3) are in space: their third coordinate is no score, and no copy of another.

    Raises
    ------
    SkeletonLogError
        All points of a frame lie in a plane, in nearly all frames.
    """
    known = points[np.isfinite(points).all(axis=2).sum(axis=1) > MIN_POINTS]
    centred = np.nan_to_num(known - np.nanmean(known, axis=1, keepdims=True)) if len(known) else known
    sizes = np.linalg.svd(centred, compute_uv=False)
    if len(known) and np.percentile(sizes[:, 2] / np.maximum(sizes[:, 0], 1e-12), 95) < least:
        raise SkeletonLogError(
            path,
            found="positions that lie in a plane: positions in an image (2D)",
            expected="x, y and z of a person's joints",
            fix="Use the tracker's positions in space, or the video itself.",
        )


def refuse_rotations(path: Path, values: Floats) -> None:
    """Check that values (T, J, 4) are no unit quaternions, which have a length of 1 in nearly all frames.

    Raises
    ------
    SkeletonLogError
        They are.
    """
    lengths = np.linalg.norm(values, axis=2)
    known = lengths[np.isfinite(lengths)]
    if len(known) and np.mean(np.abs(known - 1) < QUATERNION_TOLERANCE) > QUATERNION_SHARE:
        raise SkeletonLogError(
            path,
            found="four numbers of each joint that are a unit quaternion: rotations, which give no positions alone",
            expected="x, y and z of a person's joints",
            fix="Export the positions of the joints, or the motion as BVH.",
        )


def other_proportions(points: Floats) -> str:
    """Return which bones of points (T, 20, 3) have no person's length beside the others, for messages; "" if all do."""
    ratios = bone_ratios(points)
    wrong = ~_is_persons(ratios) & np.isfinite(ratios)
    bones = (*BONES, ("shoulder_center", "hip_center"))
    return ", ".join(
        f"{parent} to {joint} {ratio:.2g} times a person's"
        for (joint, parent), ratio, bad in zip(bones, ratios, wrong, strict=True)
        if bad
    )


def uneven_sides(points: Floats) -> str:
    """Return which long bones of points (T, 20, 3) are much longer on one side, for messages; "" if none is."""
    ratios = dict(zip((joint for joint, _ in BONES), bone_ratios(points), strict=False))
    found = []
    for joint, parent in BONES:
        with np.errstate(all="ignore"):
            ratio = ratios[joint] / ratios[joint.replace("left", "right")]
            is_uneven = abs(np.log(ratio)) > np.log(MAX_SIDES_RATIO)
        if is_uneven:
            name, bone = joint.removesuffix("_left"), parent.removesuffix("_left")
            found.append(f"{name} is {max(ratio, 1 / ratio):.2g} times as far from {bone}")
    return ", ".join(found)


def refuse_other_bodies(path: Path, points: Floats) -> None:
    """Check that the bones of points (T, 20, 3) have the proportions of a person.

    Raises
    ------
    SkeletonLogError
        A long bone is too long or too short, or none is known.
    """
    listed = other_proportions(points)
    if listed or not np.isfinite(bone_ratios(points)).any():
        raise SkeletonLogError(
            path,
            found=f"distances between joints that no person has ({listed or 'none is known'})",
            expected="the joints of a person, in the order of their names",
            fix="Check the names and the order of the joints; --joints and --columns set them.",
        )
