"""Limbs of bodies that are made by code, and where bones are by forward kinematics."""

import numpy as np
from scipy.spatial.transform import Rotation

from solver.motion.limbs import Limb


def limb(name, *points, parent="trunk"):
    """Return a limb that hangs on the trunk, unless it is the trunk, or on another parent, or on none."""
    own = None if name == "trunk" else parent
    return Limb(name, np.array(points, dtype=np.float64), ((0,),) * len(points), parent=own)


def in_world(skeleton, positions, rotations):
    """Return the place and the rotation of each joint by its name, of those that are relative to its parent's."""
    found = []
    for joint, place, turn in zip(skeleton.joints, positions, rotations, strict=True):
        start, base = found[joint.parent] if joint.parent >= 0 else (np.zeros(3), Rotation.identity())
        found.append((start + base.apply(place), base * Rotation.from_quat(turn)))
    return dict(zip(skeleton.names, found, strict=True))
