"""MSRC-12 gestures, one line per frame: microseconds and 20 × (x y z flag) in metres between spaces.

Flag 1 is tracked and 0 inferred. A joint at 0 0 0 is lost; without a performer, all joints are at 0 0 0.
"""

from pathlib import Path

from capture.clip import SkeletonClip
from capture.formats._clips import build_clip
from capture.formats._rows import RowLayout, confidence_from_states, read_lines
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, TRACKED

_ROW = RowLayout(81, "microseconds, then 20 × x y z flag")


matches = _ROW.fits_first_line
"""Return whether the first line has 81 numbers between white space."""


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - the format has a clock and a unit
    """Read the one performer.

    Raises
    ------
    SkeletonLogError
        A line violates the format, or no frame is tracked.
    """
    lines, notes = _ROW.complete(read_lines(path))
    rows = _ROW.table(path, lines)
    joints = rows[:, 1:].reshape(-1, 20, 4)
    confidence = confidence_from_states(path, lines, joints[..., 3], (INFERRED, TRACKED))
    return [build_clip(path, "msrc12", rows[:, 0] / 1e6, joints[..., :3], confidence, notes)]
