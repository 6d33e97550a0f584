"""Kinect v2 joints as CSV, one line per frame: 100 ns ticks, 25 × (x, y, z, state) in metres, often a trailing comma.

State 2 is tracked, 1 inferred and 0 not tracked.
"""

from pathlib import Path

from capture.clip import SkeletonClip
from capture.formats._clips import build_clip
from capture.formats._rows import RowLayout, confidence_from_states, read_lines
from capture.formats.layouts import K25, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, LOST, TRACKED

_ROW = RowLayout(101, "100 ns ticks, then 25 × x, y, z, state", separator=",")


matches = _ROW.fits_first_line
"""Return whether the first line has 101 numbers between commas."""


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - the format has a clock and a unit
    """Read the one performer.

    Raises
    ------
    SkeletonLogError
        A line violates the format, or no frame is tracked.
    """
    lines, notes = _ROW.complete(read_lines(path))
    rows = _ROW.table(path, lines)
    joints = rows[:, 1:].reshape(-1, 25, 4)
    confidence = confidence_from_states(path, lines, joints[..., 3], (LOST, INFERRED, TRACKED))
    positions, confidence = to_kinect20(K25, joints[..., :3], confidence)
    return [build_clip(path, "kinect_v2_csv", rows[:, 0] / 1e7, positions, confidence, notes)]
