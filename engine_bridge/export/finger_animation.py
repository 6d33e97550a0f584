"""Rotations of the fingers of a skeleton by the channels of a performer's fingers.

Joints of fingers are known by their names (`capture.bone_names`). A finger bends about the axis that is perpendicular
to it and to the direction of the palm, a thumb towards the palm and the little finger.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from capture.bone_names import FINGER_BONES, find_bones
from capture.channels import FULL_BEND_DEGREES
from engine_bridge.character.document import Document
from engine_bridge.character.scene import rotation_matrix, world_transforms
from engine_bridge.export.animation import add_channel
from engine_bridge.rigging.joints import Joint as SkeletonJoint
from engine_bridge.rigging.skeleton import Skeleton

NO_ROTATION = [0.0, 0.0, 0.0, 1.0]

Joint = tuple[str, str, int]
"""Side, finger, and number of the joint from the palm, 1 to 3."""


def finger_joints(document: Document) -> dict[Joint, int]:
    """Return the nodes of the joints of fingers, by their names; the first three of a finger count."""
    bones = find_bones([node.get("name", "") for node in document.gltf["nodes"]])
    return {joint: bones[bone] for joint, bone in FINGER_BONES.items() if bone in bones}


def bend_fingers(document: Document, channels: dict[str, NDArray[np.float32]]) -> int:
    """Add rotations of the fingers that channels bend to a document's first animation, and return their number.

    Parameters
    ----------
    document : Document
    channels : dict of str to (F,) float32
        Values in the keyframes of the animation; those of fingers are used.
    """
    nodes, joints = document.gltf["nodes"], finger_joints(document)
    bent = [joint for joint in joints if f"{joint[1]}_{joint[2]}_{joint[0]}" in channels]
    if not bent:
        return 0
    animation = document.gltf["animations"][0]
    turned = {each["target"].get("node") for each in animation["channels"] if each["target"]["path"] == "rotation"}
    turn = scipy.spatial.transform.Rotation
    clock, world, count = animation["samplers"][0]["input"], world_transforms(document), 0
    for joint in bent:
        node = joints[joint]
        axis = bend_axis(world[:, :3, 3], joints, document, joint)
        if axis is None or node in turned or "matrix" in nodes[node]:
            continue
        own = world[node, :3, :3] / np.linalg.norm(world[node, :3, :3], axis=0)
        angles = np.radians(FULL_BEND_DEGREES) * channels[f"{joint[1]}_{joint[2]}_{joint[0]}"].astype(np.float64)
        at_rest = turn.from_matrix(rotation_matrix(np.array(nodes[node].get("rotation", NO_ROTATION), dtype=float)))
        keys = (at_rest * turn.from_rotvec(angles[:, None] * (axis @ own))).as_quat()
        add_channel(document, animation, clock, keys.astype(np.float32), node, "rotation")
        count += 1
    return count


class FingerBends(NamedTuple):
    """Joints of fingers that channels bend: rows in a skeleton, channels, and axes (f, 3) among the joints' own."""

    rows: list[int]
    channels: list[str]
    axes: NDArray[np.float64]

    def bend(self, rotations: NDArray[np.float64], channels: Mapping[str, float]) -> None:
        """Bend the joints in rotations (n, 4) relative to the parents, unit quaternions x, y, z, w."""
        values = np.array([channels.get(channel, 0.0) for channel in self.channels])
        if values.any():
            turn = scipy.spatial.transform.Rotation
            turns = turn.from_rotvec(np.radians(FULL_BEND_DEGREES) * values[:, None] * self.axes)
            rotations[self.rows] = (turn.from_quat(rotations[self.rows]) * turns).as_quat(canonical=True)


def with_fingers(skeleton: Skeleton, document: Document) -> tuple[Skeleton, FingerBends]:
    """Return a skeleton with the joints of the fingers that a file has, below its hands, and how channels bend them."""
    names, nodes, places = skeleton.names, finger_joints(document), world_transforms(document)[:, :3, 3]
    joints, axes = [*skeleton.joints], [*skeleton.axes]
    rows: dict[Joint, int] = {}
    about = []
    for joint, node in sorted(nodes.items()):
        side, finger, number = joint
        axis = bend_axis(places, nodes, document, joint) if f"{side}Hand" in names else None
        if axis is None:
            continue
        hand = names.index(f"{side}Hand")
        parent, after = rows.get((side, finger, number - 1), hand), nodes.get((side, finger, number + 1))
        tail = 2 * places[node] - joints[parent].head if after is None else places[after]
        y = (tail - places[node]) / np.linalg.norm(tail - places[node])
        x = np.cross(y, np.cross(axis, y))
        own = np.column_stack([x, y, np.cross(x, y)]) / [np.linalg.norm(x), 1, np.linalg.norm(x)]
        rows[joint] = len(joints)
        joints.append(
            SkeletonJoint(FINGER_BONES[joint], parent, joints[hand].bone, places[node], tail, joints[hand].limb)
        )
        axes.append(own)
        about.append(axis @ own)
    made = replace(skeleton, joints=tuple(joints), axes=np.array(axes))
    channels = [f"{finger}_{number}_{side}" for side, finger, number in rows]
    return made, FingerBends([*rows.values()], channels, np.reshape(about, (-1, 3)))


def bend_axis(
    places: NDArray[np.float64], joints: dict[Joint, int], document: Document, joint: Joint
) -> NDArray[np.float64] | None:
    """Return the axis (3,) in the world about which a joint bends towards the palm; None if the palm is unknown."""
    side, finger, number = joint
    inner = joints.get((side, "index", 1))
    outer = next((joints[side, name, 1] for name in ("little", "ring", "middle") if (side, name, 1) in joints), None)
    if inner is None or outer is None:
        return None
    wrist = next((k for k, node in enumerate(document.gltf["nodes"]) if inner in node.get("children", ())), None)
    if wrist is None:
        return None
    palm = np.cross(places[inner] - places[wrist], places[outer] - places[wrist]) * (-1 if side == "left" else 1)
    palm /= max(float(np.linalg.norm(palm)), 1e-12)
    across = places[outer] - places[inner]
    towards = palm + across / max(float(np.linalg.norm(across)), 1e-12) if finger == "thumb" else palm
    node, last = joints[joint], joints.get((side, finger, number + 1))
    children = document.gltf["nodes"][node].get("children", [])
    last = children[0] if last is None and children else last
    before = joints.get((side, finger, number - 1))
    if last is not None:
        along = places[last] - places[node]
    elif before is not None:
        along = places[node] - places[before]
    else:
        return None
    axis: NDArray[np.float64] = np.cross(along, towards)
    length = float(np.linalg.norm(axis))
    return axis / length if length > 0 else None
