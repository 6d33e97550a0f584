"""Mapping of a character's limbs to the bones of a Unity humanoid.

In a T-pose, all bones of a VRM or Unity humanoid have no rotation. The rest pose of a character differs: its arms may
form an A or hang, its back may be bent. The rotation of a bone is therefore its motion since rest after the rotation
from the T-pose to rest.

Coordinates are Unity's: left-handed, metres, right +x, up +y, forward +z. Character coordinates, in which left is +x,
are mirrored in x; rotations are conjugated by this mirror.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.puppet.puppet import Puppet
from solver.model.bones import Bones
from solver.motion.limbs import TRUNK, Limb, bones_of, parents_first

LIMBS: dict[str, tuple[str, ...]] = {
    TRUNK: ("Hips", "Spine", "Chest"),
    "neck": ("Neck",),
    "head": ("Neck", "Head"),
    "left arm": ("LeftUpperArm", "LeftLowerArm", "LeftHand"),
    "right arm": ("RightUpperArm", "RightLowerArm", "RightHand"),
    "left leg": ("LeftUpperLeg", "LeftLowerLeg", "LeftFoot"),
    "right leg": ("RightUpperLeg", "RightLowerLeg", "RightFoot"),
}
"""Unity's bones for each limb of a puppet file, root to tip; a bone belongs to the first limb that lists it."""

T_POSE: dict[str, tuple[float, float, float]] = {
    TRUNK: (0.0, 1.0, 0.0),
    "neck": (0.0, 1.0, 0.0),
    "head": (0.0, 1.0, 0.0),
    "left arm": (-1.0, 0.0, 0.0),
    "right arm": (1.0, 0.0, 0.0),
    "left leg": (0.0, -1.0, 0.0),
    "right leg": (0.0, -1.0, 0.0),
}
"""Directions of the limbs' bones in a T-pose; feet point forward."""

UPRIGHT_LIMBS = (TRUNK, "neck", "head")
"""Limbs in the middle of the body. A limb that follows by "turn" counts as upright, even if it is bent at rest."""

PARENTS: dict[str, str] = {
    "Spine": "Hips",
    "Chest": "Spine",
    "Neck": "Chest",
    "Head": "Neck",
    **{
        f"{side}{bone}": parent.format(side)
        for side in ("Left", "Right")
        for bone, parent in {
            "Shoulder": "Chest",
            "UpperArm": "{}Shoulder",
            "LowerArm": "{}UpperArm",
            "Hand": "{}LowerArm",
            "UpperLeg": "Hips",
            "LowerLeg": "{}UpperLeg",
            "Foot": "{}LowerLeg",
        }.items()
    },
}
"""Parent of each bone."""

SHOULDER_SHARE = 0.25
"""Position of a shoulder's start, as a share of the way from the end of the trunk to the upper arm."""

MIN_HEADING_SHARE = 0.1
"""Minimum horizontal length of a foot's unit direction for the foot to have a heading."""


@dataclass(frozen=True, eq=False)
class Humanoid:
    """A character's bones by Unity's names.

    Attributes
    ----------
    names : tuple of str
        Names of the n bones, parents first, beginning with the hips.
    parents : (n,) int64
        Rows of the parents, −1 for the hips.
    bones : (n,) int64
        Character's bone that each bone moves with.
    heads : (n, 3) float64
        Starts of the bones at rest, mesh file's coordinates.
    turns : (n, 3, 3) float64
        Rotations from the T-pose to rest, for column vectors.
    axes : (3, 3) float64
        Character's right, up and forward in the mesh file's coordinates, as rows.
    origin : (3,) float64
        Point on the floor below the hips at rest, mesh file's coordinates.
    scale : float
        Metres per unit of the mesh file.
    """

    names: tuple[str, ...]
    parents: NDArray[np.int64]
    bones: NDArray[np.int64]
    heads: NDArray[np.float64]
    turns: NDArray[np.float64]
    axes: NDArray[np.float64]
    origin: NDArray[np.float64]
    scale: float

    def pose(
        self, motions: NDArray[np.float64], root: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the bones' positions and rotations relative to their parents, and the hips' in the world.

        Parameters
        ----------
        motions : (b, 4, 3) float64
            Motions of the character's bones for row vectors, without the root, mesh file's coordinates.
        root : (3,) float64
            Translation of the whole character, mesh file's coordinates.

        Returns
        -------
        positions : (n, 3) float64
            Metres.
        rotations : (n, 4) float64
            Unit quaternions x, y, z, w, with w ≥ 0.
        """
        own = motions[self.bones]
        turned = self.axes @ own[:, :3].swapaxes(1, 2) @ self.axes.T @ self.turns
        moved = np.einsum("ni,nij->nj", self.heads, own[:, :3]) + own[:, 3] + root
        places = self.scale * (moved - self.origin) @ self.axes.T
        # a parent of −1 is the last row, which is the world
        to_parent = np.concatenate([turned, np.eye(3)[None]])[self.parents].swapaxes(1, 2)
        beside = places - np.concatenate([places, np.zeros((1, 3))])[self.parents]
        positions = np.einsum("nij,nj->ni", to_parent, beside)
        return positions, scipy.spatial.transform.Rotation.from_matrix(to_parent @ turned).as_quat(canonical=True)


def is_humanoid(puppet: Puppet) -> bool:
    """Return whether a character has limbs of a humanoid: a trunk, and an arm or a leg."""
    names = {limb.name for limb in puppet.limb}
    return TRUNK in names and any(name not in UPRIGHT_LIMBS for name in names & LIMBS.keys())


def humanoid_of(puppet: Puppet, rest: NDArray[np.float64]) -> Humanoid:
    """Map a character's limbs to the bones of a humanoid.

    If a limb has fewer bones than Unity, all remaining Unity bones move with its last bone.

    Parameters
    ----------
    puppet : Puppet
        A puppet for which `is_humanoid` is true.
    rest : (n, 3) float64
        Character's vertices, mesh file's coordinates.
    """
    limbs = parents_first(puppet.limbs)
    axes = np.diag([-1.0, 1.0, 1.0]) @ puppet.character.basis
    own = bones_of(limbs)
    to_rest = _to_rest(limbs, own, axes)
    found: dict[str, tuple[int, NDArray[np.float64]]] = {}
    first = _first_bones(limbs)
    by_name = {limb.name: limb for limb in limbs}
    trunk_end = by_name[TRUNK].points[-1]
    for name in LIMBS:
        if name in by_name:
            if name.endswith("arm"):
                collar = trunk_end + SHOULDER_SHARE * (by_name[name].points[0] - trunk_end)
                found[f"{name.split()[0].capitalize()}Shoulder"] = found["Chest"][0], collar
            for bone, number, place in _named(by_name[name], [bone for bone in LIMBS[name] if bone not in found]):
                found[bone] = first[name] + number, place
    names = tuple(found)
    bones = np.array([bone for bone, _ in found.values()], dtype=np.int64)
    hips = found["Hips"][1]
    up = axes[1]
    return Humanoid(
        names=names,
        parents=np.array([names.index(PARENTS[name]) if name in PARENTS else -1 for name in names], dtype=np.int64),
        bones=bones,
        heads=np.array([place for _, place in found.values()]),
        turns=to_rest[bones],
        axes=axes,
        origin=hips + ((rest @ up).min() - hips @ up) * up,
        scale=puppet.character.scale,
    )


def _first_bones(limbs: Sequence[Limb]) -> dict[str, int]:
    """Return the number of each limb's first bone."""
    counts = np.cumsum([0, *(len(limb.points) - 1 for limb in limbs)])
    return {limb.name: int(count) for limb, count in zip(limbs, counts, strict=False)}


def _named(limb: Limb, names: Sequence[str]) -> Iterator[tuple[str, int, NDArray[np.float64]]]:
    """Yield the named bones of a limb: name, number in the limb, and start.

    If there are more names than bones, the further ones start at equal intervals along the last bone; hands and feet
    start at its end.
    """
    count = len(limb.points) - 1
    steps = max(len(names) - count + (limb.name in UPRIGHT_LIMBS), 1)
    for number, name in enumerate(names):
        bone = min(number, count - 1)
        head, tail = limb.points[bone], limb.points[bone + 1]
        yield name, bone, head + (number - bone) / steps * (tail - head)


def _to_rest(limbs: Sequence[Limb], bones: Bones, axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each bone's rotation from the T-pose to rest (b, 3, 3), the least one relative to its parent's."""
    aims = (bones.tails - bones.heads) @ axes.T / bones.lengths[:, None]
    turns = np.tile(np.eye(3), (len(bones) + 1, 1, 1))  # the last row belongs to parent −1
    row = 0
    for limb in limbs:
        stands_upright = limb.follow == "turn" and limb.name in UPRIGHT_LIMBS
        names = LIMBS.get(limb.name, ())
        for number in range(len(limb.points) - 1):
            turns[row] = turns[bones.parents[row]]
            if number < len(names) and names[number].endswith("Foot"):
                turns[row] = _heading(aims[row])
            elif names and not stands_upright:
                turns[row] = _least(turns[row] @ T_POSE[limb.name], aims[row]) @ turns[row]
            row += 1
    return turns[:-1]


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
