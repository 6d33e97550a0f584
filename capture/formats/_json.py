"""JSON recordings: bounded loading, and values that are checked when they are read and name their place in errors.

Programs also write a document per line, and what Python prints, such as ``{'head': (0.1, nan, None)}``.
"""

import json
import math
import re
from pathlib import Path
from typing import NoReturn

from capture.formats._files import opened
from puppetline.errors import SkeletonLogError, at

MAX_FILE_BYTES = 256 * 2**20
"""Maximum size of a file: half an hour of the most verbose format. Python's objects take ten times as much memory."""

MAX_NUMBER = 1e9
"""Bound of the magnitude of a number: larger than any coordinate, small enough that calculations do not overflow."""

MAX_EXACT_FLOAT = 2.0**53
"""Bound of the floats that are read as integers: float64 represents every integer below it."""


_NUMPY = re.compile(r"(?:\w+\.)?(?:array|float\d+|int\d+)\(([^()]*?)(?:,\s*dtype=[\w.]+)?\)")
_PRINTED = str.maketrans("()'", '[]"')
_PRINTED_WORDS = {"None": "null", "nan": "NaN", "inf": "Infinity", "True": "true", "False": "false"}


def load(path: Path) -> "Value":
    """Parse a whole JSON file, or one document per line; NaN and Infinity, which stand for what is lost, are NaN.

    Raises
    ------
    SkeletonLogError
        The file cannot be read, is too large, not UTF-8, not JSON, or nested too deeply.
    """
    with opened(path) as file:
        text = file.read(MAX_FILE_BYTES + 1)
    if len(text) > MAX_FILE_BYTES:
        raise SkeletonLogError(
            path,
            found=f"more than {MAX_FILE_BYTES} bytes of JSON",
            expected="a smaller recording",
            fix="Split the recording.",
        )
    try:
        return Value(path, _parse(text))
    except json.JSONDecodeError as error:
        if documents := _documents(text.decode("utf-8-sig", errors="replace")):
            return Value(path, documents[0] if len(documents) == 1 else documents)
        raise SkeletonLogError(
            at(path, error.lineno),
            found=f"broken JSON at column {error.colno} ({error.msg})",
            expected="a complete JSON document",
            fix="The file may be incomplete or edited; copy it again from where it was recorded.",
        ) from error
    except (ValueError, RecursionError) as error:  # not UTF-8, a number of thousands of digits, too many brackets
        raise SkeletonLogError(
            path,
            found=f"JSON that cannot be parsed ({error})",
            expected="UTF-8 text with plain numbers and shallow nesting",
            fix="Copy the file again from where it was recorded.",
        ) from error


def _parse(text: str | bytes) -> object:
    return json.loads(text, parse_constant=lambda _: math.nan)


def _documents(text: str) -> list[object]:
    """Return the documents on the lines of a text, as JSON or as Python prints them; the last line may be cut off."""
    documents: list[object] = []
    lines = [line.rstrip(" ,") for line in text.splitlines() if line.strip()]
    for line in lines:
        try:
            documents.append(_parse(line))
            continue
        except json.JSONDecodeError:
            numbers = _NUMPY.sub(r"\1", _NUMPY.sub(r"\1", line))  # arrays of numbers
            printed = re.sub(r"\b(None|nan|inf|True|False)\b", lambda word: _PRINTED_WORDS[word[0]], numbers)
        try:
            documents.append(_parse(printed.translate(_PRINTED)))
        except json.JSONDecodeError:
            return documents if line is lines[-1] else []
    return documents


class Value:
    """A value of the document and its place, which errors name.

    Parameters
    ----------
    path : Path
        The file.
    data : object
        The value as parsed by `json`.
    place : str
        Path of the value in the document, for example ``frames[3].bodies[0]``.
    """

    def __init__(self, path: Path, data: object, place: str = "") -> None:
        self.path = path
        self.data = data
        self.place = place

    def __contains__(self, key: str) -> bool:
        return isinstance(self.data, dict) and key in self.data

    def __getitem__(self, key: str) -> "Value":
        if not isinstance(self.data, dict):
            self.refuse("an object {…}")
        place = f"{self.place}.{key}".lstrip(".")
        if key not in self.data:
            raise self.error(f"no {key!r}", f"a value for {place}")
        return Value(self.path, self.data[key], place)

    def items(self) -> list["Value"]:
        """Return the elements of a list."""
        if not isinstance(self.data, list):
            self.refuse("a list […]")
        return [Value(self.path, data, f"{self.place}[{index}]") for index, data in enumerate(self.data)]

    def number(self) -> float:
        """Return a finite number; true and false are refused."""
        if type(self.data) not in (int, float) or not -MAX_NUMBER < self.data < MAX_NUMBER:  # type: ignore[operator]
            self.refuse("a number of ordinary size")
        return float(self.data)  # type: ignore[arg-type]

    def numbers(self, count: int) -> list[float]:
        """Return a list of exactly `count` numbers."""
        items = self.items()
        if len(items) != count:
            raise self.error(f"{len(items)} numbers", f"{count}")
        return [item.number() for item in items]

    def integer(self) -> int:
        """Return an integer from 0 to 2⁶³−1.

        A float without a fraction is accepted below 2⁵³, and so is a string of digits, as recorders write 64-bit ids.
        """
        data = self.data
        if isinstance(data, float) and data.is_integer() and abs(data) < MAX_EXACT_FLOAT:
            data = int(data)
        if isinstance(data, str) and re.fullmatch("[0-9]{1,19}", data):
            data = int(data)
        if type(data) is not int or not 0 <= data < 2**63:
            self.refuse("an integer, 0 or more")
        return data

    def error(self, found: str, expected: str) -> SkeletonLogError:
        """Return an error that names this value's place."""
        return SkeletonLogError(
            at(self.path, field=self.place or "the document's top level"),
            found=found,
            expected=expected,
            fix="The file may be damaged or written by another program; export it again.",
        )

    def refuse(self, expected: str) -> NoReturn:
        """Raise the error for a value of another kind."""
        if isinstance(self.data, dict | list):
            found = f"{'an object' if isinstance(self.data, dict) else 'a list'} of {len(self.data)}"
        else:
            found = json.dumps(self.data)
        raise self.error(found if len(found) <= 40 else f"{found[:40]}…", expected)
