"""Mapping of the joints of a BVH skeleton to the 20 joints of `capture.skeleton`, by their names.

`capture.bone_names` tells the meanings of names.
"""

from collections.abc import Sequence
from pathlib import Path
from textwrap import shorten

import numpy as np
from numpy.typing import NDArray

from capture.bone_names import find_bones
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

_SIDE_BONES = {
    "shoulder": ("UpperArm",),
    "elbow": ("LowerArm",),
    "wrist": ("Hand",),
    "hand": ("Palm", "MiddleProximal", "IndexProximal"),
    "hip": ("UpperLeg",),
    "knee": ("LowerLeg",),
    "ankle": ("Foot",),
    "foot": ("Toes",),
}
BONES = {
    "hip_center": ("hips",),
    "spine": ("spine", "chest", "upperChest"),
    "shoulder_center": ("neck",),
    "head": ("head",),
    **{
        f"{joint}_{side}": tuple(f"{side}{bone}" for bone in bones)
        for joint, bones in _SIDE_BONES.items()
        for side in ("left", "right")
    },
}
"""Names of the bones at whose beginning each joint is, in order of priority."""

MIDPOINTS = {
    "hip_center": ("hip_left", "hip_right"),
    "shoulder_center": ("shoulder_left", "shoulder_right"),
    "spine": ("hip_center", "shoulder_center"),
}
"""Pairs of joints whose midpoint replaces a joint that a skeleton lacks."""

ENDS = {"hand_left": "wrist_left", "hand_right": "wrist_right", "foot_left": "ankle_left", "foot_right": "ankle_right"}
"""Joints that the end of another joint's bone replaces if a skeleton lacks them."""

MIN_BONE_SHARE = 0.002
"""Minimum length of a bone as a share of the skeleton's largest extent; shorter bones have no length."""

Points = NDArray[np.float64]


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
    """Return for each of the 20 joints the first node of its bones; of each name, the first node counts."""
    distinct = list(dict.fromkeys(names))
    bones = {bone: names.index(distinct[index]) for bone, index in find_bones(distinct).items()}
    chosen: dict[str, int] = {}
    for joint, candidates in BONES.items():
        nodes = [bones[bone] for bone in candidates if bone in bones]
        if joint in ENDS or joint in MIDPOINTS:
            # Bones without length are skipped: CMU has one between wrist and fingers, MakeHuman in the hips.
            inner = chosen.get(PARENTS.get(joint, ""))
            nodes = [node for node in nodes if inner is None or not _coincide(positions, inner, node)]
        if nodes:
            chosen[joint] = nodes[0]
    return chosen


def _ends(tree: Sequence[tuple[str, int]]) -> dict[int, int]:
    """Return the end of each node's bone: the node's first child."""
    ends: dict[int, int] = {}
    for index, (_, parent) in enumerate(tree):
        ends.setdefault(parent, index)
    return ends


def _coincide(positions: Sequence[Points], one: int, other: int) -> bool:
    size = np.ptp([points[0] for points in positions], axis=0).max()
    return bool(np.abs(positions[one] - positions[other]).max() <= MIN_BONE_SHARE * size)
