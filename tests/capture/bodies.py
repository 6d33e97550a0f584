"""Bodies that tests make of the ways from joint to joint."""

import numpy as np

from capture.body import typical_bone_length
from capture.skeleton import JOINT_INDEX, PARENTS


def table(text):
    """Return the three numbers of each name, from lines of a name and its numbers."""
    return {name: tuple(map(float, numbers)) for name, *numbers in map(str.split, text.strip().splitlines())}


STANDING = table("""
hip_center      0 0 0
spine           0 0.07 0.01
shoulder_center 0 0.41 0.02
head            0.01 0.61 0
shoulder_left   -0.19 0.36 0.02
elbow_left      -0.24 0.11 0.05
wrist_left      -0.26 -0.12 0.02
hand_left       -0.27 -0.2 0
shoulder_right  0.19 0.35 0.02
elbow_right     0.35 0.52 -0.02
wrist_right     0.41 0.75 -0.08
hand_right      0.43 0.83 -0.11
hip_left        -0.08 -0.06 0
knee_left       -0.1 -0.54 -0.01
ankle_left      -0.11 -0.92 0.05
foot_left       -0.12 -0.96 -0.05
hip_right       0.08 -0.06 0
knee_right      0.11 -0.53 -0.05
ankle_right     0.12 -0.9 0.03
foot_right      0.14 -0.95 -0.08
""")
"""A performer who faces the sensor, with the right arm up; no joint is another's mirror image."""

STANDS = np.array([*STANDING.values()])
"""The performer's joints (20, 3)."""


def both(*parts):
    """Return the indices of joints on both sides."""
    return [JOINT_INDEX[f"{part}_{side}"] for part in parts for side in ("left", "right")]


def bone_of(joint):
    return joint.removesuffix("_left").removesuffix("_right")


def body(ways, start, right=(1, 1, 1), typical=False):
    """Return joints (20, 3), each a way from its parent, the first at `start`.

    `ways` are those of the right side by bone, y up. The left side is their mirror image, and `right` multiplies those
    of the others. If `typical` is true, bones have the lengths of a typical body.
    """
    joints = np.tile(np.array(start, float), (len(JOINT_INDEX), 1))
    for joint, parent in PARENTS.items():
        way = np.multiply(ways[bone_of(joint)], [-1, 1, 1] if joint.endswith("_left") else right)
        if typical:
            way = way * typical_bone_length(joint) / np.linalg.norm(way)
        joints[JOINT_INDEX[joint]] = joints[JOINT_INDEX[parent]] + way
    return joints
