"""JSON of Microsoft's `offline_processor`: 32 Azure Kinect joints in millimetres.

``{frames: [{timestamp_usec, bodies: [{body_id, joint_positions: 32 × [x, y, z], …}]}], joint_names, bone_list, …}``.
Some descendants add `joint_confidence`, 32 × 0 none, 1 low, 2 medium or 3 high, each bare or in a list of its own.

Positions are in the frame of the depth camera: x to the right of the camera's own view, y down, z forward. Someone who
faces the camera has the right hand in the left half of its view, at −x. The sensor frame has it at +x and y up:
(−x, −y, z), which is a half turn about z and so keeps left and right what they are. `joint_orientations` turn a
joint's axes to the same frame, 32 × [w, x, y, z], and may be missing; the bone that begins at a joint turns with them.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats._json import Value, load
from capture.formats._performers import clips_by_performer
from capture.formats.layouts import K32, orientations_to_kinect20, to_kinect20
from capture.formats.options import ReadOptions
from capture.orientations import turned
from capture.skeleton import INFERRED, LOST, TRACKED, SkeletonFrame

TO_SENSOR_FRAME = np.array([-1e-3, -1e-3, 1e-3])
CONFIDENCE = np.array([LOST, INFERRED, TRACKED, TRACKED], dtype=np.float32)
"""Of the levels none, low (the SDK's word for occluded and guessed), medium and high."""


def matches(head: bytes) -> bool:
    """Tell whether a file's head is such a document; the keys may come in any order."""
    keys = (b'"joint_positions"', b'"timestamp_usec"', b'"bone_list"')
    return (
        head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{")
        and b'"frames"' in head
        and any(key in head for key in keys)
    )


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - the log has its own clock and unit
    """Read every body, one clip for each body id.

    Parameters
    ----------
    path : Path
    options : ReadOptions
        Not used.

    Returns
    -------
    list of SkeletonClip

    Raises
    ------
    SkeletonLogError
        The document does not fit, a frame's `num_bodies` is not the number of its bodies, or nobody is tracked.
    """
    frames = [body for frame in load(path)["frames"].items() for body in _bodies(frame)]
    return clips_by_performer(path, "azure_json", frames)


def _bodies(frame: Value) -> list[SkeletonFrame]:
    time = frame["timestamp_usec"].integer() * 1e-6
    bodies = frame["bodies"].items()
    if "num_bodies" in frame and frame["num_bodies"].integer() != len(bodies):
        raise frame["num_bodies"].error(str(frame["num_bodies"].integer()), f"{len(bodies)}, the length of bodies")
    return [_body(body, time) for body in bodies]


def _body(body: Value, time: float) -> SkeletonFrame:
    joints = body["joint_positions"].items()
    if len(joints) != len(K32):
        raise body["joint_positions"].error(f"{len(joints)} joints", f"the {len(K32)} of the Azure Kinect")
    positions = np.array([joint.numbers(3) for joint in joints]) * TO_SENSOR_FRAME
    levels = _levels(body["joint_confidence"]) if "joint_confidence" in body else [2] * len(K32)
    turns = _turns(body["joint_orientations"]) if "joint_orientations" in body else None
    return SkeletonFrame(time, body["body_id"].integer(), *to_kinect20(K32, positions, CONFIDENCE[levels]), turns)


def _turns(orientations: Value) -> NDArray[np.float64]:
    """Return the orientations (20, 4), turned with the axes of the positions: half a turn about z."""
    joints = orientations.items()
    if len(joints) != len(K32):
        raise orientations.error(f"{len(joints)} joints", f"the {len(K32)} of the Azure Kinect")
    wxyz = np.array([joint.numbers(4) for joint in joints])
    return turned(orientations_to_kinect20(K32, wxyz), np.diag([-1.0, -1.0, 1.0]))


def _levels(confidence: Value) -> list[int]:
    values = [
        value.items()[0] if value.data and isinstance(value.data, list) else value for value in confidence.items()
    ]
    if len(values) != len(K32):
        raise confidence.error(f"{len(values)} values", f"{len(K32)}")
    levels = [value.integer() for value in values]
    for value, level in zip(values, levels, strict=True):
        if level >= len(CONFIDENCE):
            raise value.error(str(level), "0 none, 1 low, 2 medium or 3 high")
    return levels
