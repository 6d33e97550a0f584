"""Joints of the SMPL body from its pose parameters, as AMASS, GVHMR and WHAM store them.

A pose is a rotation vector per joint, relative to its parent, in the axes of a T-pose: x to the performer's left, y up,
z to the front. The lengths of the bones are those of a typical person (`capture.body`), not those of a body shape.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.body import TYPICAL_BONE_METRES as _METRES

Floats = NDArray[np.float64]

_TRUNK = _METRES["spine"] + _METRES["shoulder_center"]

REST: dict[str, tuple[str, tuple[float, float, float]]] = {
    "pelvis": ("", (0.0, 0.0, 0.0)),
    "hip_left": ("pelvis", (0.8 * _METRES["hip"], -0.6 * _METRES["hip"], 0.0)),
    "hip_right": ("pelvis", (-0.8 * _METRES["hip"], -0.6 * _METRES["hip"], 0.0)),
    "spine1": ("pelvis", (0.0, 0.25 * _TRUNK, 0.0)),
    "knee_left": ("hip_left", (0.0, -_METRES["knee"], 0.0)),
    "knee_right": ("hip_right", (0.0, -_METRES["knee"], 0.0)),
    "spine2": ("spine1", (0.0, 0.3 * _TRUNK, 0.0)),
    "ankle_left": ("knee_left", (0.0, -_METRES["ankle"], 0.0)),
    "ankle_right": ("knee_right", (0.0, -_METRES["ankle"], 0.0)),
    "spine3": ("spine2", (0.0, 0.1 * _TRUNK, 0.0)),
    "foot_left": ("ankle_left", (0.0, -0.5 * _METRES["foot"], 1.2 * _METRES["foot"])),
    "foot_right": ("ankle_right", (0.0, -0.5 * _METRES["foot"], 1.2 * _METRES["foot"])),
    "neck": ("spine3", (0.0, 0.35 * _TRUNK, 0.0)),
    "collar_left": ("spine3", (0.35 * _METRES["shoulder"], 0.25 * _TRUNK, 0.0)),
    "collar_right": ("spine3", (-0.35 * _METRES["shoulder"], 0.25 * _TRUNK, 0.0)),
    "head": ("neck", (0.0, _METRES["head"], 0.0)),
    "shoulder_left": ("collar_left", (0.65 * _METRES["shoulder"], 0.0, 0.0)),
    "shoulder_right": ("collar_right", (-0.65 * _METRES["shoulder"], 0.0, 0.0)),
    "elbow_left": ("shoulder_left", (_METRES["elbow"], 0.0, 0.0)),
    "elbow_right": ("shoulder_right", (-_METRES["elbow"], 0.0, 0.0)),
    "wrist_left": ("elbow_left", (_METRES["wrist"], 0.0, 0.0)),
    "wrist_right": ("elbow_right", (-_METRES["wrist"], 0.0, 0.0)),
    "hand_left": ("wrist_left", (_METRES["hand"], 0.0, 0.0)),
    "hand_right": ("wrist_right", (-_METRES["hand"], 0.0, 0.0)),
}
"""Parent of each joint, and its place in the parent's axes in the T-pose, in metres; the order is SMPL's."""

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


def parameters(arrays: Mapping[str, NDArray[np.generic]]) -> tuple[Floats, Floats] | None:
    """Return rotation vectors (T, J, 3) of the first joints and translations (T, 3) in a file's arrays; None without.

    Parameters
    ----------
    arrays : mapping of str to array
        Poses (T, 3 J) or (T, J, 3), in one array or with the root's apart.
    """
    for names in _POSES:
        own = [arrays[name] for name in names if name in arrays and arrays[name].dtype.kind == "f"]
        if len(own) < len(names) or any(array.ndim not in (2, 3) or array.size == 0 for array in own):
            continue
        if len({len(array) for array in own}) > 1:
            continue
        poses = np.concatenate([array.reshape(len(array), -1) for array in own], axis=1, dtype=np.float64)
        if poses.shape[1] % 3 or poses.shape[1] < 22 * 3:
            continue
        for name in _TRANSLATIONS:
            if name in arrays and arrays[name].shape == (len(poses), 3):
                return poses.reshape(len(poses), -1, 3), arrays[name].astype(np.float64)
        return poses.reshape(len(poses), -1, 3), np.zeros((len(poses), 3))
    return None


def positions(poses: Floats, translations: Floats) -> tuple[list[str], Floats]:
    """Return the names and positions (T, 24, 3) of the joints, in metres.

    Parameters
    ----------
    poses : (T, J, 3) float64
        Rotation vectors in radians of the first joints, at least 22; those of others are zero.
    translations : (T, 3) float64
        Metres.
    """
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
