"""Kinect v2 text that lists the tracked joints of each frame: milliseconds, positions, then rotations.

::

    3178718
    Pos 11
    0 0.069300 -0.644030 1.306038       joint (Kinect v2 number), x y z in metres; 11 of them
    Rot 11
    0 0.008109 0.994914 0.096044 -0.029243       joint, quaternion x y z w; 11 of them

A joint that is not listed is lost. A quaternion is the orientation of the bone that ends at the joint.
"""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats import _rows as rows
from capture.formats.clips import build_clip
from capture.formats.layouts import K25, orientations_to_kinect20, to_kinect20
from capture.formats.options import ReadOptions
from capture.orientations import move_to_bone_starts
from capture.skeleton import LOST, TRACKED

_START = re.compile(rb"(\xef\xbb\xbf)?\s*\d+\s*\nPos \d+\s*\n")
_TIME = rows.RowLayout(1, "milliseconds", frame=rows.WHOLE_FRAME)
_POSITION = rows.RowLayout(4, "joint x y z", frame=rows.WHOLE_FRAME)
_ROTATION = rows.RowLayout(5, "joint and a quaternion", frame=rows.WHOLE_FRAME, unused=range(1, 5))


def matches(head: bytes) -> bool:
    """Return whether the file begins with an integer and a line ``Pos n``."""
    return _START.match(head) is not None


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - the format has a clock and a unit
    """Read the one performer.

    Raises
    ------
    SkeletonLogError
        A line violates the format, the file ends within the first frame, or no frame is tracked.
    """
    lines = iter(rows.read_lines(path))
    frames: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] = []
    notes: tuple[str, ...] = ()
    for first_line in lines:
        try:
            frames.append(_frame(path, lines, first_line))
        except rows.CutOffError:
            if not frames:
                raise
            notes = (rows.cut_off_note(first_line),)
            break
    times = np.array([time for time, _, _ in frames])
    positions = np.array([joints for _, joints, _ in frames]).reshape(-1, len(K25), 3)
    quaternions = np.array([joints for _, _, joints in frames]).reshape(-1, len(K25), 4)[..., [3, 0, 1, 2]]
    confidence = np.where(np.isnan(positions).any(axis=2), LOST, TRACKED).astype(np.float32)
    positions, confidence = to_kinect20(K25, positions, confidence)
    orientations = move_to_bone_starts(orientations_to_kinect20(K25, quaternions))
    return [build_clip(path, "kinect_v2_sparse", times, positions, confidence, notes, orientations)]


def _frame(
    path: Path, lines: Iterator[rows.Line], frame: rows.Line
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the time in seconds, (25, 3) positions and (25, 4) quaternions of the frame that begins in a line."""
    time = _TIME.numbers(path, frame)[0] / 1000
    positions = _positions(path, _block(path, lines, frame, "Pos"))
    quaternions = np.full((len(K25), 4), np.nan)
    for number, *quaternion in _ROTATION.table(path, _block(path, lines, frame, "Rot")):
        if number in range(len(K25)):
            quaternions[int(number)] = quaternion
    return time, positions, quaternions


def _block(path: Path, lines: Iterator[rows.Line], frame: rows.Line, name: str) -> list[rows.Line]:
    """Return the n lines after the header ``name n``."""
    expected = f"“{name} n” and n lines, n at most {len(K25)}"
    header = next(lines, None)
    if header is None:
        raise rows.cut_off_error(path, frame, f"the end of the file before “{name}”", expected)
    announced = re.fullmatch(rf"{name} (\d\d?)", header[1].strip())
    if announced is None or int(announced[1]) > len(K25):
        if not header[1].endswith("\n"):
            raise rows.cut_off_error(path, frame, f"the end of the file in “{header[1][:40]}”", expected)
        raise rows.line_error(path, header, f"“{header[1].strip()[:40]}”", expected, rows.WHOLE_FRAME)
    block = list(islice(lines, int(announced[1])))
    if len(block) < int(announced[1]):
        raise rows.cut_off_error(path, frame, f"the end of the file after {len(block)} lines of “{name}”", expected)
    return block


def _positions(path: Path, lines: list[rows.Line]) -> NDArray[np.float64]:
    """Return the (25, 3) positions in a block, with NaN for joints that are not listed."""
    joints = np.full((len(K25), 3), np.nan)
    for line, (number, *position) in zip(lines, _POSITION.table(path, lines), strict=True):
        if number not in range(len(K25)) or not np.isnan(joints[int(number)]).all():
            expected = f"joints from 0 to {len(K25) - 1}, each once"
            raise rows.line_error(path, line, f"joint {number:g}", expected, rows.WHOLE_FRAME)
        joints[int(number)] = position
    return joints
