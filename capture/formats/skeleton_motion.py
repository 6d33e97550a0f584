"""Motion of named skeletons, as motion capture has it, as clips: BVH, ASF/AMC and MVNX.

A file may have several skeletons. Each that is a human body is one performer; others, such as props, are skipped. If
only all of them together are a body, they are one performer. `capture.formats.skeleton_joints` chooses the 20 joints.

Such files define no sensor, and often neither unit nor up axis (`capture.formats.placement`). The whole motion is
moved: in the first frame, the performer faces the sensor, with the hips 2.5 m in front of it.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.formats.clips import build_clip
from capture.formats.options import ReadOptions
from capture.formats.placement import place, size_of, toes_ahead, without_far_frames
from capture.formats.proportions import refuse_other_bodies
from capture.formats.skeleton_joints import select
from capture.orientations import unknown
from capture.rest_frames import in_place, resting_frames
from capture.skeleton import JOINT_INDEX, LOST, TRACKED
from puppetline.errors import SkeletonLogError

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SkeletonMotion:
    """The joints of one or more skeletons in every frame, in the unit and axes of the file.

    Attributes
    ----------
    names : sequence of str
        Empty for the end of a joint's bone.
    parents : sequence of int
        Indices of the parents, which precede their children; −1 for a root.
    rest : (J, 3) float64
        Positions in the pose in which all rotations are the identity.
    positions : sequence of (T, 3) float64
    rotations : sequence of (T, 3, 3) float64
        From the axes of each joint to those of the file.
    """

    names: Sequence[str]
    parents: Sequence[int]
    rest: Floats
    positions: Sequence[Floats]
    rotations: Sequence[Floats]

    def part(self, start: int, end: int) -> "SkeletonMotion":
        """Return the joints from `start` to before `end`, which are whole skeletons."""
        return SkeletonMotion(
            self.names[start:end],
            [max(parent - start, -1) for parent in self.parents[start:end]],
            self.rest[start:end],
            self.positions[start:end],
            self.rotations[start:end],
        )


def rest_positions(parents: Sequence[int], offsets: Sequence[Floats]) -> Floats:
    """Return the positions (J, 3) of joints from their offsets (3,) from their parents."""
    rest = np.array(offsets, dtype=np.float64).reshape(-1, 3)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            rest[joint] += rest[parent]
    return rest


def forward_kinematics(
    parents: Sequence[int], translations: Sequence[Floats], rotations: Sequence[Floats]
) -> tuple[list[Floats], list[Floats]]:
    """Compute the position and rotation of every joint in every frame.

    Position = parent's position + parent's rotation · translation, rotation = parent's rotation · own rotation.

    Parameters
    ----------
    parents : sequence of int
        Parents precede children; −1 for a root.
    translations : sequence of (T, 3) float64
        From the parent, in the parent's axes.
    rotations : sequence of (T, 3, 3) float64
        From the joint's axes to the parent's.

    Returns
    -------
    positions : list of (T, 3) float64
    rotations : list of (T, 3, 3) float64
        From the joint's axes to those of the file.
    """
    positions: list[Floats] = []
    turned: list[Floats] = []
    for parent, translation, rotation in zip(parents, translations, rotations, strict=True):
        if parent < 0:
            positions.append(translation)
            turned.append(rotation)
        else:
            positions.append(positions[parent] + (turned[parent] @ translation[..., None])[..., 0])
            turned.append(turned[parent] @ rotation)
    return positions, turned


def clips_of(
    path: Path,
    log_format: str,
    times: Floats,
    motion: SkeletonMotion,
    options: ReadOptions,
    notes: tuple[str, ...] = (),
) -> list[SkeletonClip]:
    """Return one clip per skeleton that is a human body, with user numbers from 0.

    Raises
    ------
    SkeletonLogError
        No skeleton is a human body.
    """
    if len(times) > 1 and all((each == each[0]).all() for each in motion.positions):
        notes = ("All frames are equal; the recording is a pose without motion.", *notes)
    roots = [index for index, parent in enumerate(motion.parents) if parent < 0]
    clips: list[SkeletonClip] = []
    skipped: list[str] = []
    if len(roots) > 1:
        for start, end in pairwise([*roots, len(motion.parents)]):
            try:
                clips.append(_clip(path, log_format, times, motion.part(start, end), options))
            except SkeletonLogError:
                skipped.append(f"The skeleton of {motion.names[start]} is no human body. It is omitted.")
    if not clips:
        clips, skipped = [_clip(path, log_format, times, motion, options)], []
    return [
        replace(clip, user=user, notes=(*clip.notes[:3], *notes, *skipped, *clip.notes[3:]))
        for user, clip in enumerate(clips)
    ]


def _clip(path: Path, log_format: str, times: Floats, motion: SkeletonMotion, options: ReadOptions) -> SkeletonClip:
    """Return the clip of a human body, in metres and in front of the sensor."""
    body = select(path, motion.names, motion.parents, motion.rest, motion.positions, motion.rotations, options)
    size = size_of(path, body.points, options)
    points, far_notes = without_far_frames(body.points, size.unit)
    if not body.named and not options.as_person and body.legs == 2:
        refuse_other_bodies(path, points)
    confidence = np.where(np.isnan(points[..., 0]), LOST, TRACKED).astype(np.float32)
    first = resting_frames(times, size.unit * points, confidence)
    where = place(path, points[first:], _front(points[first:]), size, options, by_sensor=False)
    positions = where.apply(points)
    orientations = unknown((len(times),))
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(where.axes))])
    for name, node in body.nodes.items():
        turned = Rotation.from_matrix(where.axes @ motion.rotations[node] @ handed)
        orientations[:, JOINT_INDEX[name]] = turned.as_quat()[:, [3, 0, 1, 2]]
    moving = slice(first, None)
    notes = (*where.notes, *far_notes, *body.notes, *_repeated(motion.names))
    clip = build_clip(
        path, log_format, times[moving], positions[moving], confidence[moving], notes, orientations[moving]
    )
    clip = replace(clip, legs=body.legs)
    if first == 0:
        return clip
    rest_note = "The recording begins with a rest pose elsewhere, which is omitted and serves as the calibration pose."
    return replace(clip, rest=in_place(positions[0], positions[moving]), notes=(*clip.notes, rest_note))


def _front(points: Floats) -> Floats:
    """Return the sum of the directions (T, 3) from ankles to toes, as far as they are not those of the shins."""
    ways = []
    for side in ("left", "right"):
        knee, ankle, foot = (points[:, JOINT_INDEX[f"{joint}_{side}"]] for joint in ("knee", "ankle", "foot"))
        ways.append(toes_ahead(foot - ankle, ankle - knee))
    return np.sum(ways, axis=0)


def _repeated(names: Sequence[str]) -> tuple[str, ...]:
    """Return a note on names that several joints have."""
    repeated = [name for name, times in Counter(filter(None, names)).items() if times > 1]
    return (
        (f"Several joints are named {', '.join(repeated)[:100]}. The first of each name is used.",) if repeated else ()
    )
