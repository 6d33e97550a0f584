"""Kinect v2 as text that lists the tracked joints of each frame: milliseconds, positions, then rotations.

::

    3178718
    Pos 11
    0 0.069300 -0.644030 1.306038       joint (Kinect v2 number), x y z in metres; 11 of them
    Rot 11
    0 0.008109 0.994914 0.096044 -0.029243       joint, quaternion x y z w; 11 of them

A joint that is not listed is lost. Its quaternion turns with the bone that ends at it.
"""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of
from capture.formats._rows import (
    WHOLE_FRAME,
    CutOffError,
    Line,
    RowLayout,
    bad_line,
    cut_note,
    cut_off,
    read_lines,
)
from capture.formats.layouts import K25, orientations_to_kinect20, to_kinect20
from capture.formats.options import ReadOptions
from capture.orientations import of_bones_that_begin
from capture.skeleton import LOST, TRACKED

_START = re.compile(rb"(\xef\xbb\xbf)?\s*\d+\s*\nPos \d+\s*\n")
_TIME = RowLayout(1, "milliseconds", frame=WHOLE_FRAME)
_POSITION = RowLayout(4, "joint x y z", frame=WHOLE_FRAME)
_ROTATION = RowLayout(5, "joint and a quaternion", frame=WHOLE_FRAME, unused=range(1, 5))


def matches(head: bytes) -> bool:
    """Tell whether the file starts with an integer and a line ``Pos n``."""
    return _START.match(head) is not None


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - the format fixes everything
    """Read a log.

    Raises
    ------
    SkeletonLogError
        A line does not fit, the file ends within the first frame, or no frame is tracked.
    """
    lines = iter(read_lines(path))
    times: list[float] = []
    positions: list[NDArray[np.float64]] = []
    turns: list[NDArray[np.float64]] = []
    notes: tuple[str, ...] = ()
    for frame in lines:
        try:
            time, places, turned = _frame(path, lines, frame)
        except CutOffError:
            if not times:
                raise
            notes = (cut_note(frame),)
            break
        times.append(time)
        positions.append(places)
        turns.append(turned)
    joints = np.array(positions).reshape(-1, len(K25), 3)
    confidence = np.where(np.isnan(joints).any(axis=2), LOST, TRACKED).astype(np.float32)
    ours = to_kinect20(K25, joints, confidence)
    orientations = np.array(turns).reshape(-1, len(K25), 4)[..., [3, 0, 1, 2]]
    orientations = of_bones_that_begin(orientations_to_kinect20(K25, orientations))
    return [clip_of(path, "kinect_v2_sparse", np.array(times), *ours, notes, orientations)]


def _frame(path: Path, lines: Iterator[Line], frame: Line) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Read the frame that begins in a line: its time in seconds, its (25, 3) positions and (25, 4) quaternions."""
    time = _TIME.numbers(path, frame)[0] / 1000
    places = _joints(path, _block(path, lines, frame, "Pos"))
    turned = np.full((len(K25), 4), np.nan)
    for number, *quaternion in _ROTATION.table(path, _block(path, lines, frame, "Rot")):
        if number in range(len(K25)):
            turned[int(number)] = quaternion
    return time, places, turned


def _block(path: Path, lines: Iterator[Line], frame: Line, name: str) -> list[Line]:
    """Take the header ``name n`` and the n lines that it announces."""
    expected = f"“{name} n” and n lines, n at most {len(K25)}"
    header = next(lines, None)
    if header is None:
        raise cut_off(path, frame, f"the end of the file before “{name}”", expected)
    announced = re.fullmatch(rf"{name} (\d\d?)", header[1].strip())
    if announced is None or int(announced[1]) > len(K25):
        if not header[1].endswith("\n"):
            raise cut_off(path, frame, f"the end of the file in “{header[1][:40]}”", expected)
        raise bad_line(path, header, f"“{header[1].strip()[:40]}”", expected, WHOLE_FRAME)
    block = list(islice(lines, int(announced[1])))
    if len(block) < int(announced[1]):
        raise cut_off(path, frame, f"the end of the file after {len(block)} lines of “{name}”", expected)
    return block


def _joints(path: Path, lines: list[Line]) -> NDArray[np.float64]:
    """Return the (25, 3) positions that a block lists, NaN elsewhere."""
    joints = np.full((len(K25), 3), np.nan)
    for line, (number, *position) in zip(lines, _POSITION.table(path, lines), strict=True):
        if number not in range(len(K25)) or not np.isnan(joints[int(number)]).all():
            raise bad_line(path, line, f"joint {number:g}", f"joints from 0 to {len(K25) - 1}, each once", WHOLE_FRAME)
        joints[int(number)] = position
    return joints
