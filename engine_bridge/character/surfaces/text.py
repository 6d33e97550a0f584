"""Reads text files as rows of numbers, with errors that name the line."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.surface import damaged, outside
from puppetline.errors import MeshError, at


def decoded(path: Path, content: bytes) -> str:
    r"""Return a text file's content with "\\n" for every kind of line end.

    Raises
    ------
    MeshError
        The file has zero bytes.
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


def filled_lines(text: str) -> Iterator[tuple[int, str]]:
    """Return the number, from 1, and the stripped text of each line that is not blank."""
    return filter(itemgetter(1), enumerate(map(str.strip, text.split("\n")), 1))


def parsed(text: str, kind: type) -> NDArray[Any] | None:
    """Return numbers separated by spaces, or None for any other text."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # older versions of NumPy only warn about invalid text
        try:
            return np.fromstring(text, kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


@dataclass(frozen=True)
class Rows:
    """Lines with the same statement.

    Attributes
    ----------
    path : Path
    expected : str
        Contents of a valid line, for error messages.
    lines : list of int
        Number of each row's line, from 1.
    texts : list of str
    """

    path: Path
    expected: str
    lines: list[int] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.lines)

    def error(self, row: int, found: str | None = None) -> MeshError:
        """Return the error for a row, which quotes the row unless `found` is given."""
        text = self.texts[row].strip()
        quoted = repr(text if len(text) <= 60 else f"{text[:60]}…")
        return damaged(at(self.path, line=self.lines[row]), found or quoted, self.expected)

    def refuse(self, wrong: NDArray[np.bool_], found: str | None = None) -> None:
        """Raise the error for the first wrong row (n,), if any."""
        if wrong.any():
            raise self.error(int(np.argmax(wrong)), found)

    @cached_property
    def widths(self) -> NDArray[np.int64]:
        """Number of words (n,) int64 in each row."""
        return np.array(list(map(len, map(str.split, self.texts))), dtype=np.int64)

    @cached_property
    def numbers(self) -> NDArray[np.float64]:
        """All numbers (m,) float64, row by row.

        Raises
        ------
        MeshError
            A line has other text than numbers; the message has the first such line.
        """
        values = parsed(" ".join(self.texts), np.float64)
        if values is not None and len(values) == self.widths.sum():
            return values
        each = enumerate(parsed(text, np.float64) for text in self.texts)
        wrong = (row for row, own in each if own is None or len(own) != self.widths[row])
        raise self.error(next(wrong, 0))

    def table(self, least: int) -> NDArray[np.float64]:
        """Return rows of at least `least` numbers as (n, k) float64; k is the length of the shortest row."""
        numbers = self.numbers
        self.refuse(self.widths < least)
        width = int(self.widths.min(initial=2**31)) if len(self) else least
        return numbers[(np.cumsum(self.widths) - self.widths)[:, None] + np.arange(width)]

    def positions(self) -> NDArray[np.float64]:
        """Return rows that begin with x, y, z as (n, 3 or more) float64; refuse positions that are not finite."""
        table = self.table(3)
        self.refuse(outside(table[:, :3]))
        return table


def spans(starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices from start to start + length − 1 of all spans, one span after another."""
    before = np.cumsum(lengths) - lengths
    return np.repeat(starts - before, lengths) + np.arange(int(lengths.sum()))
