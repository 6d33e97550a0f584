"""JSON of Microsoft's `offline_processor`: 32 Azure Kinect joints in millimetres.

``{frames: [{timestamp_usec, bodies: [{body_id, joint_positions: 32 × [x, y, z], …}]}], joint_names, bone_list, …}``.
Some programs add `joint_confidence`, 32 × 0 none, 1 low, 2 medium or 3 high, each a number or a list of one number.

Positions are in the coordinates of the depth camera: x to the right in the camera's view, y down, z forward. The right
hand of a performer who faces the camera is in the left half of its view, at −x. Sensor coordinates have it at +x and y
up: (−x, −y, z). This is a half turn about z, which does not swap left and right. The optional `joint_orientations`,
32 × [w, x, y, z], rotate axes of the bone that begins at the joint to the same camera coordinates.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats._json import Value, load
from capture.formats.clips import clips_by_performer
from capture.formats.layouts import K32, orientations_to_kinect20, to_kinect20
from capture.formats.options import ReadOptions
from capture.orientations import rotated
from capture.skeleton import INFERRED, LOST, TRACKED, SkeletonFrame

TO_SENSOR_METRES = np.array([-1e-3, -1e-3, 1e-3])
CONFIDENCE = np.array([LOST, INFERRED, TRACKED, TRACKED], dtype=np.float32)
"""Confidence of the levels none, low (occluded and guessed, in the SDK's definition), medium and high."""


def matches(head: bytes) -> bool:
    """Return whether a file's head has the keys of this format, in any order."""
    keys = (b'"joint_positions"', b'"timestamp_usec"', b'"bone_list"')
    return (
        head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{")
        and b'"frames"' in head
        and any(key in head for key in keys)
    )


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - the format has a clock and a unit
    """Read one clip per body id.

    Raises
    ------
    SkeletonLogError
        The document violates the format, a frame's `num_bodies` is not the number of its bodies, or no performer is
        tracked.
    """
    frames = [body for frame in load(path)["frames"].items() for body in _bodies(frame)]
    return clips_by_performer(path, "azure_json", frames)


def _bodies(frame: Value) -> list[SkeletonFrame]:
    time = frame["timestamp_usec"].integer() * 1e-6
    bodies = frame["bodies"].items()
    if "num_bodies" in frame and frame["num_bodies"].integer() != len(bodies):
        raise frame["num_bodies"].error(str(frame["num_bodies"].integer()), f"the length of bodies, {len(bodies)}")
    return [_body(body, time) for body in bodies]


def _body(body: Value, time: float) -> SkeletonFrame:
    positions = _joints(body["joint_positions"], 3) * TO_SENSOR_METRES
    levels = _levels(body["joint_confidence"]) if "joint_confidence" in body else [2] * len(K32)
    orientations = None
    if "joint_orientations" in body:
        wxyz = _joints(body["joint_orientations"], 4)
        orientations = rotated(orientations_to_kinect20(K32, wxyz), np.diag([-1.0, -1.0, 1.0]))
    user = body["body_id"].integer()
    return SkeletonFrame(time, user, *to_kinect20(K32, positions, CONFIDENCE[levels]), orientations)


def _joints(value: Value, count: int) -> NDArray[np.float64]:
    """Return the numbers (32, count) of the joints."""
    joints = value.items()
    if len(joints) != len(K32):
        raise value.error(f"{len(joints)} joints", f"the {len(K32)} joints of the Azure Kinect")
    return np.array([joint.numbers(count) for joint in joints])


def _levels(confidence: Value) -> list[int]:
    values = [
        value.items()[0] if value.data and isinstance(value.data, list) else value for value in confidence.items()
    ]
    if len(values) != len(K32):
        raise confidence.error(f"{len(values)} values", f"{len(K32)} values")
    levels = [value.integer() for value in values]
    for value, level in zip(values, levels, strict=True):
        if level >= len(CONFIDENCE):
            raise value.error(str(level), "0 none, 1 low, 2 medium or 3 high")
    return levels
