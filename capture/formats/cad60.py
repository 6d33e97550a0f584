"""CAD-60: a line a frame between commas, its number and the 15 joints of NiTE in millimetres, then a line ``END``.

Eleven joints have an orientation (9 numbers and a confidence) before their position (3 and a confidence), the hands and
feet a position only: 171 numbers. A joint at 0 0 0 is lost; one of confidence 0 is inferred.
"""

from pathlib import Path

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of, frame_rate
from capture.formats._rows import RowLayout, head_lines, read_lines
from capture.formats.layouts import CAD60, synthesise_missing, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, LOST, TRACKED

_ORIENTATIONS = [1 + 14 * joint + column for joint in range(11) for column in range(10)]
_ROW = RowLayout(
    171, "frame number, 11 joints of 14 numbers, 4 joints of 4", separator=",", unused=frozenset(_ORIENTATIONS)
)
_POSITION = np.array([1 + 14 * joint + 10 for joint in range(11)] + [155 + 4 * joint for joint in range(4)])


def matches(head: bytes) -> bool:
    """Tell whether the first line has 171 numbers between commas."""
    return any(map(_ROW.fits, head_lines(head, 1)))


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read a log; frames are numbered at 30 Hz unless `options.fps` says otherwise.

    Joints that the format lacks are synthesised as `capture.formats.layouts.synthesise_missing` describes.

    Raises
    ------
    SkeletonLogError
        A line does not fit, or no frame is tracked.
    """
    lines = read_lines(path)
    fps, notes = frame_rate(options, 30.0)
    if lines and lines[-1][1].strip() == "END":
        lines.pop()
    else:
        notes = (*notes, "The log has no END line: frames after its last line may be missing.")
    lines, cut = _ROW.whole(lines)
    rows = _ROW.table(path, lines)
    positions = rows[:, _POSITION[:, None] + np.arange(3)] / 1000
    confidence = rows[:, _POSITION + 3].clip(INFERRED, TRACKED).astype(np.float32)
    confidence[(positions == 0).all(axis=2)] = LOST
    ours = synthesise_missing(*to_kinect20(CAD60, positions, confidence))
    notes = (
        *notes,
        *cut,
        "Hip centre, wrists and ankles are not in this format: placed between their neighbours.",
        "The format does not say to which side x grows: the motion may be mirrored.",
    )
    return [clip_of(path, "cad60", rows[:, 0] / fps, *ours, notes)]
