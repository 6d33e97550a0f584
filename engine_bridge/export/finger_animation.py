"""Rotations of the fingers of a skeleton by the channels of a performer's fingers.

Joints of fingers are known by their names: ``LeftHandIndex1`` (Mixamo), ``leftIndexProximal`` (VRM), ``J_Bip_L_Index1``
or ``index_01_l``. A finger bends about the axis that is perpendicular to it and to the direction of the palm, a thumb
towards the palm and the little finger.
"""

import re

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.channels import FINGERS, FULL_BEND_DEGREES
from engine_bridge.character.document import Document
from engine_bridge.character.scene import rotation_matrix, world_transforms
from engine_bridge.export.animation import add_channel
from engine_bridge.puppet.joint_names import SIDES, WORD

NO_ROTATION = [0.0, 0.0, 0.0, 1.0]

_FINGERS = {**{name: name for name in FINGERS}, "pinky": "little", "pinkie": "little"}
_PARTS = {"metacarpal": 0, "proximal": 1, "intermediate": 2, "distal": 3}

Joint = tuple[str, str, int]
"""Side, finger, and number of the joint from the palm, 1 to 3."""


def finger_joints(document: Document) -> dict[Joint, int]:
    """Return the nodes of the joints of fingers, by their names; the first three of a finger count."""
    fingers: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for number, node in enumerate(document.gltf["nodes"]):
        name = node.get("name", "").rsplit(":", 1)[-1]
        words = [word.lower() for word in WORD.findall(name)]
        side = next((SIDES[word] for word in words if word in SIDES), None)
        finger = next((_FINGERS[word] for word in words if word in _FINGERS), None)
        digits = re.findall(r"\d+", name)
        order = next((_PARTS[word] for word in words if word in _PARTS), int(digits[-1]) if digits else None)
        palm = "metacarpal" in words and finger != "thumb"
        if side is not None and finger is not None and order is not None and not palm and "end" not in words:
            fingers.setdefault((side, finger), []).append((order, number))
    return {(*finger, k): node for finger, chain in fingers.items() for k, (_, node) in enumerate(sorted(chain)[:3], 1)}


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
    clock, world, count = animation["samplers"][0]["input"], world_transforms(document), 0
    for joint in bent:
        node = joints[joint]
        axis = _axis(world[:, :3, 3], joints, document, joint)
        if axis is None or node in turned or "matrix" in nodes[node]:
            continue
        own = world[node, :3, :3] / np.linalg.norm(world[node, :3, :3], axis=0)
        angles = np.radians(FULL_BEND_DEGREES) * channels[f"{joint[1]}_{joint[2]}_{joint[0]}"].astype(np.float64)
        at_rest = Rotation.from_matrix(rotation_matrix(np.array(nodes[node].get("rotation", NO_ROTATION), dtype=float)))
        keys = (at_rest * Rotation.from_rotvec(angles[:, None] * (axis @ own))).as_quat()
        add_channel(document, animation, clock, keys.astype(np.float32), node, "rotation")
        count += 1
    return count


def _axis(
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
