"""TRC of Motion Analysis, OpenSim and Pose2Sim: the positions of named markers or joints, in columns."""

from pathlib import Path

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._rows import head_lines, line_error, read_lines
from capture.formats.clips import refuse_too_many
from capture.formats.markers import clip_of_markers
from capture.formats.options import ReadOptions
from puppetline.errors import SkeletonLogError


def matches(head: bytes) -> bool:
    """Return whether a file's head begins with the keyword of every TRC."""
    return any(line.startswith("PathFileType") for line in head_lines(head, 1))


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip; `options.fps` replaces the file's times.

    Raises
    ------
    SkeletonLogError
        A line violates the format, or the markers are not those of a whole body.
    """
    lines = read_lines(path, errors="replace")
    separator = "\t" if "\t" in "".join(text for _, text in lines[:4]) else ","
    header = next((k for k, (_, text) in enumerate(lines) if text.lower().startswith("frame#")), None)
    if header is None or len(lines) < header + 3:
        raise SkeletonLogError(
            path,
            found="no line with the names of markers, or no frames",
            expected="a line that begins with Frame# and Time, and frames after it",
            fix="Export the file again.",
        )
    names = [name.strip() for name in lines[header][1].rstrip("\r\n").split(separator)[2:] if name.strip()]
    first = header + 1 + (not _numbers(lines[header + 1][1], separator)[0].size)
    refuse_too_many(path, len(lines) - first, len(names))
    rows = []
    for number, text in lines[first:]:
        values, wrong = _numbers(text, separator)
        if wrong:
            raise line_error(path, (number, text), repr(wrong[:40]), "numbers")
        rows.append(np.concatenate([values, np.full(max(2 + 3 * len(names) - len(values), 0), np.nan)]))
    table = np.array([row[: 2 + 3 * len(names)] for row in rows])
    times = table[:, 1] if options.fps is None else np.arange(len(table)) / options.fps
    return [clip_of_markers(path, "trc", names, table[:, 2:].reshape(len(table), -1, 3), options, times=times)]


def _numbers(text: str, separator: str) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], str]:
    """Return the numbers of a line, NaN for empty fields, and the first field that is none."""
    values = []
    for field in text.rstrip("\r\n").split(separator):
        try:
            values.append(float(field) if field.strip() else np.nan)
        except ValueError:
            return np.empty(0), field
    return np.array(values), ""
