"""CAD-60, one line per frame between commas: frame number and 15 joints of NiTE in millimetres; last a line ``END``.

Eleven joints have an orientation (9 numbers and a confidence) before their position (3 and a confidence). The hands and
feet have only a position. A line has 171 numbers. A joint at 0 0 0 is lost; a joint of confidence 0 is inferred.
"""

from pathlib import Path

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._clips import build_clip, frame_rate
from capture.formats._rows import RowLayout, read_lines
from capture.formats.layouts import CAD60, synthesise_missing, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, LOST, TRACKED

_ORIENTATION_COLUMNS = frozenset(1 + 14 * joint + column for joint in range(11) for column in range(10))
_ROW = RowLayout(
    171, "frame number, 11 joints of 14 numbers, 4 joints of 4", separator=",", unused=_ORIENTATION_COLUMNS
)
_POSITION_COLUMNS = np.array([1 + 14 * joint + 10 for joint in range(11)] + [155 + 4 * joint for joint in range(4)])


matches = _ROW.fits_first_line
"""Return whether the first line has 171 numbers between commas."""


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read the one performer; `options.fps` replaces the 30 Hz at which frames are numbered.

    `capture.formats.layouts.synthesise_missing` adds the joints that the format lacks.

    Raises
    ------
    SkeletonLogError
        A line violates the format, or no frame is tracked.
    """
    lines = read_lines(path)
    fps, notes = frame_rate(options, 30.0)
    if lines and lines[-1][1].strip() == "END":
        lines.pop()
    else:
        notes = (*notes, "The recording has no END line; frames after its last line may be missing.")
    lines, cut_off = _ROW.complete(lines)
    rows = _ROW.table(path, lines)
    positions = rows[:, _POSITION_COLUMNS[:, None] + np.arange(3)] / 1000
    confidence = rows[:, _POSITION_COLUMNS + 3].clip(INFERRED, TRACKED).astype(np.float32)
    confidence[(positions == 0).all(axis=2)] = LOST
    positions, confidence = synthesise_missing(*to_kinect20(CAD60, positions, confidence))
    notes = (
        *notes,
        *cut_off,
        "The format has no hip centre, wrists and ankles. They are placed between their neighbours.",
        "The format does not define the direction of x. The motion may be mirrored.",
    )
    return [build_clip(path, "cad60", rows[:, 0] / fps, positions, confidence, notes)]
