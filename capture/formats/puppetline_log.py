"""The project's own recordings (`capture.recording`), whole or cut off by a crash.

A line that was torn in mid-write is left out, with a note. Any other line that does not fit is an error.
"""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.events import Cue, Event, Lost, Tick
from capture.formats._performers import clips_by_performer
from capture.formats.options import ReadOptions
from capture.recording import VERSION
from capture.skeleton import JOINTS, LOST, SkeletonFrame
from puppetline.errors import SkeletonLogError, at

_MAGIC = b'{"puppetline": "skeleton log"'
_EARLIER = b'{"beginning": {'  # the second line of takes of an earlier version
_FIX = "Mend or remove this line."


def matches(head: bytes) -> bool:
    """Tell whether the first line begins as a recording's does."""
    return head.startswith(_MAGIC)


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - a recording says all of it itself
    """Read a recording's frames.

    Raises
    ------
    SkeletonLogError
        The file cannot be opened, a line is complete but wrong, or no complete frame shows a performer.
    """
    torn: list[int] = []
    frames = [event for event in _contents(path, torn) if isinstance(event, SkeletonFrame)]
    return clips_by_performer(path, "puppetline", frames, _notes(torn))


def is_of_an_earlier_version(path: Path) -> bool:
    """Return whether a take begins with the state of a stage of an earlier version, which is ignored.

    Raises
    ------
    SkeletonLogError
        The file cannot be read.
    """
    with _opened(path) as file:
        return any(line.startswith(_EARLIER) for line in islice(file, 1, 2))


def events(path: Path) -> Iterator[Event]:
    """Go through a recording's events, equal to those that were written, reading as it goes.

    Raises
    ------
    SkeletonLogError
        When it comes to it: the file cannot be read, or a line is complete but wrong.
    """
    return _contents(path, [])


def _contents(path: Path, torn: list[int]) -> Iterator[Event]:
    """Go through the events after the header; note the torn lines."""
    with _opened(path) as file:
        for number, raw in enumerate(file, 1):
            if not raw.endswith((b"}\n", b"}\r\n")):
                torn.append(number)
            elif number == 1:
                _check_header(path, _json(path, number, raw))
            elif number > 2 or not raw.startswith(_EARLIER):
                yield _event(path, number, _json(path, number, raw))


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise SkeletonLogError(
            path, found=f"“{error.strerror}”", expected="a readable file", fix="Check its path and permissions."
        ) from error


def _notes(torn: list[int]) -> tuple[str, ...]:
    if not torn:
        return ()
    if len(torn) == 1:
        return (f"Line {torn[0]} was cut off in mid-write: left out.",)
    return (f"{len(torn)} lines, the first of them line {torn[0]}, were cut off in mid-write: left out.",)


def _json(path: Path, number: int, line: bytes) -> dict[str, Any]:
    try:
        value = json.loads(line)
    except (ValueError, RecursionError) as error:  # ValueError is also what bytes that are not UTF-8 raise
        raise SkeletonLogError(
            at(path, number), found=f"a line that is not JSON ({error})", expected="one JSON object", fix=_FIX
        ) from error
    return value  # an object: nothing else in JSON ends in }


def _check_header(path: Path, header: dict[str, Any]) -> None:
    if header.get("version") not in range(1, VERSION + 1):
        raise SkeletonLogError(
            at(path, 1, "version"),
            found=_shown(header.get("version")),
            expected=f"1 to {VERSION}",
            fix="Read it with the version of Puppetline that wrote it, or a newer one.",
        )
    if header.get("joints") != list(JOINTS):
        raise _wrong(path, 1, "joints", header.get("joints"), "the 20 joint names from hip_center to foot_right")


def _event(path: Path, number: int, line: dict[str, Any]) -> Event:
    time = line.get("t")
    if not _is_number(time):
        raise _wrong(path, number, "t", time, "seconds, a finite number")
    time = float(line["t"])
    if "lost" in line:
        return Lost(time, _whole_number(path, number, "lost", line))
    if "tick" in line:
        return Tick(time)
    if "do" in line:
        if not isinstance(line["do"], str):
            raise _wrong(path, number, "do", line["do"], "what was asked for, a text")
        return Cue(time, line["do"], _object(path, number, "arguments", line))
    return _frame(path, number, time, line)


def _frame(path: Path, number: int, time: float, line: dict[str, Any]) -> SkeletonFrame:
    user = _whole_number(path, number, "user", line)
    places, trusts = (_of_joints(path, number, key, line.get(key)) for key in ("p", "c"))
    for joint, trust in enumerate(trusts):
        if not (_is_number(trust) and 0 <= trust <= 1):
            raise _wrong(path, number, f"c[{joint}]", trust, "a number from 0 to 1")
    confidence = np.array(trusts, dtype=np.float32)
    for joint, (place, trust) in enumerate(zip(places, confidence, strict=True)):
        if trust == LOST and place is not None:
            raise _wrong(path, number, f"p[{joint}]", place, "null, as its confidence is 0")
        if trust != LOST and not (isinstance(place, list) and len(place) == 3 and all(map(_is_number, place))):
            raise _wrong(path, number, f"p[{joint}]", place, "[x, y, z] in metres, as its confidence is not 0")
    positions = np.array([(np.nan,) * 3 if place is None else place for place in places], dtype=np.float64)
    return SkeletonFrame(time, user, positions, confidence, _orientations(path, number, line))


def _orientations(path: Path, number: int, line: dict[str, Any]) -> NDArray[np.float64] | None:
    if "o" not in line:
        return None
    turns = _of_joints(path, number, "o", line["o"])
    for joint, turn in enumerate(turns):
        if turn is not None and not (isinstance(turn, list) and len(turn) == 4 and all(map(_is_number, turn))):
            raise _wrong(path, number, f"o[{joint}]", turn, "[w, x, y, z] or null")
    return np.array([(np.nan,) * 4 if turn is None else turn for turn in turns], dtype=np.float64)


def _of_joints(path: Path, number: int, key: str, value: object) -> list[Any]:
    if not isinstance(value, list):
        raise _wrong(path, number, key, value, f"a list of {len(JOINTS)}")
    if len(value) != len(JOINTS):
        raise _wrong(path, number, key, f"a list of {len(value)}", f"a list of {len(JOINTS)}")
    return value


def _whole_number(path: Path, number: int, key: str, line: dict[str, Any]) -> int:
    value = line.get(key)
    if type(value) is not int:
        raise _wrong(path, number, key, value, "a whole number")
    return value


def _object(path: Path, number: int, key: str, line: dict[str, Any]) -> dict[str, Any]:
    value = line.get(key)
    if not isinstance(value, dict):
        raise _wrong(path, number, key, value, "a JSON object")
    return value


def _is_number(value: object) -> bool:
    """Tell a finite number (that float64 can hold) from all else that JSON has, true and false among it."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _wrong(path: Path, number: int, key: str, found: object, expected: str) -> SkeletonLogError:
    return SkeletonLogError(at(path, number, key), found=_shown(found), expected=expected, fix=_FIX)


def _shown(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else text[:57] + "…"
