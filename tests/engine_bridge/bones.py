"""Limbs of bodies that are made by code, and where bones are by forward kinematics."""

import numpy as np
from scipy.spatial.transform import Rotation

from solver.motion.limbs import Limb


def points(text):
    """Return the points (n, 3) of a text, as "0 1 0, 0 1.2 0"."""
    return np.array([point.split() for point in text.split(",")], dtype=np.float64)


def turned(puppet, axes):
    """Return a puppet whose points are multiplied by a matrix."""

    def moved(places):
        return tuple(map(tuple, (np.array(places) @ axes).tolist()))

    limbs = tuple(each.model_copy(update={"points": moved(each.points)}) for each in puppet.limb)
    handles = tuple(each.model_copy(update={"position": moved([each.position])[0]}) for each in puppet.handle)
    return puppet.model_copy(update={"limb": limbs, "handle": handles})


def limb(name, text, parent="trunk"):
    """Return a limb of these points that hangs on the trunk, unless it is the trunk, or on another parent, or none."""
    places = points(text)
    return Limb(name, places, ((0,),) * len(places), parent=None if name == "trunk" else parent)


def in_world(skeleton, positions, rotations):
    """Return the place and the rotation of each joint by its name, of those that are relative to its parent's."""
    found = []
    for joint, place, turn in zip(skeleton.joints, positions, rotations, strict=True):
        start, base = found[joint.parent] if joint.parent >= 0 else (np.zeros(3), Rotation.identity())
        found.append((start + base.apply(place), base * Rotation.from_quat(turn)))
    return dict(zip(skeleton.names, found, strict=True))
