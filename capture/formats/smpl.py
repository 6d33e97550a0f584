"""Joints of the SMPL body from its pose parameters, as AMASS, GVHMR and WHAM store them, in arrays, JSON and tables.

A pose is a rotation vector per joint, relative to its parent, in the axes of a T-pose: x to the performer's left, y up,
z to the front. The bones are those of SMPL's mean body, not those of a body shape.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.body import TYPICAL_BONE_METRES
from capture.clip import SkeletonClip
from capture.formats.options import ReadOptions
from capture.formats.positions import clip_of_positions

Floats = NDArray[np.float64]

_MEAN = {
    "pelvis": ("", (0.0, 0.0, 0.0)),
    "hip": ("pelvis", (0.059, -0.086, -0.016)),
    "spine1": ("pelvis", (0.0, 0.124, -0.038)),
    "knee": ("hip", (0.043, -0.385, 0.002)),
    "spine2": ("spine1", (0.0, 0.138, 0.027)),
    "ankle": ("knee", (-0.017, -0.424, -0.036)),
    "spine3": ("spine2", (0.0, 0.056, 0.003)),
    "foot": ("ankle", (0.038, -0.061, 0.126)),
    "neck": ("spine3", (0.0, 0.212, -0.034)),
    "collar": ("spine3", (0.077, 0.113, -0.021)),
    "head": ("neck", (0.0, TYPICAL_BONE_METRES["head"], 0.0)),
    "shoulder": ("collar", (0.118, 0.046, -0.014)),
    "elbow": ("shoulder", (0.258, -0.015, -0.027)),
    "wrist": ("elbow", (0.267, 0.010, -0.007)),
    "hand": ("wrist", (0.088, -0.010, -0.013)),
}
"""Joints of the middle, where x is 0, and of the left side in SMPL's order, as `REST` has them.

The places are those of the mean body (Loper et al., SMPL, 2015), with equal sides and the head's middle as the head.
"""


def _both_sides() -> dict[str, tuple[str, tuple[float, float, float]]]:
    """Return the joints of the middle and of both sides."""
    rest = {}
    for joint, (parent, (x, y, z)) in _MEAN.items():
        for side, sign in (("_left", 1), ("_right", -1)) if x else (("", 1),):
            rest[joint + side] = parent + side if parent and _MEAN[parent][1][0] else parent, (sign * x, y, z)
    return rest


REST = _both_sides()
"""Parent of each joint, and its place (3,) in the parent's axes in the T-pose, in metres; the order is SMPL's."""

_POSES = (
    ("poses",),
    ("smpl_poses",),
    ("pose_world",),
    ("global_orient", "body_pose"),
    ("root_orient", "pose_body"),
    ("fullpose",),
    ("pose",),
)
_TRANSLATIONS = ("trans_world", "trans", "transl", "smpl_trans", "translation")


ROW_SIZES = 22, 24, 52
"""Numbers of joints whose rotations a row without names may have: those of a body, with the hands, with fingers."""

ENDS, TRUNK, LIMBS = (10, 11, 22, 23), (3, 6, 9, 12), (1, 2, 4, 5, 16, 17, 18, 19)
"""Joints of toes and hands, of the trunk, and of arms and legs."""

MAX_TRUNK_TURN, MIN_LIMB_TURN, END_SHARE, MIN_ARM_TURN = 0.8, 0.1, 0.6, 0.2
"""Median rotations, in radians, by which rotation vectors are told from positions and other numbers: the trunk turns
little, arms or legs turn, toes and hands turn by less than this share of it, and arms hang down from the T-pose."""

MAX_JOINTS = 55
"""Number of joints of the largest of these bodies, SMPL-X."""

MAX_DEPTH, MAX_PEOPLE = 5, 16
"""Number of levels of a document in which parameters are searched, and of people in a list."""


class Parameters(NamedTuple):
    """Rotation vectors (T, J, 3) of the first joints, and translations (T, 3)."""

    poses: Floats
    translations: Floats


def parameters(arrays: Mapping[str, Any]) -> Parameters | None:
    """Return the parameters in a file's arrays; None without.

    Parameters
    ----------
    arrays : mapping of str to array, or to lists of numbers
        Poses (T, 3 J), (T, J, 3) or as matrices (T, J, 3, 3), in one array or with the root's apart. Those of one frame
        may lack the first axis, if they are no matrices.
    """
    for names in _POSES:
        own = [_rows(arrays[name]) for name in names if name in arrays]
        poses = [each for each in own if each is not None]
        if len(poses) < len(names) or len({len(each) for each in poses}) > 1:
            continue
        whole = np.concatenate(poses, axis=1)
        if whole.shape[1] % 3 or not 22 * 3 <= whole.shape[1] <= MAX_JOINTS * 3:
            continue
        for name in _TRANSLATIONS:
            way = _rows(arrays.get(name))
            if way is not None and way.shape == (len(whole), 3):
                return Parameters(whole.reshape(len(whole), -1, 3), way)
        return Parameters(whole.reshape(len(whole), -1, 3), np.zeros((len(whole), 3)))
    return None


def _rows(values: Any) -> Floats | None:
    """Return the rows of numbers with a fraction that values are, matrices as rotation vectors; None of others."""
    from scipy.spatial.transform import Rotation  # importing it takes a while

    try:
        rows = np.asarray(values)
        if rows.dtype.kind == "f" and rows.ndim == 4 and rows.shape[2:] == (3, 3):
            turns = Rotation.from_matrix(rows.reshape(-1, 3, 3))
            rows = turns.as_rotvec().reshape(*rows.shape[:2], 3)
    except ValueError:  # lists of several lengths, or no rotations
        return None
    if rows.dtype.kind != "f" or not rows.size or not 0 < rows.ndim < 4:
        return None
    return rows.reshape(len(rows) if rows.ndim > 1 else 1, -1).astype(np.float64)


def in_document(document: Any, depth: int = MAX_DEPTH) -> Iterator[Parameters]:
    """Yield the parameters of each person in a document: in a dictionary, or one frame in each dictionary of a list."""
    frames = document if isinstance(document, list) and all(isinstance(each, dict) for each in document) else []
    own = {name: [frame.get(name) for frame in frames] for name in frames[0]} if frames else document
    if not isinstance(own, dict) or not depth:
        return
    if found := parameters(own):
        yield found
    elif frames and (parameters(frames[0]) or not any(isinstance(each, dict) for each in frames[0].values())):
        for person in frames[:MAX_PEOPLE]:
            yield from in_document(person, 1)
    else:
        for each in own.values():
            yield from in_document(each, depth - 1)


def in_rows(values: NDArray[np.generic]) -> Parameters | None:
    """Return the parameters that rows (T, N) without names are, perhaps after a time; None if they are others.

    A translation may precede or follow the rotations.
    """
    rows = _rows(values)
    if rows is None:
        return None
    for first in (0, 1):
        own = rows[:, first : first + (rows.shape[1] - first) // 3 * 3].reshape(len(rows), -1, 3)
        for before, after in ((0, 0), (1, 0), (0, 1)):
            poses = own[:, before : own.shape[1] - after]
            if first + 3 * own.shape[1] == rows.shape[1] and poses.shape[1] in ROW_SIZES and _are_rotations(poses):
                return Parameters(poses, own[:, 0 if before else -1] if before + after else np.zeros((len(rows), 3)))
    return None


def _are_rotations(vectors: Floats) -> bool:
    """Return whether vectors (T, J, 3) are rotations of the SMPL body's joints, and no positions."""
    if not len(vectors) or not np.isfinite(vectors).all():
        return False
    turns, middle = np.median(np.linalg.norm(vectors, axis=2), axis=0), np.median(vectors, axis=0)
    trunk, limbs = (max(turns[joint] for joint in joints) for joints in (TRUNK, LIMBS))
    ends = max(turns[joint] for joint in (ENDS if len(turns) == 24 else ENDS[:2]))  # otherwise fingers follow
    is_body = trunk < MAX_TRUNK_TURN and limbs > MIN_LIMB_TURN and ends < END_SHARE * limbs
    knees_bend = all(middle[knee, 0] > np.abs(middle[knee, 1:]).max() for knee in (4, 5))
    arms_hang = middle[16, 2] < -MIN_ARM_TURN and middle[17, 2] > MIN_ARM_TURN
    return bool(is_body and knees_bend and arms_hang and turns.max() < 2 * np.pi)


def clip_of(
    path: Path, log_format: str, found: Parameters, options: ReadOptions, notes: tuple[str, ...] = ()
) -> SkeletonClip:
    """Return the clip of a person by parameters; `capture.formats.positions` describes the others.

    Raises
    ------
    SkeletonLogError
        The body lies on its side in all frames.
    """
    names, points = positions(*found)
    notes = (*notes, "Parameters of the SMPL body; the bones are those of its mean shape.")
    return clip_of_positions(path, log_format, names, points, options, notes=notes)


def positions(poses: Floats, translations: Floats) -> tuple[list[str], Floats]:
    """Return the names and positions (T, 24, 3) of the joints, in metres.

    Parameters
    ----------
    poses : (T, J, 3) float64
        Rotation vectors in radians of the first joints, at least 22; those of others do not count. If one is not
        finite, all joints of its frame are NaN.
    translations : (T, 3) float64
        Metres.
    """
    from scipy.spatial.transform import Rotation  # importing it takes a while

    poses = poses[:, :22]
    known = np.asarray(np.isfinite(poses).all(axis=(1, 2)))[:, None]
    poses, translations = np.where(known[..., None], poses, 0), np.where(known, translations, np.nan)
    placed: dict[str, Floats] = {}
    turned: dict[str, Rotation] = {}
    for index, (joint, (parent, offset)) in enumerate(REST.items()):
        own = Rotation.from_rotvec(poses[:, index] if index < 22 else np.zeros((len(poses), 3)))
        if parent:
            placed[joint] = placed[parent] + turned[parent].apply(np.array(offset))
            turned[joint] = turned[parent] * own
        else:
            placed[joint], turned[joint] = translations, own
    return list(REST), np.stack(list(placed.values()), axis=1)
