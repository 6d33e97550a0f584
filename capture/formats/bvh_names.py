"""Mapping of the joints of a BVH skeleton to the 20 joints of `capture.skeleton`, by their names.

Supported are the skeletons of CMU (with the names of BVH or of ASF files), Biovision, Mixamo, MotionBuilder, MakeHuman,
3ds Max, Unreal, Rigify, VRoid, Character Creator, Motive, Advanced Skeleton, MikuMikuDance, ARKit and the Kinect SDK. A
name is split into a side and a part, so ``LeftUpLeg``, ``mixamorig:LeftUpLeg``, ``UpLeg_L`` and ``Bip01 L UpLeg`` are
equal. One part means different joints in different skeletons: ``LeftShoulder`` is the collar bone if there is a
``LeftArm``, ``LeftLeg`` is the thigh if no other joint is, and ``LeftFoot`` is the ankle if there is no ``LeftAnkle``.
The order in the tables decides.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from textwrap import shorten

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

SIDE_PARTS = {
    "shoulder": ("arm", "upperarm", "uparm", "uarm", "shldr", "humerus", "shoulder", "腕"),
    "elbow": ("forearm", "lowerarm", "loarm", "lowarm", "farm", "radius", "elbow", "ひじ"),
    "wrist": ("wrist", "hand", "手首"),
    "hand": ("handend", "handmiddle1", "middle1", "fingers", "handindex1", "finger2", "hand"),
    "hip": ("upleg", "upperleg", "thigh", "femur", "hip", "leg", "足"),
    "knee": ("leg", "loleg", "lowleg", "lowerleg", "shin", "calf", "tibia", "knee", "ひざ"),
    "ankle": ("ankle", "foot", "足首"),
    "foot": ("toebase", "toe", "toes", "toe0", "ball", "foot", "つま先"),
}
"""Parts of each joint of a side, in order of priority. Each BVH joint is used once."""

MIDDLE_PARTS = {
    "hip_center": ("spinebase", "hips", "pelvis", "hip", "root"),
    "spine": (
        *("spinemid", "spine002", "spine", "spine1", "spine01", "spine2", "abdomen", "chest", "torso"),
        *("lowerback", "upperback", "上半身"),
    ),
    "shoulder_center": ("spineshoulder", "lowerneck", "neck", "neck1", "neck01", "necktwist01", "spine004", "首"),
    "head": ("head", "spine006", "頭"),
}
"""Parts of each joint in the middle, in order of priority."""

MIDPOINTS = {
    "hip_center": ("hip_left", "hip_right"),
    "shoulder_center": ("shoulder_left", "shoulder_right"),
    "spine": ("hip_center", "shoulder_center"),
}
"""Pairs of joints whose midpoint replaces a joint that a skeleton lacks."""

ENDS = {"hand_left": "wrist_left", "hand_right": "wrist_right", "foot_left": "ankle_left", "foot_right": "ankle_right"}
"""Joints that the end of another joint's bone replaces if a skeleton lacks them."""

AROUND = re.compile(r"^(.*:|mixamorig\d*_?|bip\d+[ _]?|cc_base_|j_bip_(c_)?|def-)|(_joint|_m)$", re.IGNORECASE)
SIDES = (
    re.compile(r"^(?P<side>left|right|左|右)(?P<part>.+)$"),
    re.compile(r"^(?P<part>.+)(?P<side>left|right)$"),
    re.compile(r"^(?P<part>.+)(?P<side>[lr])$"),
    re.compile(r"^(?P<side>[lr])(?P<part>.+)$"),
)
PARTS = {part for parts in SIDE_PARTS.values() for part in parts}

Points = NDArray[np.float64]


def normalised_name(name: str) -> str:
    """Return the part in a joint's name, followed by ``_left`` or ``_right`` if it has a side.

    >>> normalised_name("mixamorig:LeftUpLeg"), normalised_name("Hand_L"), normalised_name("Spine1")
    ('upleg_left', 'hand_left', 'spine1')
    """
    if name.startswith("__"):  # a spacer of MakeHuman, which has the name of the joint that follows it
        return ""
    plain = re.sub(r"[ _.\-]", "", AROUND.sub("", name)).lower()
    for pattern in SIDES:
        match = pattern.match(plain)
        if match and match["part"] in PARTS:
            return f"{match['part']}_{'left' if match['side'][0] in 'l左' else 'right'}"
    return plain


def kinect_positions(
    path: Path, tree: Sequence[tuple[str, int]], positions: Sequence[Points]
) -> tuple[Points, dict[str, int], list[str]]:
    """Select the 20 joints of a BVH skeleton.

    The Kinect's head joint is the middle of the head, but a BVH head joint is at the top of the neck. The head is
    therefore the midpoint of the BVH joint and the end of its bone.

    Parameters
    ----------
    path : Path
        The recording, for error messages.
    tree : sequence of (str, int)
        Name and parent of each node, parents first; end sites have no name.
    positions : sequence of (T, 3) float64
        Positions of each node.

    Returns
    -------
    points : (T, 20, 3) float64
        Positions in the units of `positions`; NaN for lost joints.
    chosen : dict
        Node of each joint that has one.
    notes : list of str

    Raises
    ------
    SkeletonLogError
        No joint has a supported name for a joint that a body requires.
    """
    chosen = _choose_nodes([name for name, _ in tree], positions)
    needed = [name for name in JOINTS if name not in chosen and name not in MIDPOINTS and name not in ENDS]
    if needed:
        names = ", ".join(name for name, _ in tree if name)
        raise SkeletonLogError(
            path,
            found=f"no joint for {', '.join(needed)} among {shorten(names, 200, placeholder=' …')}",
            expected="the names of a human skeleton, for example LeftArm or lForeArm",
            fix="Use the joint names of CMU, Mixamo, Unreal or Rigify, or retarget the motion to such a skeleton.",
        )
    ends = _ends(tree)
    notes = []
    hips_coincide = _coincide(positions, chosen["hip_left"], chosen["hip_right"])
    if hips_coincide:
        chosen = {name: ends.get(node, node) for name, node in chosen.items()}
        notes.append("Both hips are at one point. Each joint is placed at the end of the bone with its name.")
    found = {name: positions[node] for name, node in chosen.items()}
    if not hips_coincide:
        found["head"] = (found["head"] + positions[ends.get(chosen["head"], chosen["head"])]) / 2
    for name, bone in ENDS.items():
        if name not in found and chosen[bone] in ends:
            found[name] = positions[ends[chosen[bone]]]
    for name, (one, other) in MIDPOINTS.items():
        if name not in found:
            found[name] = (found[one] + found[other]) / 2
            notes.append(f"No joint for {name}. It is placed half way between {one} and {other}.")
    notes += [f"No joint for {name}. It is lost." for name in JOINTS if name not in found]
    points = np.full((len(positions[0]), len(JOINTS), 3), np.nan)
    for name, point in found.items():
        points[:, JOINT_INDEX[name]] = point
    return points, chosen, notes


def _choose_nodes(names: Sequence[str], positions: Sequence[Points]) -> dict[str, int]:
    """Return for each of the 20 joints the first node in its table that no other joint uses."""
    nodes: dict[str, int] = {}
    for index, name in enumerate(names):
        nodes.setdefault(normalised_name(name), index)
    tables = dict(MIDDLE_PARTS)
    for part, parts in SIDE_PARTS.items():
        for side in ("left", "right"):
            tables[f"{part}_{side}"] = tuple(f"{synonym}_{side}" for synonym in parts)
    chosen: dict[str, int] = {}
    for joint, keys in tables.items():
        free = [nodes[key] for key in keys if key in nodes and nodes[key] not in chosen.values()]
        if joint in ENDS or joint in MIDPOINTS:
            # Bones without length are skipped: CMU has one between wrist and fingers, MakeHuman in the hips.
            inner = chosen.get(PARENTS.get(joint, ""))
            free = [node for node in free if inner is None or not _coincide(positions, inner, node)]
        if free:
            chosen[joint] = free[0]
    return chosen


def _ends(tree: Sequence[tuple[str, int]]) -> dict[int, int]:
    """Return the end of each node's bone: the node's first child."""
    ends: dict[int, int] = {}
    for index, (_, parent) in enumerate(tree):
        ends.setdefault(parent, index)
    return ends


def _coincide(positions: Sequence[Points], one: int, other: int) -> bool:
    return np.array_equal(positions[one], positions[other])
