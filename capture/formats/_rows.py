"""Text logs as lines of numbers, with errors that name the line and the column."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from puppetline.errors import SkeletonLogError, at

Line = tuple[int, str]
"""A line's number, from 1, and its text with the newline that ends it; only a file's last line may lack the newline."""

THIS_LINE = "this line"
WHOLE_FRAME = "all lines of this frame"
"""What to delete where a frame has several lines: without one of them, the others would shift."""


class CutOffError(SkeletonLogError):
    """The file ends within a frame, as a recorder leaves it that is killed or runs out of disk."""


@dataclass(frozen=True, slots=True)
class RowLayout:
    """What one line of a log holds.

    Attributes
    ----------
    columns : int
        Numbers in a line.
    meaning : str
        What they are, for error messages.
    separator : str or None
        What stands between them, and may stand after the last; None is any white space.
    frame : str
        What to delete when the line is bad and the log is to stay readable.
    unused : collection of int
        Columns, from 0, that are not used and may therefore be NaN or infinite.
    """

    columns: int
    meaning: str
    separator: str | None = None
    frame: str = THIS_LINE
    unused: Collection[int] = ()

    def split(self, text: str) -> list[str]:
        """Cut a line into its fields."""
        fields = [field.strip() for field in text.split(self.separator)]
        return fields[:-1] if fields and not fields[-1] else fields

    def fits(self, text: str) -> bool:
        """Tell whether a line has this many columns and nothing but numbers in them, NaN and infinity included."""
        fields = self.split(text)
        return len(fields) == self.columns and all(map(is_number, fields))

    def is_torn(self, line: Line) -> bool:
        """Tell whether the file ends within this line: after too few columns, or within the last number."""
        fields = self.split(line[1])
        is_short = len(fields) < self.columns or (len(fields) == self.columns and not is_number(fields[-1]))
        return is_short and not line[1].endswith("\n") and all(map(is_number, fields[:-1]))

    def whole(self, lines: list[Line]) -> tuple[list[Line], tuple[str, ...]]:
        """Leave out the last of several lines where the file ends within it, and return the note that says so."""
        if len(lines) > 1 and self.is_torn(lines[-1]):
            return lines[:-1], (f"The file ends in the middle of line {lines[-1][0]}. This frame is omitted.",)
        return lines, ()

    def numbers(self, path: Path, line: Line) -> list[float]:
        """Read a line.

        Raises
        ------
        CutOffError
            The file ends within the line.
        SkeletonLogError
            The number of columns is another, or a field is not a finite number.
        """
        number, text = line
        fields = self.split(text)
        if self.is_torn(line):
            raise CutOffError(
                at(path, number),
                found=f"the end of the file after {len(fields)} columns",
                expected=f"{self.columns} columns ({self.meaning})",
                fix=f"The file seems cut off: delete {self.frame}, or record again.",
            )
        if len(fields) != self.columns:
            expected = f"{self.columns} columns ({self.meaning})"
            raise bad_line(path, line, f"{len(fields)} columns", expected, self.frame)
        values = []
        for column, field in enumerate(fields, start=1):
            value = _number(field)
            if value is None or not (math.isfinite(value) or column - 1 in self.unused):
                found, expected = f"{field[:40]!r} in column {column}", f"a finite number ({self.meaning})"
                raise bad_line(path, line, found, expected, self.frame)
            values.append(value)
        return values

    def table(self, path: Path, lines: Sequence[Line]) -> NDArray[np.float64]:
        """Read lines into an array of (lines, columns); raises as `numbers` does."""
        table = np.empty((len(lines), self.columns))
        for row, line in zip(table, lines, strict=True):  # a list of an hour's numbers takes several times the memory
            row[:] = self.numbers(path, line)
        return table


def read_lines(path: Path) -> list[Line]:
    """Read the lines of a text file that are not blank.

    Parameters
    ----------
    path : Path
        UTF-8 text, with or without a byte order mark, any kind of newline.

    Returns
    -------
    list of (int, str)

    Raises
    ------
    SkeletonLogError
        The file cannot be opened or is not text.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            lines = [(number, text) for number, text in enumerate(file, start=1) if text.strip()]
    except OSError as error:
        raise SkeletonLogError(
            at(path), found=f"“{error.strerror}”", expected="a readable file", fix="Check its path and permissions."
        ) from error
    except UnicodeDecodeError as error:
        raise _not_text(at(path)) from error
    for number, text in lines:
        if "\0" in text:
            raise _not_text(at(path, number))
    return lines


def head_lines(head: bytes, count: int | None = None) -> list[str]:
    """Return the first lines of a file's head, or all, that are not blank; undecodable bytes show as U+FFFD."""
    lines = head.decode("utf-8-sig", errors="replace").splitlines()
    return [line for line in lines if line.strip()][:count]


class LineSource:
    """A file's lines, taken one after the other.

    Parameters
    ----------
    path : Path
        What error messages name.
    lines : iterable of Line
    """

    def __init__(self, path: Path, lines: Iterable[Line]) -> None:
        self.path = path
        self._lines = iter(lines)
        self._last = 0

    def __iter__(self) -> Iterator[Line]:
        for line in self._lines:
            self._last = line[0]
            yield line

    def take(self, expected: str) -> Line:
        """Return the next line.

        Parameters
        ----------
        expected : str
            What an error message says should stand there.

        Raises
        ------
        CutOffError
            No line is left.
        """
        line = next(self._lines, None)
        if line is None:
            raise CutOffError(
                at(self.path, self._last),
                found="the end of the file after this line",
                expected=expected,
                fix="The file seems cut off: copy it again from its source.",
            )
        self._last = line[0]
        return line


def bad_line(path: Path, line: Line, found: str, expected: str, frame: str = THIS_LINE) -> SkeletonLogError:
    """Make the error for a line that does not fit; `frame` as in `RowLayout`."""
    return SkeletonLogError(
        at(path, line[0]), found=found, expected=expected, fix=f"Correct it or delete {frame}, or record again."
    )


def cut_off(path: Path, frame: Line, found: str, expected: str) -> CutOffError:
    """Make the error for a file that ends within a frame of several lines; `frame` is the frame's first line."""
    return CutOffError(
        at(path, frame[0]),
        found=found,
        expected=expected,
        fix=f"The file seems cut off: delete line {frame[0]} and all after it, or record again.",
    )


def cut_note(frame: Line) -> str:
    """Say that a frame of several lines is left out because the file ends within it; `frame` is its first line."""
    return f"The file ends in the middle of the frame that begins in line {frame[0]}. This frame is omitted."


def count_note(stated: int, real: int) -> str:
    """Say that a log has another number of whole frames than it states."""
    return f"The stated frame count is {stated} and the real one is {real}. All whole frames are read."


def confidence_of(
    path: Path, lines: Sequence[Line], states: NDArray[np.float64], levels: Sequence[float]
) -> NDArray[np.float32]:
    """Turn a recorder's states, one line a frame, into confidences.

    Parameters
    ----------
    path, lines
        Where the states stand, for error messages; T lines.
    states : (T, J) float64
    levels : sequence of float
        The confidence that each of the states 0, 1, … means.

    Returns
    -------
    (T, J) float32

    Raises
    ------
    SkeletonLogError
        A state is none of these.
    """
    wrong = ~np.isin(states, range(len(levels)))
    if wrong.any():
        frame = int(wrong.any(axis=1).argmax())
        state = states[frame][wrong[frame]][0]
        raise bad_line(path, lines[frame], f"the joint state {state:g}", f"a state from 0 to {len(levels) - 1}")
    return np.array(levels, dtype=np.float32)[states.astype(np.intp)]


def is_number(field: str) -> bool:
    """Tell whether a field is a number, NaN and infinity included."""
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
        expected="lines of numbers in plain UTF-8",
        fix="Save or export the log as plain text, or record again.",
    )
