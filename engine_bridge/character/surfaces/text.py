"""Text files as rows of numbers, with errors that name the line."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.scanning import find_lines, read_numbers
from engine_bridge.character.surfaces.surface import damaged, outside
from puppetline.errors import MeshError, at


def decoded(path: Path, content: bytes) -> str:
    r"""Return a text file's content with "\\n" for every kind of line end.

    Raises
    ------
    MeshError
        Zero bytes, which no text has.
    """
    zero = content.find(b"\0")
    if zero >= 0:
        line = content.count(b"\n", 0, zero) + 1
        raise damaged(at(path, line=line), "bytes that are not text", "a text file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:  # names in an old Windows encoding
        text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def word(text: str) -> np.uint64:
    """Return a word of at most 8 ASCII letters as `Lines.words` has it."""
    return np.uint64(int.from_bytes(text.encode("ascii"), "little"))


@dataclass(frozen=True)
class Lines:
    """The lines of a text that hold something besides space.

    Attributes
    ----------
    data : (b,) uint8
        The text in UTF-8.
    numbers : (n,) int64
        From 1.
    starts, rests : (n,) int64
        Where a line's first word is in `data`, and what comes after that.
    comments, ends : (n,) int64
        Where its first ``#`` is, or else its end, and its end.
    words : (n,) uint64
        The first words, see `word`; 0 for one of more than 8 bytes.
    """

    data: NDArray[np.uint8]
    numbers: NDArray[np.int64]
    starts: NDArray[np.int64]
    rests: NDArray[np.int64]
    comments: NDArray[np.int64]
    ends: NDArray[np.int64]
    words: NDArray[np.uint64]

    def __len__(self) -> int:
        return len(self.numbers)

    def only(self, which: NDArray[np.bool_]) -> "Lines":
        """Return some of the lines."""
        numbers, starts, rests, comments, ends = (
            column[which] for column in (self.numbers, self.starts, self.rests, self.comments, self.ends)
        )
        return Lines(self.data, numbers, starts, rests, comments, ends, self.words[which])

    def text(self, line: int) -> str:
        """Return a line from its first word on."""
        return self.data[self.starts[line] : self.ends[line]].tobytes().decode()


def lines_of(text: str, continued: str = "") -> Lines:
    """Find the lines of a text; where lines go on in the next, a character may stand for the line end in between."""
    data = np.frombuffer(text.encode(), np.uint8)
    most = np.count_nonzero(data == ord("\n")) + 1
    table, words = np.empty((5, most), dtype=np.int64), np.empty(most, dtype=np.uint64)
    count = find_lines(data, table, words)
    numbers, starts, rests, comments, ends = table[:, :count]
    if continued and continued in text:
        numbers += np.searchsorted(np.flatnonzero(data == ord(continued)), starts)
    return Lines(data, numbers, starts, rests, comments, ends, words[:count])


class Rows:
    """Lines of one kind.

    Parameters
    ----------
    path : Path
    expected : str
        What an error message says should stand in such a line.
    data : (b,) uint8
        See `Lines`.
    lines : (n,) int64
        The number of each row's line, from 1.
    starts, ends : (n,) int64
        Where the row is in `data`.
    """

    def __init__(
        self,
        path: Path,
        expected: str,
        data: NDArray[np.uint8],
        lines: NDArray[np.int64],
        starts: NDArray[np.int64],
        ends: NDArray[np.int64],
    ) -> None:
        self.path = path
        self.expected = expected
        self.data = data
        self.lines = lines
        self.starts = starts
        self.ends = ends

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def most(self) -> int:
        """How many numbers there can be at most: one every two bytes."""
        return int((self.ends - self.starts + 1).sum()) // 2 + len(self)

    def error(self, row: int, found: str | None = None) -> MeshError:
        """Make the error for a row, which quotes it unless something else is said to be `found`."""
        text = self._content(row).decode().strip()
        quoted = repr(text if len(text) <= 60 else f"{text[:60]}…")
        return damaged(at(self.path, line=int(self.lines[row])), found or quoted, self.expected)

    def refuse(self, wrong: NDArray[np.bool_], found: str | None = None) -> None:
        """Raise the error for the first of the (n,) rows that is marked, if any is."""
        if wrong.any():
            raise self.error(int(np.argmax(wrong)), found)

    @cached_property
    def numbers(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """All numbers (m,) float64, one row's after another's, and how many each row has (n,) int64.

        Raises
        ------
        MeshError
            With the first line that holds something else.
        """
        values = np.empty(self.most)
        widths, is_plain = np.empty(len(self), dtype=np.int64), np.empty(len(self), dtype=np.bool_)
        count = read_numbers(self.data, self.starts, self.ends, values, widths, is_plain)
        places = np.cumsum(widths) - widths
        for row in np.flatnonzero(~is_plain).tolist():
            values[places[row] : places[row] + widths[row]] = self._floats(row)
        return values[:count].copy(), widths

    def _floats(self, row: int) -> list[float]:
        """Read a row with numbers of many digits, or with none."""
        content = self._content(row)
        try:
            if b"_" in content:
                raise ValueError("Python's 1_000 is no number in a file")
            return list(map(float, content.split()))
        except ValueError:
            raise self.error(row) from None

    def _content(self, row: int) -> bytes:
        return self.data[self.starts[row] : self.ends[row]].tobytes()

    def table(self, least: int) -> NDArray[np.float64]:
        """Read rows of at least `least` numbers as (n, k) float64; k is the length of the shortest row."""
        values, widths = self.numbers
        self.refuse(widths < least)
        width = int(widths.min(initial=2**31)) if len(self) else least
        if len(values) != width * len(self):
            values = values[(np.cumsum(widths) - widths)[:, None] + np.arange(width)]
        return values.reshape(len(self), width)

    def positions(self) -> NDArray[np.float64]:
        """Read rows that begin with x, y, z as (n, 3 or more) float64, and refuse what is not finite."""
        table = self.table(3)
        self.refuse(outside(table[:, :3]))
        return table


def spans(starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices start, start + 1, …, start + length − 1 of all spans, one after another."""
    before = np.cumsum(lengths) - lengths
    return np.repeat(starts - before, lengths) + np.arange(int(lengths.sum()))
