"""Text files as rows of numbers, with errors that name the line."""

from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.surfaces.surface import damaged, outside
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
    return text.replace("\r\n", "\n").replace("\r", "\n")


class Rows:
    """Lines of one kind.

    Parameters
    ----------
    path : Path
    expected : str
        What an error message says should stand in such a line.

    Attributes
    ----------
    texts : list of str
    lines : list of int
        The number of each text's line, from 1.
    """

    def __init__(self, path: Path, expected: str) -> None:
        self.path = path
        self.expected = expected
        self.texts: list[str] = []
        self.lines: list[int] = []

    def __len__(self) -> int:
        return len(self.texts)

    def add(self, line: int, text: str) -> None:
        """Append a row."""
        self.texts.append(text)
        self.lines.append(line)

    def error(self, row: int, found: str | None = None) -> MeshError:
        """Make the error for a row, which quotes it unless something else is said to be `found`."""
        text = self.texts[row].strip()
        quoted = repr(text if len(text) <= 60 else f"{text[:60]}…")
        return damaged(at(self.path, line=self.lines[row]), found or quoted, self.expected)

    def refuse(self, wrong: NDArray[np.bool_], found: str | None = None) -> None:
        """Raise the error for the first of the (n,) rows that is marked, if any is."""
        if wrong.any():
            raise self.error(int(np.argmax(wrong)), found)

    def numbers(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Read all rows.

        Returns
        -------
        values : (m,) float64
            All numbers, one row's after another's.
        widths : (n,) int64
            How many each row has.

        Raises
        ------
        MeshError
            With the first line that holds something else.
        """
        fields = [text.split() for text in self.texts]
        try:
            values = _floats(list(chain.from_iterable(fields)))
        except ValueError:
            raise self.error(next(row for row, parts in enumerate(fields) if not _are_floats(parts))) from None
        return values, np.fromiter(map(len, fields), np.int64, len(fields))

    def table(self, least: int) -> NDArray[np.float64]:
        """Read rows of at least `least` numbers as (n, k) float64; k is the length of the shortest row."""
        values, widths = self.numbers()
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


def _floats(fields: Sequence[str]) -> NDArray[np.float64]:
    if "_" in " ".join(fields):
        raise ValueError("Python's 1_000 is no number in a file")
    return np.array(list(map(float, fields)), dtype=np.float64)


def _are_floats(fields: Sequence[str]) -> bool:
    try:
        _floats(fields)
    except ValueError:
        return False
    return True


def spans(starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices start, start + 1, …, start + length − 1 of all spans, one after another."""
    before = np.cumsum(lengths) - lengths
    return np.repeat(starts - before, lengths) + np.arange(int(lengths.sum()))
