"""JSON logs: loaded within bounds, each value checked where it is taken and named by its place in the document."""

import json
import re
from pathlib import Path
from typing import NoReturn

from puppetline.errors import SkeletonLogError, at

MAX_BYTES = 256 * 2**20
"""Half an hour of the wordiest log known; Python's objects take some ten times the file's size."""
MAX_NUMBER = 1e9
"""Beyond any coordinate or id that is not a string, and small enough that no arithmetic on it overflows."""

EXACT = 2.0**53
"""Up to here every whole number is a float64."""


def load(path: Path) -> "Value":
    """Parse a whole JSON file.

    Raises
    ------
    SkeletonLogError
        The file cannot be opened, is too large, not UTF-8, not JSON, nested too deeply or holds NaN or Infinity.
    """
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise SkeletonLogError(
            path, found=f"“{error.strerror}”", expected="a readable file", fix="Check its path and permissions."
        ) from error
    if len(text) > MAX_BYTES:
        raise SkeletonLogError(
            path, found=f"more than {MAX_BYTES} bytes of JSON", expected="at most that", fix="Split the recording."
        )

    def refuse_constant(name: str) -> NoReturn:
        raise SkeletonLogError(
            path,
            found=f"the number {name}",
            expected="finite numbers, as JSON has no others",
            fix="Record the take again, or leave out the joints that are not known.",
        )

    try:
        return Value(path, json.loads(text, parse_constant=refuse_constant))
    except json.JSONDecodeError as error:
        raise SkeletonLogError(
            at(path, error.lineno),
            found=f"broken JSON at column {error.colno} ({error.msg})",
            expected="a complete JSON document",
            fix="The file may be cut short or edited by hand; copy it again from where it was recorded.",
        ) from error
    except (ValueError, RecursionError) as error:  # not UTF-8, a number of thousands of digits, brackets without end
        raise SkeletonLogError(
            path,
            found=f"JSON that cannot be read ({error})",
            expected="UTF-8 text with plain numbers and shallow nesting",
            fix="Copy the file again from where it was recorded.",
        ) from error


class Value:
    """A value of the document together with its place, so that a complaint can name it.

    Parameters
    ----------
    path : Path
        The file.
    data : object
        What `json` made of the value.
    place : str
        Where it stands, as ``frames[3].bodies[0]``.
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
            raise self.error(f"no {key!r}", f"{place} to be there")
        return Value(self.path, self.data[key], place)

    def items(self) -> list["Value"]:
        """Return the elements of a list."""
        if not isinstance(self.data, list):
            self.refuse("a list […]")
        return [Value(self.path, data, f"{self.place}[{index}]") for index, data in enumerate(self.data)]

    def number(self) -> float:
        """Return a finite number; true and false are none."""
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
        """Return a whole number from 0 to 2⁶³−1.

        It may be written with a fraction of zero, as 1.0, where a float64 is exact, or as a string, as ids of 64 bits
        often are.
        """
        data = self.data
        if isinstance(data, float) and data.is_integer() and abs(data) < EXACT:
            data = int(data)
        if isinstance(data, str) and re.fullmatch("[0-9]{1,19}", data):
            data = int(data)
        if type(data) is not int or not 0 <= data < 2**63:
            self.refuse("a whole number, 0 or more")
        return data

    def error(self, found: str, expected: str) -> SkeletonLogError:
        """Return an error that names this value's place."""
        return SkeletonLogError(
            at(self.path, field=self.place or "the document's top level"),
            found=found,
            expected=expected,
            fix="The file may be damaged or of another program's making; export it again.",
        )

    def refuse(self, expected: str) -> NoReturn:
        """Raise the error for a value of the wrong kind."""
        if isinstance(self.data, dict | list):
            found = f"{'an object' if isinstance(self.data, dict) else 'a list'} of {len(self.data)}"
        else:
            found = json.dumps(self.data)
        raise self.error(found if len(found) <= 40 else f"{found[:40]}…", expected)
