"""UTKinect-Action3D and recorders that write alike: a line a frame, its number and 20 × (x y z) in metres, no flags.

Frames are numbered at the sensor's rate and written only while somebody is tracked, so gaps between numbers are gaps in
time. A joint at 0 0 0 is lost.
"""

from pathlib import Path

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of, frame_rate
from capture.formats._rows import RowLayout, head_lines, read_lines
from capture.formats.options import ReadOptions
from capture.skeleton import TRACKED

_ROW = RowLayout(61, "frame number, then 20 × x y z")


def matches(head: bytes) -> bool:
    """Tell whether the first line has 61 numbers between white space."""
    return any(map(_ROW.fits, head_lines(head, 1)))


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read a log; frames are numbered at 30 Hz unless `options.fps` says otherwise.

    Raises
    ------
    SkeletonLogError
        A line does not fit, or no frame is tracked.
    """
    lines, cut = _ROW.whole(read_lines(path))
    rows = _ROW.table(path, lines)
    fps, notes = frame_rate(options, 30.0)
    positions = rows[:, 1:].reshape(-1, 20, 3)
    confidence = np.full(positions.shape[:2], TRACKED, dtype=np.float32)
    return [clip_of(path, "utkinect", rows[:, 0] / fps, positions, confidence, notes + cut)]
