"""Text recordings as lines of numbers, with errors that name the line and the column."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.formats._files import HEAD_BYTES, opened
from puppetline.errors import SkeletonLogError, at

Line = tuple[int, str]
"""A line's number, from 1, and its text with its newline. Only the last line of a file may lack the newline."""

THIS_LINE = "this line"
WHOLE_FRAME = "all lines of this frame"
"""The lines to delete if a frame has several: without one of them, the others would be read as other joints."""


class CutOffError(SkeletonLogError):
    """The file ends within a frame, because the recorder was killed or the disk was full."""


@dataclass(frozen=True, slots=True)
class RowLayout:
    """The columns of one line of a recording.

    Attributes
    ----------
    columns : int
        Count of the numbers in a line.
    meaning : str
        Description of the columns, for error messages.
    separator : str or None
        Text between the numbers, also allowed after the last one; None stands for any white space.
    frame : str
        The lines that the error for a bad line tells the user to delete.
    unused : collection of int
        Columns, from 0, that are not used and may therefore be NaN or infinite.
    """

    columns: int
    meaning: str
    separator: str | None = None
    frame: str = THIS_LINE
    unused: Collection[int] = ()

    def split(self, text: str) -> list[str]:
        """Return the fields of a line."""
        fields = [field.strip() for field in text.split(self.separator)]
        return fields[:-1] if fields and not fields[-1] else fields

    def fits(self, text: str) -> bool:
        """Return whether a line has this many columns and all of them are numbers, NaN and infinity included."""
        fields = self.split(text)
        return len(fields) == self.columns and all(map(is_number, fields))

    def is_cut_off(self, line: Line) -> bool:
        """Return whether the file ends within this line: after too few columns, or within the last number."""
        fields = self.split(line[1])
        is_short = len(fields) < self.columns or (len(fields) == self.columns and not is_number(fields[-1]))
        return is_short and not line[1].endswith("\n") and all(map(is_number, fields[:-1]))

    def complete(self, lines: list[Line]) -> tuple[list[Line], tuple[str, ...]]:
        """Return the lines without the last one, and a note, if the file ends within the last of several lines."""
        if len(lines) > 1 and self.is_cut_off(lines[-1]):
            return lines[:-1], (f"The file ends in the middle of line {lines[-1][0]}. This frame is omitted.",)
        return lines, ()

    def numbers(self, path: Path, line: Line) -> list[float]:
        """Return the numbers of a line.

        Raises
        ------
        CutOffError
            The file ends within the line.
        SkeletonLogError
            The number of columns differs, or a field is not a finite number.
        """
        number, text = line
        fields = self.split(text)
        if self.is_cut_off(line):
            raise CutOffError(
                at(path, number),
                found=f"the end of the file after {len(fields)} columns",
                expected=f"{self.columns} columns ({self.meaning})",
                fix=f"The file seems incomplete. Delete {self.frame}, or record again.",
            )
        if len(fields) != self.columns:
            expected = f"{self.columns} columns ({self.meaning})"
            raise line_error(path, line, f"{len(fields)} columns", expected, self.frame)
        values = []
        for column, field in enumerate(fields, start=1):
            value = _number(field)
            if value is None or not (math.isfinite(value) or column - 1 in self.unused):
                found, expected = f"{field[:40]!r} in column {column}", f"a finite number ({self.meaning})"
                raise line_error(path, line, found, expected, self.frame)
            values.append(value)
        return values

    def table(self, path: Path, lines: Sequence[Line]) -> NDArray[np.float64]:
        """Return the numbers of several lines, an array (lines, columns); raises the errors of `numbers`."""
        table = np.empty((len(lines), self.columns))
        for row, line in zip(table, lines, strict=True):  # one list of all numbers would take several times the memory
            row[:] = self.numbers(path, line)
        return table


def read_lines(path: Path, errors: str = "strict") -> list[Line]:
    """Return the lines of a text file that are not blank.

    Parameters
    ----------
    path : Path
        UTF-8 text, with or without a byte order mark, with any kind of newline.
    errors : str
        What happens with other bytes, as for `open`: "replace" for formats with texts that do not matter.

    Raises
    ------
    SkeletonLogError
        The file cannot be read or is not text.
    """
    try:
        with opened(path) as file:
            text_lines = enumerate(TextIOWrapper(file, encoding="utf-8-sig", errors=errors), start=1)
            lines = [(number, text) for number, text in text_lines if text.strip()]
    except UnicodeDecodeError as error:
        raise _not_text(at(path)) from error
    for number, text in lines:
        if "\0" in text:
            raise _not_text(at(path, number))
    return lines


def head_lines(head: bytes, count: int | None = None) -> list[str]:
    """Return the first `count` lines, or all, that are not blank; bytes that are not text become U+FFFD."""
    lines = head.decode("utf-8-sig", errors="replace").splitlines()
    return [line for line in lines if line.strip()][:count]


def whole_lines(head: bytes) -> list[Line]:
    """Return the lines of a file's head that are not blank, without the last one if the file may be longer."""
    lines = [(number, f"{text}\n") for number, text in enumerate(head_lines(head), start=1)]
    if len(head) >= HEAD_BYTES:
        return lines[:-1] or lines
    if lines and not head.endswith((b"\n", b"\r")):
        lines[-1] = (lines[-1][0], lines[-1][1].rstrip("\n"))
    return lines


class LineSource:
    """A file's lines, taken one by one; errors name the last line that was taken."""

    def __init__(self, path: Path, lines: Iterable[Line]) -> None:
        self.path = path
        self._lines = iter(lines)
        self._last = 0

    def __iter__(self) -> Iterator[Line]:
        for line in self._lines:
            self._last = line[0]
            yield line

    @property
    def last(self) -> int:
        """Number of the last line that was taken."""
        return self._last

    def take(self, expected: str) -> Line:
        """Return the next line, which should hold what `expected` describes; raise `CutOffError` at the end."""
        line = next(self._lines, None)
        if line is None:
            raise CutOffError(
                at(self.path, self._last),
                found="the end of the file after this line",
                expected=expected,
                fix="The file seems incomplete. Copy it again from its source.",
            )
        self._last = line[0]
        return line


def line_error(path: Path, line: Line, found: str, expected: str, frame: str = THIS_LINE) -> SkeletonLogError:
    """Return the error for a line that violates the format; `frame` as in `RowLayout`."""
    return SkeletonLogError(
        at(path, line[0]), found=found, expected=expected, fix=f"Correct it or delete {frame}, or record again."
    )


def cut_off_error(path: Path, frame: Line, found: str, expected: str) -> CutOffError:
    """Return the error for a file that ends within a frame of several lines; `frame` is the frame's first line."""
    return CutOffError(
        at(path, frame[0]),
        found=found,
        expected=expected,
        fix=f"The file seems incomplete. Delete line {frame[0]} and all lines after it, or record again.",
    )


def cut_off_note(frame: Line) -> str:
    """Return the note on an omitted frame of several lines in which the file ends; `frame` is its first line."""
    return f"The file ends in the middle of the frame that begins in line {frame[0]}. This frame is omitted."


def count_note(stated: int, real: int) -> str:
    """Return the note on a recording whose number of complete frames differs from the stated one."""
    return f"The stated frame count is {stated} and the real one is {real}. All complete frames are read."


def confidence_from_states(
    path: Path, lines: Sequence[Line], states: NDArray[np.float64], levels: Sequence[float]
) -> NDArray[np.float32]:
    """Convert a recorder's joint states (T, J), one line each, to confidences (T, J): state k to `levels[k]`.

    Raises
    ------
    SkeletonLogError
        A state is not an index of `levels`; the error names the line.
    """
    wrong = ~np.isin(states, range(len(levels)))
    if wrong.any():
        frame = int(wrong.any(axis=1).argmax())
        state = states[frame][wrong[frame]][0]
        raise line_error(path, lines[frame], f"the joint state {state:g}", f"a state from 0 to {len(levels) - 1}")
    return np.array(levels, dtype=np.float32)[states.astype(np.intp)]


def is_number(field: str) -> bool:
    """Return whether a field is a number, NaN and infinity included."""
    return _number(field) is not None


def _number(field: str) -> float | None:
    try:
        return float(field)
    except ValueError:
        return None


def _not_text(where: str) -> SkeletonLogError:
    return SkeletonLogError(
        where,
        found="bytes that are not text",
        expected="lines of numbers in UTF-8",
        fix="Save or export the recording as plain text, or record again.",
    )
