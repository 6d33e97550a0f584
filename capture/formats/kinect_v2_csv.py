"""Kinect v2 joints as CSV: a line a frame, 100 ns ticks and 25 × (x, y, z, state) in metres, often a trailing comma.

State 2 is tracked, 1 inferred and 0 not tracked.
"""

from pathlib import Path

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of
from capture.formats._rows import RowLayout, confidence_of, head_lines, read_lines
from capture.formats.layouts import K25, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, LOST, TRACKED

_ROW = RowLayout(101, "100 ns ticks, then 25 × x, y, z, state", separator=",")


def matches(head: bytes) -> bool:
    """Tell whether the first line has 101 numbers between commas."""
    return any(map(_ROW.fits, head_lines(head, 1)))


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - the format fixes everything
    """Read a log.

    Raises
    ------
    SkeletonLogError
        A line does not fit, or no frame is tracked.
    """
    lines, cut = _ROW.whole(read_lines(path))
    rows = _ROW.table(path, lines)
    joints = rows[:, 1:].reshape(-1, 25, 4)
    confidence = confidence_of(path, lines, joints[..., 3], (LOST, INFERRED, TRACKED))
    return [clip_of(path, "kinect_v2_csv", rows[:, 0] / 1e7, *to_kinect20(K25, joints[..., :3], confidence), cut)]
