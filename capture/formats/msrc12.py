"""MSRC-12 gestures: a line a frame, microseconds and 20 × (x y z flag) in metres between spaces.

Flag 1 is tracked and 0 inferred; a joint at 0 0 0 is lost, and while nobody is tracked all of them are.
"""

from pathlib import Path

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of
from capture.formats._rows import RowLayout, confidence_of, head_lines, read_lines
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, TRACKED

_ROW = RowLayout(81, "microseconds, then 20 × x y z flag")


def matches(head: bytes) -> bool:
    """Tell whether the first line has 81 numbers between white space."""
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
    joints = rows[:, 1:].reshape(-1, 20, 4)
    confidence = confidence_of(path, lines, joints[..., 3], (INFERRED, TRACKED))
    return [clip_of(path, "msrc12", rows[:, 0] / 1e6, joints[..., :3], confidence, cut)]
