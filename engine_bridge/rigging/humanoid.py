"""A character's limbs as the bones of a Unity humanoid, as VMC sends them.

Coordinates are Unity's: left-handed, metres, right +x, up +y, forward +z. They are character axes, in which left is +x,
mirrored in x. In a T-pose, no bone is turned.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES, parent_of
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.rigging.joints import LIMB_JOINTS, MIDDLE_LIMBS, Joint, joints_of
from engine_bridge.rigging.skeleton import Skeleton, from_t_pose
from solver.motion.limbs import TRUNK

MIRROR = np.diag([-1.0, 1.0, 1.0])


def is_humanoid(puppet: Puppet) -> bool:
    """Return whether a character has limbs of a humanoid: a trunk, and an arm or a leg."""
    names = {limb.name for limb in puppet.limb}
    return TRUNK in names and any(name not in MIDDLE_LIMBS for name in names & LIMB_JOINTS.keys())


def humanoid_of(puppet: Puppet, rest: NDArray[np.float64]) -> Skeleton:
    """Return the limbs of a humanoid as a skeleton in Unity's coordinates, with Unity's names.

    The origin is on the floor below the hips. Limbs that a humanoid does not have, such as tails, are omitted.

    Parameters
    ----------
    puppet : Puppet
        A puppet for which `is_humanoid` is true.
    rest : (n, 3) float64
        Character's vertices, mesh file's coordinates.
    """
    every = joints_of(puppet.limbs)
    kept = [row for row, joint in enumerate(every) if joint.name in HUMANOID_BONES]
    names = [every[row].name for row in kept]
    axes = puppet.character.basis.T @ from_t_pose(puppet, every)[kept] @ MIRROR
    hips, up = every[kept[0]].head, puppet.character.basis[1]
    joints = tuple(_of_humanoid(every[row], names) for row in kept)
    origin = hips + ((rest @ up).min() - hips @ up) * up
    return Skeleton(joints, axes, world=puppet.character.basis.T @ MIRROR, origin=origin, scale=puppet.character.scale)


def _of_humanoid(joint: Joint, names: Sequence[str]) -> Joint:
    """Return a joint with Unity's name and with its parent in a humanoid with these joints."""
    parent = parent_of(joint.name, names)
    unity = joint.name[0].upper() + joint.name[1:]
    return replace(joint, name=unity, parent=-1 if parent is None else names.index(parent))
