"""BVH: a hierarchy of joints and their motion, as text.

`capture.formats.bvh_parser` parses the text. Joint positions follow by forward kinematics: position = parent's position
+ parent's rotation · translation, rotation = parent's rotation · own rotation. A joint's own rotation is the product of
its rotations about the axes, in the order of its channels. `capture.formats.bvh_names` maps names to the 20 joints.

A file may have several ROOTs. Each ROOT whose joints have the names of a human body is one performer; others, such as
props, are skipped. If only all ROOTs together have these names, they are one performer.

BVH defines no sensor, no unit and no up axis. Up is the axis along which the median head is above the ankles. The unit
is the common unit in which the body has a human's height. `ReadOptions` can set both. The whole motion is then moved:
in the first frame, the performer faces the sensor, with the hips 2.5 m in front of it.
"""

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.formats._clips import build_clip
from capture.formats.bvh_names import kinect_positions
from capture.formats.bvh_parser import MAX_NUMBER, Node, parse
from capture.formats.options import ReadOptions
from capture.orientations import unknown
from capture.rest_frames import in_place, resting_frames
from capture.skeleton import JOINT_INDEX, LOST, TRACKED
from puppetline.errors import SkeletonLogError

HIP_DISTANCE_METRES = 2.5
"""Distance from the sensor to the hips in the first frame."""
METRES_PER_UNIT = {
    "metres": 1.0,
    "decimetres": 0.1,
    "CMU units of 1/0.45 inch": 0.0254 / 0.45,
    "inches": 0.0254,
    "centimetres": 0.01,
    "millimetres": 0.001,
}
"""Common units of length. They differ by more than the width of `STATURE_METRES`, 1.43, so at most one fits a body."""
STATURE_METRES = (1.4, 2.0)
"""Range of a performer's height in which a common unit is accepted."""
DEFAULT_STATURE_METRES = 1.7
STATURE_PER_BONE_LENGTH = 1.15
"""Ratio of stature to the length of the bones from the centre of the head to the ankle, which is above the sole."""


def matches(head: bytes) -> bool:
    """Return whether a file's head begins with the keyword of every BVH."""
    return head.removeprefix(b"\xef\xbb\xbf").upper().split(maxsplit=1)[:1] == [b"HIERARCHY"]


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip per ROOT that is a human body, with user numbers from 0.

    `options.up` and `options.unit` replace the detected values; `options.fps` is used if the frame time is invalid.

    Raises
    ------
    SkeletonLogError
        A line violates the format, there is no motion, neither the file nor `options` has a frame rate, or the joints
        do not have the names of a human body.
    """
    nodes, motion, frame_time, notes = parse(path, options.fps)
    times = frame_time * np.arange(len(motion), dtype=np.float64)
    if (motion == motion[0]).all():
        notes = ("All frames are equal; the recording is a pose without motion.", *notes)
    bodies, prop_notes = _bodies(path, nodes, *forward_kinematics(nodes, motion))
    return [
        replace(_clip(path, times, body, options, (*notes, *prop_notes, *body.notes)), user=user)
        for user, body in enumerate(bodies)
    ]


class _Body(NamedTuple):
    """A human body in a file: positions (T, 20, 3), rotations (T, 3, 3) of the joints that have them, and notes."""

    positions: NDArray[np.float64]
    rotations: dict[str, NDArray[np.float64]]
    notes: list[str]


def _bodies(
    path: Path, nodes: list[Node], positions: list[NDArray[np.float64]], rotations: list[NDArray[np.float64]]
) -> tuple[list[_Body], list[str]]:
    """Return the human bodies among the skeletons of a file, and notes on the skeletons that are skipped."""
    roots = [index for index, node in enumerate(nodes) if node.parent < 0]
    bodies, notes = [], []
    if len(roots) > 1:
        for start, end in pairwise([*roots, len(nodes)]):
            tree = [(node.name, max(node.parent - start, -1)) for node in nodes[start:end]]
            try:
                bodies.append(_body(path, tree, positions[start:end], rotations[start:end]))
            except SkeletonLogError:
                notes.append(f"The skeleton of ROOT {nodes[start].name} has no human joint names. It is omitted.")
    if bodies:
        return bodies, notes
    return [_body(path, [(node.name, node.parent) for node in nodes], positions, rotations)], []


def _body(
    path: Path, tree: list[tuple[str, int]], positions: list[NDArray[np.float64]], rotations: list[NDArray[np.float64]]
) -> _Body:
    """Select the 20 joints of a skeleton, and note names that several joints have."""
    points, chosen, notes = kinect_positions(path, tree, positions)
    repeated = [name for name, times in Counter(name for name, _ in tree if name).items() if times > 1]
    if repeated:
        notes.append(f"Several joints are named {', '.join(repeated)[:100]}. The first of each name is used.")
    return _Body(points, {name: rotations[node] for name, node in chosen.items()}, notes)


def _clip(
    path: Path, times: NDArray[np.float64], body: _Body, options: ReadOptions, notes: tuple[str, ...]
) -> SkeletonClip:
    """Convert a body to metres and move it in front of the sensor."""
    points = body.positions
    stature = _stature(path, points)
    up, up_note = _up(points, options)
    unit, unit_note = _unit(stature, options)
    facing_note = f"The performer faces the sensor in the first frame, {HIP_DISTANCE_METRES:g} m in front of it."
    confidence = np.where(np.isnan(points[..., 0]), LOST, TRACKED).astype(np.float32)
    first = resting_frames(times, unit * points, confidence)
    axes = _sensor_axes(path, points[first:], up)
    hips = np.array([0.0, 0.0, HIP_DISTANCE_METRES])
    positions = unit * (points - points[first, JOINT_INDEX["hip_center"]]) @ axes.T + hips
    orientations = unknown((len(times),))
    for name, rotations in body.rotations.items():
        orientations[:, JOINT_INDEX[name]] = Rotation.from_matrix(axes @ rotations).as_quat()[:, [3, 0, 1, 2]]
    notes = (unit_note, up_note, facing_note, *notes)
    moving = slice(first, None)
    clip = build_clip(path, "bvh", times[moving], positions[moving], confidence[moving], notes, orientations[moving])
    if first == 0:
        return clip
    rest_note = "The recording begins with a rest pose elsewhere, which is omitted and serves as the calibration pose."
    rest = in_place(positions[0], positions[moving])
    return replace(clip, rest=rest, notes=(*clip.notes, rest_note))


def forward_kinematics(
    nodes: list[Node], motion: NDArray[np.float64]
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Compute the position and rotation of every node in every frame.

    Parameters
    ----------
    nodes : list of Node
        Parents precede children.
    motion : (T, C) float64
        Numbers of all channels of all nodes in order; file units and degrees.

    Returns
    -------
    positions : list of (T, 3) float64
        One array per node, in file units and file coordinates.
    rotations : list of (T, 3, 3) float64
        One array per node, from the node's axes to file coordinates.
    """
    positions: list[NDArray[np.float64]] = []
    rotations: list[NDArray[np.float64]] = []
    column = 0
    for node in nodes:
        values = motion[:, column : column + len(node.channels)].T
        column += len(node.channels)
        translation = _translation(node, values)
        turns = [(axis, value) for (axis, kind), value in zip(node.channels, values, strict=True) if kind == "rotation"]
        rotation = np.broadcast_to(np.eye(3), (len(motion), 3, 3))
        if turns:
            order, angles = "".join(axis for axis, _ in turns), np.stack([value for _, value in turns], axis=1)
            rotation = Rotation.from_euler(order, angles, degrees=True).as_matrix()
        if node.parent < 0:
            positions.append(translation)
            rotations.append(rotation)
        else:
            parent = rotations[node.parent]
            positions.append(positions[node.parent] + (parent @ translation[..., None])[..., 0])
            rotations.append(parent @ rotation)
    return positions, rotations


def _translation(node: Node, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (T, 3) translation of a node from its parent.

    In some programs position channels replace the offset, in others they are added to it. Values that replace the
    offset stay near it, because a joint does not move away from its parent; values that are added stay near zero.
    """
    axes = ["XYZ".index(axis) for axis, kind in node.channels if kind == "position"]
    channels = [value for (_, kind), value in zip(node.channels, values, strict=True) if kind == "position"]
    translation = np.tile(node.offset, (values.shape[1], 1))
    if axes:
        values_of_axes = np.stack(channels, axis=1)
        median = np.median(values_of_axes, axis=0)
        is_added = np.linalg.norm(median) < np.linalg.norm(median - node.offset[axes])
        translation[:, axes] = values_of_axes + node.offset[axes] if is_added else values_of_axes
    return translation


def _up(points: NDArray[np.float64], options: ReadOptions) -> tuple[NDArray[np.float64], str]:
    """Return the unit vector that points up, and the note on it."""
    if options.up is not None:
        return np.eye(3)["xyz".index(options.up)], f"Up is {options.up}, as given."
    ankles = (points[:, JOINT_INDEX["ankle_left"]] + points[:, JOINT_INDEX["ankle_right"]]) / 2
    body = np.median(points[:, JOINT_INDEX["head"]] - ankles, axis=0)
    axis = int(np.abs(body).argmax())
    sign = 1.0 if body[axis] > 0 else -1.0
    name = f"{'−' if sign < 0 else ''}{'xyz'[axis]}"
    return sign * np.eye(3)[axis], f"Up is assumed to be {name}, the direction from feet to head."


def _unit(stature: float, options: ReadOptions) -> tuple[float, str]:
    """Return the metres per unit of the file, and the note on them."""
    if options.unit is not None:
        return options.unit, f"One unit is {options.unit:g} m, as given."
    for name, unit in METRES_PER_UNIT.items():
        if STATURE_METRES[0] <= stature * unit <= STATURE_METRES[1]:
            return unit, f"Lengths are assumed to be {name}; the body is then {stature * unit:.2f} m tall."
    unit = DEFAULT_STATURE_METRES / stature
    scaled = f"It is scaled to {DEFAULT_STATURE_METRES:g} m, {unit:.4g} m per unit."
    return unit, f"The body has a human's height in no common unit. {scaled}"


def _stature(path: Path, points: NDArray[np.float64]) -> float:
    """Return the body's height in file units, from the lengths of bones, which do not depend on the pose."""
    chain = ("head", "shoulder_center", "spine", "hip_center"), ("hip_right", "knee_right", "ankle_right")
    bones = [
        np.linalg.norm(points[:, JOINT_INDEX[one]] - points[:, JOINT_INDEX[other]], axis=1)
        for part in chain
        for one, other in pairwise(part)
    ]
    stature = STATURE_PER_BONE_LENGTH * float(np.median(np.sum(bones, axis=0)))
    if stature < 1 / MAX_NUMBER:
        raise SkeletonLogError(
            path,
            found="a body without size",
            expected="bones with a length",
            fix="Export the motion again with the offsets of its skeleton.",
        )
    return stature


def _sensor_axes(path: Path, points: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes (3, 3) of sensor coordinates in file coordinates, for a performer who first faces the sensor."""
    first = {name: points[0, index] for name, index in JOINT_INDEX.items()}
    across = first["hip_right"] - first["hip_left"] + first["shoulder_right"] - first["shoulder_left"]
    right = across - up * (across @ up)
    if np.linalg.norm(right) < 0.1 * np.linalg.norm(across) or not np.any(across):
        raise SkeletonLogError(
            path,
            found="a first frame in which the left-to-right line of hips and shoulders points up",
            expected="a performer who stands or sits upright",
            fix="Set the axis that points up (y or z), or delete the first frames.",
        )
    right = right / np.linalg.norm(right)
    return np.stack([right, up, np.cross(right, up)])
