"""Mapping of the joints of a file's skeleton to the 20 joints of `capture.skeleton`.

`capture.bone_names` tells the meanings of names, `capture.skeleton_shape` those of joints with other names, or else
`capture.formats.joint_order`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import shorten
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.bone_names import find_bones
from capture.formats.joint_order import names_by_shape
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from capture.skeleton_shape import shape_of
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

MAX_END_SHARE = 0.25
"""Largest length of a hand or foot as a share of the skeleton's extent; the end of a longer bone is an error."""

SIDES = "left", "right"

BY_SHAPE_NOTE = "The names of the joints are unknown. Their meanings follow from the shape of the skeleton."

ANIMAL_NOTE = "A four-legged skeleton: the character's legs, trunk and neck point as the animal's do."

FOURS_COSINE, TRUNK_COSINE, FOURS_SHARES = 0.7, 0.5, (0.2, 0.6)
"""On all fours, arms and legs have a cosine above, trunk and legs one below, in more than this share of the frames.

The second share is for skeletons that are labelled by their shape: dogs sit and jump, but people crawl, too.
"""

UPRIGHT_COSINE = -0.8
"""Cosine between trunk and legs below which a skeleton stands upright at rest, as that of no animal on four legs."""

REQUIRED = tuple(joint for joint in JOINTS if joint not in (*MIDPOINTS, *ENDS, "head"))
"""Joints that a body must have; the others can be placed between or beyond them."""

HALF_HEAD_SHARE, NECK_AND_HEAD_SHARE = 0.2, 0.5
"""Lengths of half of the head, and of it and the neck, as shares of the trunk's, for skeletons without them."""

Points = NDArray[np.float64]


class Body(NamedTuple):
    """The 20 joints of a skeleton: points (T, 20, 3), NaN for lost ones; nodes; whether names told; notes; legs."""

    points: Points
    nodes: dict[str, int]
    named: bool
    notes: tuple[str, ...]
    legs: int


def select(
    path: Path,
    names: Sequence[str],
    parents: Sequence[int],
    rest: Points,
    positions: Sequence[Points],
    rotations: Sequence[NDArray[np.float64]],
    options: ReadOptions,
) -> Body:
    """Select the 20 joints of a skeleton, by their names or else by its shape.

    The Kinect's head joint is the middle of the head, but that of a skeleton is at the top of the neck. The head is
    therefore the midpoint of the joint and the end of its bone, which stands upright at rest if the file has none.

    Parameters
    ----------
    path : Path
        The recording, for error messages.
    names, parents, rest, positions, rotations
        As in `capture.formats.skeleton_motion.SkeletonMotion`.
    options : ReadOptions

    Raises
    ------
    SkeletonLogError
        The skeleton is no human body.
    """
    chosen, known_legs = _choose(path, names, parents, rest, positions, options)
    named = known_legs is None
    notes = [] if named else [BY_SHAPE_NOTE]
    ends = _ends(parents)
    hips_coincide = _coincide(positions, chosen["hip_left"], chosen["hip_right"])
    if hips_coincide:
        chosen = {name: ends.get(node, node) for name, node in chosen.items()}
        notes.append("Both hips are at one point. Each joint is placed at the end of the bone with its name.")
    found = {name: positions[node] for name, node in chosen.items()}
    longest = MAX_END_SHARE * np.ptp(rest, axis=0).max()
    for name, bone in ENDS.items():
        end = ends.get(chosen[bone])
        if name not in found and end is not None and np.linalg.norm(rest[end] - rest[chosen[bone]]) <= longest:
            found[name] = positions[end]
    for name, (one, other) in MIDPOINTS.items():
        if name not in found:
            found[name] = (found[one] + found[other]) / 2
            notes.append(f"No joint for {name}. It is placed half way between {one} and {other}.")
    if not hips_coincide:
        found["head"] = _head(chosen, ends, rest, positions, rotations, found)
    notes += [f"No joint for {name}. It is lost." for name in JOINTS if name not in found]
    points = np.full((len(positions[0]), len(JOINTS), 3), np.nan)
    for name, point in found.items():
        points[:, JOINT_INDEX[name]] = point
    is_person = options.as_person or (named and _is_upright(rest, chosen)) or not _is_on_all_fours(points, named)
    legs = 2 if is_person else 4
    if legs > 2 and not (options.animals and known_legs in (None, legs)):  # a shape may also hide which end is the head
        raise _animal_error(path, legs)
    return Body(points, chosen, named, (*notes, *([ANIMAL_NOTE] if legs > 2 else ())), legs)


def _choose(
    path: Path,
    names: Sequence[str],
    parents: Sequence[int],
    rest: Points,
    positions: Sequence[Points],
    options: ReadOptions,
) -> tuple[dict[str, int], int | None]:
    """Return the nodes that are joints, by their names or else by the shape of the skeleton, and then its legs.

    If the rest pose is folded, as in LAFAN's files, the joints are told by how they move.
    """
    named = _choose_nodes(names, positions)
    chosen = named | _between(parents, named)
    missing = [joint for joint in REQUIRED if joint not in chosen]
    if not missing:
        return chosen, None
    shape = shape_of(parents, rest, [not name for name in names])
    if shape.legs > 4 or (shape.legs == 4 and not (options.as_person or options.animals)):
        raise _animal_error(path, shape.legs)
    if all(joint in shape.joints for joint in REQUIRED):
        return shape.joints, shape.legs
    points = np.stack(positions, axis=1) + 1.0  # a joint at the origin would be lost
    moving = {name: node for node, name in enumerate(names_by_shape(points)) if name}
    if not moving:
        raise _names_error(path, names, missing)
    return moving, 2


def _is_upright(rest: Points, chosen: Mapping[str, int]) -> bool:
    """Return whether trunk and legs point to opposite sides of the hips in the rest pose."""
    hips, shoulders, feet = (
        sum(rest[chosen[f"{joint}_{side}"]] for side in SIDES) for joint in ("hip", "shoulder", "ankle")
    )
    trunk, legs = shoulders - hips, feet - hips
    return bool(trunk @ legs < UPRIGHT_COSINE * np.linalg.norm(trunk) * np.linalg.norm(legs))


def _is_on_all_fours(points: Points, named: bool) -> bool:
    """Return whether arms point as legs do, and the trunk across both, in enough frames of points (T, 20, 3)."""
    leg, arm = (
        sum(points[:, JOINT_INDEX[f"{tip}_{side}"]] - points[:, JOINT_INDEX[f"{root}_{side}"]] for side in SIDES)
        for root, tip in (("hip", "ankle"), ("shoulder", "wrist"))
    )
    trunk = points[:, JOINT_INDEX["shoulder_center"]] - points[:, JOINT_INDEX["hip_center"]]
    with np.errstate(invalid="ignore", divide="ignore"):
        leg, arm, trunk = (way / np.linalg.norm(way, axis=1, keepdims=True) for way in (leg, arm, trunk))
        alike, across = np.einsum("ti,ti->t", leg, arm), np.abs(np.einsum("ti,ti->t", trunk, leg))
    return bool(np.mean((alike > FOURS_COSINE) & (across < TRUNK_COSINE)) > FOURS_SHARES[not named])


def _head(
    chosen: Mapping[str, int],
    ends: Mapping[int, int],
    rest: Points,
    positions: Sequence[Points],
    rotations: Sequence[NDArray[np.float64]],
    found: Mapping[str, Points],
) -> Points:
    """Return the middle of the head (T, 3)."""
    node = chosen.get("head", chosen.get("shoulder_center"))
    if node is None:
        top, hips = found["shoulder_center"], found["hip_center"]
        return top + NECK_AND_HEAD_SHARE * (top - hips)
    size = np.ptp(rest, axis=0).max()
    end = ends.get(node)
    if "head" in chosen and end is not None and np.linalg.norm(rest[end] - rest[node]) > MIN_BONE_SHARE * size:
        return (positions[node] + positions[end]) / 2
    trunk = rest[node] - (rest[chosen["hip_left"]] + rest[chosen["hip_right"]]) / 2
    axis = int(np.abs(trunk).argmax())
    up = np.eye(3)[axis] * np.sign(trunk[axis]) * np.linalg.norm(trunk)
    share = HALF_HEAD_SHARE if "head" in chosen else NECK_AND_HEAD_SHARE
    return positions[node] + rotations[node] @ (share * up)


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


def _between(parents: Sequence[int], chosen: Mapping[str, int]) -> dict[str, int]:
    """Return joints that no name tells but the hierarchy: the only node between two others, as knees below hips."""
    found = {}
    for lower, joint in PARENTS.items():
        if joint in REQUIRED and joint not in chosen and lower in chosen:
            node = parents[chosen[lower]]
            if node >= 0 and parents[node] == chosen.get(PARENTS[joint]):
                found[joint] = node
    return found


def _names_error(path: Path, names: Sequence[str], missing: Sequence[str]) -> SkeletonLogError:
    """Return the error for a skeleton whose names and shape are those of no person."""
    listed = shorten(", ".join(filter(None, names)), 200, placeholder=" …")
    return SkeletonLogError(
        path,
        found=f"no joint for {', '.join(missing)} among {listed}",
        expected="the names or the shape of a human skeleton, for example LeftArm or lForeArm",
        fix="Use the joint names of CMU, Mixamo, Unreal or Rigify, or retarget the motion to such a skeleton.",
    )


def _animal_error(path: Path, legs: int) -> SkeletonLogError:
    count = {4: "four", 6: "six", 8: "eight"}.get(legs, str(legs))
    return SkeletonLogError(
        path,
        found=f"a {count}-legged skeleton: no performer",
        expected="the skeleton of a person",
        fix="Use a recording of a person, or read it as one with --as-person.",
    )


def _ends(parents: Sequence[int]) -> dict[int, int]:
    """Return the end of each node's bone: the node's first child."""
    ends: dict[int, int] = {}
    for index, parent in enumerate(parents):
        ends.setdefault(parent, index)
    return ends


def _coincide(positions: Sequence[Points], one: int, other: int) -> bool:
    size = np.ptp([points[0] for points in positions], axis=0).max()
    return bool(np.abs(positions[one] - positions[other]).max() <= MIN_BONE_SHARE * size)
