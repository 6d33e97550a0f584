"""Joints of a file's own skeleton that are those of a humanoid."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.scene import world_transforms
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES, REQUIRED, SIDES
from engine_bridge.puppet.rig_bones import RigBones
from engine_bridge.puppet.skin_joints import vertex_influences
from engine_bridge.rigging.skeleton import Skeleton

SAME_PLACE_DIAGONALS = 0.002
"""Maximum difference of the distances of joints that count as equal, in diagonals."""

SAME_BONE_SHARE = 0.5
"""Smallest share of a bone in the rotation of a joint with which the joint can be that of the bone."""

SPINE = ("hips", "spine", "chest")
"""Joints of the trunk, in the order of the hierarchy; a fourth or later joint is the upper chest."""


def humanoid_joints(prepared: PreparedCharacter, own: RigBones) -> dict[str, int]:
    """Return the nodes of a file's own skeleton that are joints of a VRM humanoid.

    Those of a limb are the joints nearest to the limb's bones that follow them. Of several at one place, such as
    targets of inverse kinematics, it is the one that moves most vertices. The trunk leads from the joint on which both
    legs hang to that on which both arms hang; it begins with the hips, at the first joint that moves vertices. Without
    two legs, the trunk's joints are found like those of limbs.

    Parameters
    ----------
    prepared : PreparedCharacter
    own : RigBones
        Bones that the joints of the file's skeleton follow.

    Returns
    -------
    dict
        Nodes by VRM's names.
    """
    which, share = vertex_influences(prepared.character)
    count = len(prepared.character.document.gltf["nodes"])
    moved = np.bincount(which.ravel(), share.ravel(), count)[own.nodes].astype(np.float64)
    nearest = _nearest(prepared, own, moved)
    trunk = _trunk(own, nearest, moved)
    found = (nearest if not trunk else {name: row for name, row in nearest.items() if name not in SPINE}) | trunk
    return {name: int(own.nodes[row]) for name, row in found.items()}


def _nearest(prepared: PreparedCharacter, own: RigBones, moved: NDArray[np.float64]) -> dict[str, int]:
    """Return the rows of the joints nearest to those of the puppet, at most one for each bone.

    `moved` (j,) is the number of vertices that each joint moves.
    """
    places = world_transforms(prepared.character.document)[own.nodes][:, :3, 3]
    found: dict[str, int] = {}
    bones: set[int] = set()
    for joint in sorted(Skeleton.along_bones(prepared.puppet).joints, key=lambda joint: joint.name not in REQUIRED):
        follows = own.shares[:, joint.bone] > SAME_BONE_SHARE
        if joint.name in HUMANOID_BONES and joint.bone not in bones and follows.any():
            bones.add(joint.bone)
            away = np.where(follows, np.linalg.norm(places - joint.head, axis=1), np.inf)
            near = away <= away.min() + SAME_PLACE_DIAGONALS * float(prepared.model.diagonal)
            found[joint.name] = int(np.where(near, moved, -1).argmax())
    return found


def _trunk(own: RigBones, found: dict[str, int], moved: NDArray[np.float64]) -> dict[str, int]:
    """Return the rows of the trunk's joints and of the collar bones, by the hierarchy; empty without two legs."""
    hips, top = (_common(own, [found.get(f"{side}{name}") for side in SIDES]) for name in ("UpperLeg", "UpperArm"))
    if hips is None:
        return {}
    path = [] if top is None else _to_top(own, top)
    trunk = path[path.index(hips) :: -1] if hips in path else [hips]
    if len(trunk) > 1 and moved[hips] == 0:
        trunk = trunk[1:]
    named = dict(zip(SPINE, trunk, strict=False))
    if len(trunk) > len(SPINE):
        named["upperChest"] = trunk[-1]
    for side in SIDES if len(trunk) > 1 else ():
        collar = int(own.parents[found[f"{side}UpperArm"]])
        if collar not in trunk:
            named[f"{side}Shoulder"] = collar
    return named


def _common(own: RigBones, rows: list[int | None]) -> int | None:
    """Return the lowest joint above all of some joints; None if there is none, or one of them is missing."""
    paths = [_to_top(own, row)[1:] for row in rows if row is not None]
    if len(paths) < len(rows):
        return None
    return next((row for row in paths[0] if all(row in path for path in paths)), None)


def _to_top(own: RigBones, row: int) -> list[int]:
    path = [row]
    while own.parents[path[-1]] >= 0:
        path.append(int(own.parents[path[-1]]))
    return path
