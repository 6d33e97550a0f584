"""Which joint of a BVH skeleton is which of the 20, by the names that programs give them.

Known are the skeletons of CMU, Biovision, Mixamo, MotionBuilder, MakeHuman, 3ds Max, Unreal and the Kinect SDK. A name
is taken apart into a side and a part, so that ``LeftUpLeg``, ``mixamorig:LeftUpLeg``, ``UpLeg_L`` and ``Bip01 L UpLeg``
are the same. The same part means different joints in different skeletons (``LeftShoulder`` is the collar bone where
there is a ``LeftArm``, and ``LeftFoot`` the ankle where there is no ``LeftAnkle``); the order in the tables decides.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

SIDED = {
    "shoulder": ("arm", "upperarm", "uparm", "shldr", "shoulder"),
    "elbow": ("forearm", "lowerarm", "loarm", "lowarm", "elbow"),
    "wrist": ("wrist", "hand"),
    "hand": ("handend", "handmiddle1", "middle1", "fingers", "handindex1", "finger2", "hand"),
    "hip": ("upleg", "upperleg", "thigh", "hip"),
    "knee": ("leg", "loleg", "lowleg", "lowerleg", "shin", "calf", "knee"),
    "ankle": ("ankle", "foot"),
    "foot": ("toebase", "toe", "toes", "toe0", "ball", "foot"),
}
"""Parts of a side for each of its joints, the one that decides first; a BVH joint is given once only."""

MIDDLE = {
    "hip_center": ("spinebase", "hips", "pelvis", "hip", "root"),
    "spine": ("spinemid", "spine", "spine1", "spine01", "spine2", "abdomen", "chest", "torso", "lowerback"),
    "shoulder_center": ("spineshoulder", "lowerneck", "neck", "neck1", "neck01"),
    "head": ("head",),
}

MIDPOINTS = {
    "hip_center": ("hip_left", "hip_right"),
    "shoulder_center": ("shoulder_left", "shoulder_right"),
    "spine": ("hip_center", "shoulder_center"),
}
"""What stands in for a joint that a skeleton does not have."""

ENDS = {"hand_left": "wrist_left", "hand_right": "wrist_right", "foot_left": "ankle_left", "foot_right": "ankle_right"}
"""Joints that may be where the bone of another one ends."""

PREFIX = re.compile(r"^(.*:|mixamorig\d*_?|bip\d+[ _]?)", re.IGNORECASE)
SIDES = (
    re.compile(r"^(?P<side>left|right)(?P<part>.+)$"),
    re.compile(r"^(?P<part>.+)(?P<side>left|right)$"),
    re.compile(r"^(?P<part>.+)(?P<side>[lr])$"),
    re.compile(r"^(?P<side>[lr])(?P<part>.+)$"),
)
PARTS = {part for parts in SIDED.values() for part in parts}

Points = NDArray[np.float64]


def key_of(name: str) -> str:
    """Reduce a joint's name to its part, with ``_left`` or ``_right`` after it if it has a side.

    >>> key_of("mixamorig:LeftUpLeg"), key_of("rThigh"), key_of("Hand_L"), key_of("Spine1")
    ('upleg_left', 'thigh_right', 'hand_left', 'spine1')
    """
    if name.startswith("__"):  # MakeHuman's spacers, which carry the name of the joint that they lead to
        return ""
    plain = re.sub(r"[ _.\-]", "", PREFIX.sub("", name)).lower()
    for pattern in SIDES:
        match = pattern.match(plain)
        if match and match["part"] in PARTS:
            return f"{match['part']}_{'left' if match['side'].startswith('l') else 'right'}"
    return plain


def kinect_points(
    path: Path, tree: Sequence[tuple[str, int]], positions: Sequence[Points]
) -> tuple[Points, dict[str, int], list[str]]:
    """Pick the 20 joints out of a BVH skeleton.

    Kinect's head is the middle of the head, while a BVH head joint is where the head turns on the neck: the point half
    way to where its bone ends is taken.

    Parameters
    ----------
    path : Path
        For the error.
    tree : sequence of (str, int)
        Name and parent of each node, parents first; end sites have no name.
    positions : sequence of (T, 3) float64
        Of each node.

    Returns
    -------
    points : (T, 20, 3) float64
        In the units of `positions`; NaN where a joint cannot be found.
    chosen : dict
        Name of a joint to the node that it is.
    notes : list of str

    Raises
    ------
    SkeletonLogError
        A joint that a body cannot do without has none of the known names.
    """
    chosen = _choose([name for name, _ in tree], positions)
    needed = [name for name in JOINTS if name not in chosen and name not in MIDPOINTS and name not in ENDS]
    if needed:
        raise SkeletonLogError(
            path,
            found=f"no joint named as {', '.join(needed)} among {', '.join(name for name, _ in tree if name)[:200]}",
            expected="the names of a human skeleton, as LeftArm or lForeArm",
            fix="Rename the joints as CMU, Mixamo or Biovision do, or retarget the motion to such a skeleton.",
        )
    ends = _ends(tree)
    notes = []
    if _coincide(positions, chosen["hip_left"], chosen["hip_right"]):
        chosen = {name: ends.get(node, node) for name, node in chosen.items()}
        notes.append("Both hips are at one point: joints are taken where the bones of their names end.")
        found = {name: positions[node] for name, node in chosen.items()}
    else:
        found = {name: positions[node] for name, node in chosen.items()}
        found["head"] = (found["head"] + positions[ends.get(chosen["head"], chosen["head"])]) / 2
    for name, bone in ENDS.items():
        if name not in found and chosen[bone] in ends:
            found[name] = positions[ends[chosen[bone]]]
    for name, (one, other) in MIDPOINTS.items():
        if name not in found:
            found[name] = (found[one] + found[other]) / 2
            notes.append(f"No joint for {name}: half way between {one} and {other}.")
    lost = [name for name in JOINTS if name not in found]
    notes += [f"No joint for {name}: lost." for name in lost]
    points = np.full((len(positions[0]), len(JOINTS), 3), np.nan)
    for name, point in found.items():
        points[:, JOINT_INDEX[name]] = point
    return points, chosen, notes


def _choose(names: Sequence[str], positions: Sequence[Points]) -> dict[str, int]:
    """Give each of the 20 joints the first node of its table that is still free."""
    nodes: dict[str, int] = {}
    for index, name in enumerate(names):
        nodes.setdefault(key_of(name), index)
    tables = dict(MIDDLE)
    for part, parts in SIDED.items():
        for side in ("left", "right"):
            tables[f"{part}_{side}"] = tuple(f"{synonym}_{side}" for synonym in parts)
    chosen: dict[str, int] = {}
    for joint, keys in tables.items():
        free = [nodes[key] for key in keys if key in nodes and nodes[key] not in chosen.values()]
        if joint in ENDS or joint in MIDPOINTS:
            # A bone without length is none: CMU has one between wrist and fingers, MakeHuman in the hips.
            inner = chosen.get(PARENTS.get(joint, ""))
            free = [node for node in free if inner is None or not _coincide(positions, inner, node)]
        if free:
            chosen[joint] = free[0]
    return chosen


def _ends(tree: Sequence[tuple[str, int]]) -> dict[int, int]:
    """Return where each node's bone ends: its first child."""
    ends: dict[int, int] = {}
    for index, (_, parent) in enumerate(tree):
        ends.setdefault(parent, index)
    return ends


def _coincide(positions: Sequence[Points], one: int, other: int) -> bool:
    return np.array_equal(positions[one], positions[other])
