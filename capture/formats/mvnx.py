"""MVNX of Xsens: positions and orientations of 23 segments, as XML. z points up, lengths are metres."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.formats._documents import load, values_of
from capture.formats._rows import is_number
from capture.formats.clips import refuse_too_many
from capture.formats.options import ReadOptions
from capture.formats.skeleton_motion import SkeletonMotion, clips_of
from puppetline.errors import SkeletonLogError

_LEG, _ARM = ("UpperLeg", "LowerLeg", "Foot", "Toe"), ("Shoulder", "UpperArm", "Forearm", "Hand")
SEGMENTS = (
    *("Pelvis", "L5", "L3", "T12", "T8", "Neck", "Head"),
    *(f"{side}{part}" for chain in (_ARM, _LEG) for side in ("Right", "Left") for part in chain),
)
"""Names of the segments in the order in which files have them, if a file does not name them."""

DEFAULT_FPS = 60.0
"""Frames per second of a file that states neither times nor a rate."""


def matches(head: bytes) -> bool:
    """Return whether a file's head is XML with the root element of MVNX."""
    return b"<mvnx" in head or (b"<frames" in head and b"segmentCount" in head)


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip; `options.fps` replaces the file's times.

    Raises
    ------
    SkeletonLogError
        The file is damaged, has document types or entities, or has no frames.
    """
    document = load(path, ("position", "orientation"))
    segments = [each["label"] for each in values_of(document, "segment") if isinstance(each, dict) and "label" in each]
    names = segments or list(SEGMENTS)
    count = len(names)
    frames = [
        (
            each.get("type", "normal"),
            _numbers(each.get("position")),
            _numbers(each.get("orientation")),
            each.get("time"),
        )
        for each in values_of(document, "frame")
        if isinstance(each, dict)
    ]
    frames = [each for each in frames if len(each[1]) == 3 * count and len(each[2]) == 4 * count]
    moving = [each for each in frames if each[0] == "normal"]
    if not moving or set(SEGMENTS[:7]) - set(names):
        raise SkeletonLogError(
            path,
            found=f"{len(moving)} frames of {count} segments",
            expected="frames with the position and orientation of each segment",
            fix="Export the file again, with positions and orientations.",
        )
    refuse_too_many(path, len(moving), count)
    positions = np.array([each[1] for each in moving]).reshape(len(moving), count, 3)
    turns = np.array([each[2] for each in moving]).reshape(-1, 4)
    lengths = np.linalg.norm(turns, axis=1, keepdims=True)
    turns = np.where(lengths > 0, turns, [1.0, 0.0, 0.0, 0.0])
    rotations = Rotation.from_quat(turns[:, [1, 2, 3, 0]]).as_matrix().reshape(len(moving), count, 3, 3)
    rest = np.array(next((each[1] for each in frames if each[0] != "normal"), moving[0][1])).reshape(count, 3)
    rates = [rate for rate in values_of(document, "frameRate") if isinstance(rate, float) and rate > 0]
    fps = options.fps or next(iter(rates), DEFAULT_FPS)
    times = np.array([each[3] if isinstance(each[3], float) else np.nan for each in moving]) / 1000
    if options.fps is not None or np.isnan(times).any() or (np.diff(times) <= 0).any():
        times = np.arange(len(moving)) / fps
    parents = [names.index(parent) if (parent := _parent(name)) in names else -1 for name in names]
    motion = SkeletonMotion(names, parents, rest, list(positions.swapaxes(0, 1)), list(rotations.swapaxes(0, 1)))
    return clips_of(path, "mvnx", times, motion, options)


def _parent(name: str) -> str:
    """Return the segment that a segment hangs on."""
    for side in ("Right", "Left"):
        for chain, root in ((_ARM, "T8"), (_LEG, "Pelvis")):
            if name.removeprefix(side) in chain and name != name.removeprefix(side):
                place = chain.index(name.removeprefix(side))
                return side + chain[place - 1] if place else root
    trunk = SEGMENTS[:7]
    return trunk[trunk.index(name) - 1] if name in trunk[1:] else ""


def _numbers(value: object) -> NDArray[np.float64]:
    """Return the numbers of a text; none of anything else."""
    words = value.split() if isinstance(value, str) else []
    return np.array(words, dtype=np.float64) if all(map(is_number, words)) else np.empty(0)
