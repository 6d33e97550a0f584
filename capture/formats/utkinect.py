"""UTKinect-Action3D and similar recorders, one line per frame: frame number and 20 × (x y z) in metres, without flags.

Frames are numbered at the sensor's rate and written only while a performer is tracked, so gaps between numbers are gaps
in time. A joint at 0 0 0 is lost.
"""

from pathlib import Path

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._clips import build_clip, frame_rate
from capture.formats._rows import RowLayout, read_lines
from capture.formats.options import ReadOptions
from capture.skeleton import TRACKED

_ROW = RowLayout(61, "frame number, then 20 × x y z")


matches = _ROW.fits_first_line
"""Return whether the first line has 61 numbers between white space."""


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read the one performer; `options.fps` replaces the 30 Hz at which frames are numbered.

    Raises
    ------
    SkeletonLogError
        A line violates the format, or no frame is tracked.
    """
    lines, cut_off = _ROW.complete(read_lines(path))
    rows = _ROW.table(path, lines)
    fps, notes = frame_rate(options, 30.0)
    positions = rows[:, 1:].reshape(-1, 20, 3)
    confidence = np.full(positions.shape[:2], TRACKED, dtype=np.float32)
    return [build_clip(path, "utkinect", rows[:, 0] / fps, positions, confidence, notes + cut_off)]
