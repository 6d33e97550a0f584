"""A character's skeleton: its joints with their axes at rest, and their pose by the motions of the bones.

The local rotation of a joint is (M_p F_p)ᵀ M F, where F are its axes at rest as columns, M is the rotation of its bone
since rest, and M_p F_p belong to its parent. Two kinds of axes are in use:

- **along the bone**: +y points from the joint to the next, as Blender and Mixamo have it;
- **of the T-pose**: in a T-pose, all joints have the axes of the character, as in VRM, VMC and Unity. The rest pose of
  a character differs: its arms may form an A or hang, its back may be bent. A joint's axes at rest are therefore those
  of the character after the rotation from the T-pose to rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from engine_bridge.puppet.puppet import Puppet
from engine_bridge.rigging.joints import LIMB_JOINTS, MIDDLE_LIMBS, Joint, joints_of
from puppetline.compiled import compiled
from solver.motion import quaternions as quat
from solver.motion.limbs import Limb, parents_first

T_POSE: dict[str, tuple[float, float, float]] = {
    **dict.fromkeys(MIDDLE_LIMBS, (0.0, 1.0, 0.0)),
    "left arm": (1.0, 0.0, 0.0),
    "right arm": (-1.0, 0.0, 0.0),
    "left leg": (0.0, -1.0, 0.0),
    "right leg": (0.0, -1.0, 0.0),
}
"""Directions of the limbs' bones in a T-pose, character axes (left +x, up +y, forward +z); feet point forward."""

MIN_HEADING_SHARE = 0.1
"""Minimum horizontal length of a foot's unit direction for the foot to have a heading."""

MAX_ROLL_COSINE = 0.9
"""Largest cosine of the angle between a bone and the character's front with which the front determines its roll."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A character's joints at rest.

    Attributes
    ----------
    joints : tuple of Joint
        The n joints, parents first, mesh file's coordinates.
    axes : (n, 3, 3) float64
        Axes of the joints at rest, as columns, mesh file's coordinates.
    world : (3, 3) float64
        Axes of the world in which the joints are posed, as columns, mesh file's coordinates.
    origin : (3,) float64
        Its origin, mesh file's coordinates.
    scale : float
        Its units per unit of the mesh file.
    """

    joints: tuple[Joint, ...]
    axes: NDArray[np.float64]
    world: NDArray[np.float64]
    origin: NDArray[np.float64]
    scale: float = 1.0

    @classmethod
    def along_bones(cls, puppet: Puppet) -> Self:
        """Return the skeleton of a puppet with axes along its bones, in the mesh file's coordinates."""
        joints = joints_of(puppet.limbs, [(handle.name, np.array(handle.position)) for handle in puppet.handle])
        return cls(tuple(joints), along_bones(joints, puppet.character.basis), np.eye(3), np.zeros(3))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def parents(self) -> NDArray[np.int64]:
        """(n,) int64: row of each joint's parent, −1 for none."""
        return np.array([joint.parent for joint in self.joints], dtype=np.int64)

    @cached_property
    def bones(self) -> NDArray[np.int64]:
        """(n,) int64: the bone that each joint moves with, see `Joint`."""
        return np.array([joint.bone for joint in self.joints], dtype=np.int64)

    @cached_property
    def heads(self) -> NDArray[np.float64]:
        """(n, 3) float64: positions at rest, mesh file's coordinates."""
        return np.array([joint.head for joint in self.joints], dtype=np.float64).reshape(-1, 3)

    @cached_property
    def travelling(self) -> NDArray[np.bool_]:
        """(n,) bool: joints that move relative to their parents: those without a parent, and those of handles."""
        return (self.parents < 0) | np.array([not joint.limb for joint in self.joints])

    @property
    def rest(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The pose at rest, see `pose`."""
        still = np.tile(np.eye(4, 3), (max(int(self.bones.max(initial=0)), 0) + 1, 1, 1))
        return self.pose(still, np.zeros(3))

    def pose(
        self, motions: NDArray[np.float64], root: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the joints' positions and rotations relative to their parents, or to the world for those without.

        Parameters
        ----------
        motions : (b, 4, 3) float64
            Motions of the bones and handles for row vectors, without the root, mesh file's coordinates.
        root : (3,) float64
            Translation of the whole character, mesh file's coordinates.

        Returns
        -------
        positions : (n, 3) float64
            Units of `world`.
        rotations : (n, 4) float64
            Unit quaternions x, y, z, w, with w ≥ 0.
        """
        positions, rotations = np.empty((len(self.joints), 3)), np.empty((len(self.joints), 4))
        world = self.origin, np.ascontiguousarray(self.world), float(self.scale)
        _pose(self.parents, self.bones, self.heads, self.axes, *world, motions, root, positions, rotations)
        return positions, rotations


@compiled(waits=False)
def _pose(parents, bones, heads, axes, origin, world, scale, motions, root, positions, rotations):
    """Write the joints' positions and rotations relative to their parents."""
    turned, places, local = np.empty((len(parents), 3, 3)), np.empty((len(parents), 3)), np.empty((3, 3))
    for j in range(len(parents)):
        b, p = bones[j], parents[j]
        for i in range(3):
            places[j, i] = root[i] + (motions[b, 3, i] if b >= 0 else heads[j, i])
            for k in range(3):
                turned[j, i, k] = 0.0 if b >= 0 else axes[j, i, k]
                if b >= 0:
                    places[j, i] += heads[j, k] * motions[b, k, i]
                    for x in range(3):
                        turned[j, i, k] += motions[b, x, i] * axes[j, x, k]
        above, start = (turned[p], places[p]) if p >= 0 else (world, origin)
        for i in range(3):
            positions[j, i] = 0.0
            for k in range(3):
                positions[j, i] += scale * above[k, i] * (places[j, k] - start[k])
                local[k, i] = 0.0  # rows and columns exchanged: a rotation for row vectors
                for x in range(3):
                    local[k, i] += above[x, i] * turned[j, x, k]
        q = quat.of_rows(local)
        sign = -1.0 if q[0] < 0 else 1.0
        for x in range(3):
            rotations[j, x] = sign * q[x + 1]
        rotations[j, 3] = sign * q[0]


def along_bones(joints: Sequence[Joint], basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return axes of joints whose y axes point from head to tail.

    The z axis of a limb's first joint is as near as possible to the character's front, or for bones that point there,
    to up. The least rotation from bone to bone leads from there to the further joints of the limb, so that all of them
    bend about similar axes. A joint at the tip of a limb has the axes of its parent.

    Parameters
    ----------
    joints : sequence of Joint
    basis : (3, 3) float64
        Rows: the mesh file's directions of the character's left, up and forward.

    Returns
    -------
    (n, 3, 3) float64
        Columns: x, y and z.
    """
    axes = np.tile(basis.T, (len(joints), 1, 1))
    for row, joint in enumerate(joints):
        along = joint.tail - joint.head
        length = float(np.linalg.norm(along))
        if length == 0:
            if joint.parent >= 0:
                axes[row] = axes[joint.parent]
            continue
        y = along / length
        if joint.limb and joint.parent >= 0 and joints[joint.parent].limb == joint.limb:
            x = _least(axes[joint.parent][:, 1], y) @ axes[joint.parent][:, 0]
            x -= (x @ y) * y  # rounding would add up over many bones
        else:
            x = np.cross(y, basis[2] if abs(y @ basis[2]) <= MAX_ROLL_COSINE else basis[1])
        x /= np.linalg.norm(x)
        axes[row] = np.column_stack([x, y, np.cross(x, y)])
    return axes


def from_t_pose(puppet: Puppet, joints: Sequence[Joint]) -> NDArray[np.float64]:
    """Return the rotation of each joint from the T-pose to rest, the least one relative to its parent's.

    Joints of limbs that have no direction in a T-pose, such as tails, do not turn relative to their parents. Nor does a
    limb in the middle of the body that follows by "turn": it counts as upright, even if it is bent at rest.

    Returns
    -------
    (n, 3, 3) float64
        For column vectors in character axes.
    """
    limbs = parents_first(puppet.limbs)
    of_bone = [(limb, number) for limb in limbs for number in range(len(limb.points) - 1)]
    turns = np.tile(np.eye(3), (len(joints) + 1, 1, 1))  # the last row belongs to parent −1
    done: dict[int, NDArray[np.float64]] = {}
    for row, joint in enumerate(joints):
        turns[row] = turns[joint.parent]
        if not 0 <= joint.bone < len(of_bone):
            continue
        limb, number = of_bone[joint.bone]
        if joint.bone not in done and joint.limb == limb.name:
            done[joint.bone] = _to_rest(limb, number, turns[joint.parent], puppet.character.basis)
        if joint.bone in done:
            turns[row] = done[joint.bone]
    return turns[:-1]


def _to_rest(limb: Limb, number: int, parent: NDArray[np.float64], basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation (3, 3) of a limb's bone from the T-pose to rest, given its parent's."""
    names = LIMB_JOINTS.get(limb.name, ())
    aim = basis @ (limb.points[number + 1] - limb.points[number])
    aim /= np.linalg.norm(aim)
    if number < len(names) and names[number].endswith(("Foot", "Toes")):
        return _heading(aim)
    if limb.name not in T_POSE or (limb.follow == "turn" and limb.name in MIDDLE_LIMBS):
        return parent
    return _least(parent @ T_POSE[limb.name], aim) @ parent


def _heading(aim: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a foot's rotation about the upright axis only, because its sole is flat at rest."""
    flat = float(np.hypot(aim[0], aim[2]))
    if flat < MIN_HEADING_SHARE:
        return np.eye(3)
    s, c = aim[0] / flat, aim[2] / flat
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _least(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the least rotation from one direction to another; about the forward axis if they are opposite."""
    cosine = float(a @ b)
    if cosine < -1 + 1e-9:
        axis = np.array([0.0, 0.0, 1.0]) - a[2] * a if abs(a[2]) < 0.9 else np.array([1.0, 0.0, 0.0]) - a[0] * a
        axis /= np.linalg.norm(axis)
        return 2 * np.outer(axis, axis) - np.eye(3)
    x, y, z = np.cross(a, b)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + across + across @ across / (1 + cosine)
