"""A performer's own skeleton: limbs in a T-pose with the lengths of the performer's bones, and joints with VRM's names.

Coordinates are character axes: left +x, up +y, forward +z, metres. The floor is at y = 0, the hips are above the
origin. In the T-pose, all joints have the axes of the world, as in VRM. Both sides of the body are equal. Lengths, and
the positions of hips, shoulders and feet, are medians over the recording, in the axes of the performer's trunk.
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from capture.body import ANKLE_HEIGHT_METRES, completed_lengths
from capture.skeleton import JOINT_INDEX, LOST, PARENTS, TRACKED
from capture.timeline import Timeline
from engine_bridge.puppet.humanoid_bones import SIDES, parent_of
from engine_bridge.rigging.joints import Joint
from engine_bridge.rigging.skeleton import T_POSE, Skeleton
from solver.motion.limbs import TRUNK, Limb, parents_first

NAMES: dict[str, tuple[str, ...]] = {
    TRUNK: ("hips", "spine"),
    "head": ("neck", "head"),
    **{f"{side} shoulder": (f"{side}Shoulder",) for side in SIDES},
    **{f"{side} arm": tuple(f"{side}{bone}" for bone in ("UpperArm", "LowerArm", "Hand")) for side in SIDES},
    **{f"{side} leg": tuple(f"{side}{bone}" for bone in ("UpperLeg", "LowerLeg", "Foot")) for side in SIDES},
}
"""VRM's joints at which the bones of each limb begin."""

TYPICAL_DIRECTIONS = {
    "hip": np.array([0.77, -0.64, 0.0]),
    "shoulder": np.array([0.92, -0.38, 0.0]),
    "foot": np.array([0.0, -0.6, 0.8]),
}
"""Directions of the left hip, shoulder and foot from their parents in a T-pose, for performers without known ones."""

MIN_TRACKED_FRAMES = 10
"""Number of frames with tracked joints from which inferred ones do not count."""

Offsets = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PerformerSkeleton:
    """A performer's skeleton at rest, the T-pose.

    Attributes
    ----------
    limbs : tuple of Limb
        They follow the performer's joints.
    skeleton : Skeleton
        VRM's joints.
    tips : dict
        Positions (3,) of the ends of head, hands and feet, by the name of their joint.
    pose : (20, 3) float64
        The performer's joints, in the order of `capture.skeleton.JOINTS`.
    """

    limbs: tuple[Limb, ...]
    skeleton: Skeleton
    tips: dict[str, NDArray[np.float64]]
    pose: NDArray[np.float64]

    @property
    def height(self) -> float:
        """Height of the tip of the head."""
        return float(self.tips["head"][1])


def skeleton_of(timeline: Timeline) -> PerformerSkeleton:
    """Measure a performer's skeleton.

    Parameters
    ----------
    timeline : Timeline
        Positions in sensor coordinates.
    """
    pose = _t_pose(timeline)
    limbs = _limbs(pose)
    bones = [(limb, number) for limb in parents_first(limbs) for number in range(len(limb.points) - 1)]
    rows = {NAMES[limb.name][number]: row for row, (limb, number) in enumerate(bones)}
    names = ["hips", *(name for name in chain(*NAMES.values()) if name != "hips")]
    joints, tips = [], {}
    for name in names:
        limb, number = bones[rows[name]]
        parent = parent_of(name, names)
        head, tail = limb.points[number : number + 2]
        joints.append(Joint(name, -1 if parent is None else names.index(parent), rows[name], head, tail, limb.name))
        if number == len(limb.points) - 2 and name not in ("spine", *(f"{side}Shoulder" for side in SIDES)):
            tips[name] = tail
    # the Kinect's joint is the middle of the head, where readers of BVH look for it: halfway to the tip
    tips["head"] = 2 * tips["head"] - limbs[1].points[1]
    axes = np.tile(np.eye(3), (len(joints), 1, 1))
    return PerformerSkeleton(limbs, Skeleton(tuple(joints), axes, np.eye(3), np.zeros(3)), tips, pose)


def _t_pose(timeline: Timeline) -> NDArray[np.float64]:
    """Return the performer's joints (20, 3) in a T-pose."""
    lengths, offsets = _lengths(timeline), _offsets(timeline)
    pose = np.zeros((len(JOINT_INDEX), 3))

    def place(joint: str, offset: Offsets) -> None:
        pose[JOINT_INDEX[joint]] = pose[JOINT_INDEX[PARENTS[joint]]] + offset

    for joint in ("spine", "shoulder_center", "head"):
        place(joint, lengths[joint] * np.array([0.0, 1.0, 0.0]))
    for side in SIDES:
        mirror = np.array([1.0 if side == "left" else -1.0, 1.0, 1.0])
        for joint in ("shoulder", "hip"):
            place(f"{joint}_{side}", offsets[joint] * mirror)
        for limb, joints in (("arm", ("elbow", "wrist", "hand")), ("leg", ("knee", "ankle"))):
            for joint in joints:
                place(f"{joint}_{side}", lengths[joint] * np.array(T_POSE[f"{side} {limb}"]))
        place(f"foot_{side}", offsets["foot"] * mirror)
    pose[:, 1] += ANKLE_HEIGHT_METRES - pose[JOINT_INDEX["ankle_left"], 1]
    return pose


def _lengths(timeline: Timeline) -> dict[str, float]:
    """Return the length of each bone without its side, by the joint at its end.

    That of the trunk is the distance from hips to shoulders, in which the joint of the spine has its place: sensors
    place it behind the line between them.
    """
    measured = {joint: _typical(np.linalg.norm(_along(timeline, joint), axis=1)) for joint in PARENTS}
    lengths = completed_lengths(measured)
    equal = {
        joint.removesuffix("_left"): (lengths[joint] + lengths[joint.replace("left", "right")]) / 2
        for joint in PARENTS
        if not joint.endswith("right")
    }
    chord = _typical(np.linalg.norm(_along(timeline, "shoulder_center", "hip_center"), axis=1))
    if np.isfinite(chord):
        share = chord / (equal["spine"] + equal["shoulder_center"])
        equal["spine"], equal["shoulder_center"] = share * equal["spine"], share * equal["shoulder_center"]
    return equal


def _offsets(timeline: Timeline) -> dict[str, Offsets]:
    """Return the positions (3,) of the left hip, shoulder and foot relative to their parents in the T-pose."""
    up, lengths = _along(timeline, "shoulder_center", "hip_center"), _lengths(timeline)
    found = {}
    for joint in ("hip", "shoulder"):
        axes = _axes(up, _along(timeline, f"{joint}_left", f"{joint}_right"))
        sides = [np.einsum("fij,fj->fi", axes, _along(timeline, f"{joint}_{side}")) for side in SIDES]
        sides[1] = sides[1] * [-1.0, 1.0, 1.0]
        found[joint] = _medians(sides)
    feet = [_along(timeline, f"foot_{side}") for side in SIDES]
    found["foot"] = _medians([np.stack([0 * v[:, 0], v[:, 1], np.hypot(v[:, 0], v[:, 2])], axis=1) for v in feet])
    for joint, direction in TYPICAL_DIRECTIONS.items():
        length = lengths[joint]
        known = np.isfinite(found[joint]).all() and np.any(found[joint])
        direction = found[joint] if known else direction
        # the median of each coordinate of a noisy vector is shorter than the median length
        found[joint] = length * direction / np.linalg.norm(direction)
    return found


def _along(timeline: Timeline, joint: str, start: str = "") -> NDArray[np.float64]:
    """Return the vectors (F, 3) to a joint from its parent or from another joint, NaN in frames that do not count."""
    ends = [JOINT_INDEX[start or PARENTS[joint]], JOINT_INDEX[joint]]
    worst = timeline.confidence[:, ends].min(axis=1)
    tracked = worst == TRACKED
    counts = tracked if np.count_nonzero(tracked) >= MIN_TRACKED_FRAMES else worst > LOST
    vectors = np.diff(timeline.positions[:, ends], axis=1)[:, 0] * [-1.0, 1.0, -1.0]
    return np.where(counts[:, None], vectors, np.nan)


def _axes(up: NDArray[np.float64], left: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the directions (F, 3, 3) left, up and forward as rows; NaN if unknown."""
    with np.errstate(invalid="ignore"):
        up = up / np.linalg.norm(up, axis=1, keepdims=True)
        left = left - np.einsum("fi,fi->f", left, up)[:, None] * up
        left = left / np.linalg.norm(left, axis=1, keepdims=True)
    return np.stack([left, up, np.cross(left, up)], axis=1)


def _typical(values: NDArray[np.float64]) -> float:
    """Return the median of the known values; NaN if there is none, or if it is 0."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) or np.nan if len(known) else np.nan


def _medians(vectors: list[NDArray[np.float64]]) -> Offsets:
    """Return the median (3,) of the known vectors of both sides; NaN if there is none."""
    every = np.concatenate(vectors)
    known = every[np.isfinite(every).all(axis=1)]
    return np.median(known, axis=0) if len(known) else np.full(3, np.nan)


def _limbs(pose: NDArray[np.float64]) -> tuple[Limb, ...]:
    """Return the limbs of a performer whose joints are (20, 3) in the T-pose."""

    def limb(name: str, *joints: str | tuple[str, ...], parent: str | None = TRUNK) -> Limb:
        chains = tuple(tuple(JOINT_INDEX[each] for each in ((j,) if isinstance(j, str) else j)) for j in joints)
        points = np.array([pose[list(chain)].mean(axis=0) for chain in chains])
        return Limb(name, points, chains, parent=parent)

    limbs = [
        limb(TRUNK, "hip_center", "spine", "shoulder_center", parent=None),
        limb("head", "shoulder_center", ("shoulder_center", "head"), "head"),
    ]
    for side in SIDES:
        arm = [f"{joint}_{side}" for joint in ("shoulder", "elbow", "wrist", "hand")]
        leg = [f"{joint}_{side}" for joint in ("hip", "knee", "ankle", "foot")]
        limbs.append(limb(f"{side} shoulder", "shoulder_center", arm[0]))
        limbs.append(limb(f"{side} arm", *arm, parent=f"{side} shoulder"))
        limbs.append(limb(f"{side} leg", *leg))
    return tuple(limbs)
