"""Takes, the recordings in Puppetline's own format (`capture.recording`), complete or cut off by a crash.

An incomplete line is skipped, with a note. Any other line that violates the format is an error.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.events import Cue, Event, Lost, Tick
from capture.formats._files import opened
from capture.formats.clips import clips_by_performer
from capture.formats.options import ReadOptions
from capture.recording import VERSION
from capture.skeleton import JOINTS, LOST, SkeletonFrame
from puppetline.errors import SkeletonLogError, at

_MAGIC = b'{"puppetline": "skeleton log"'
_OLD_STATE = b'{"beginning": {'  # the second line of takes of an earlier version
_FIX = "Correct or delete this line."


def matches(head: bytes) -> bool:
    """Return whether the first line begins like that of a take."""
    return head.startswith(_MAGIC)


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:  # noqa: ARG001 - the format has a clock and a unit
    """Read one clip per user number; each has the cues of the whole take.

    Raises
    ------
    SkeletonLogError
        The file cannot be read, a complete line violates the format, or no complete frame shows a performer.
    """
    incomplete: list[int] = []
    frames, cues = [], []
    for event in _events(path, incomplete):
        if isinstance(event, SkeletonFrame):
            frames.append(event)
        elif isinstance(event, Cue):
            cues.append(event)
    clips = clips_by_performer(path, "puppetline", frames, _notes(incomplete))
    return [replace(clip, cues=tuple(cues)) for clip in clips]


def has_old_state(path: Path) -> bool:
    """Return whether a take begins with the state of a stage, as in an earlier version. The state is ignored.

    Raises
    ------
    SkeletonLogError
        The file cannot be read.
    """
    with opened(path) as file:
        return any(line.startswith(_OLD_STATE) for line in islice(file, 1, 2))


def events(path: Path) -> Iterator[Event]:
    """Yield a take's events, equal to those that were recorded, while reading the file.

    Raises
    ------
    SkeletonLogError
        During the iteration, if the file cannot be read or a complete line violates the format.
    """
    return _events(path, [])


def _events(path: Path, incomplete: list[int]) -> Iterator[Event]:
    """Yield the events after the header; append the numbers of incomplete lines."""
    with opened(path) as file:
        for number, raw in enumerate(file, 1):
            if not raw.endswith((b"}\n", b"}\r\n")):
                incomplete.append(number)
            elif number == 1:
                _check_header(path, _json(path, number, raw))
            elif number > 2 or not raw.startswith(_OLD_STATE):
                yield _event(path, number, _json(path, number, raw))


def _notes(incomplete: list[int]) -> tuple[str, ...]:
    if not incomplete:
        return ()
    if len(incomplete) == 1:
        return (f"Line {incomplete[0]} is incomplete and was skipped.",)
    return (f"{len(incomplete)} lines are incomplete and were skipped; the first is line {incomplete[0]}.",)


def _json(path: Path, number: int, line: bytes) -> dict[str, Any]:
    try:
        value = json.loads(line)
    except (ValueError, RecursionError) as error:  # bytes that are not UTF-8 raise a ValueError too
        raise SkeletonLogError(
            at(path, number), found=f"a line that is not JSON ({error})", expected="one JSON object", fix=_FIX
        ) from error
    return value  # always an object, because the line ends in }


def _check_header(path: Path, header: dict[str, Any]) -> None:
    if header.get("version") not in range(1, VERSION + 1):
        raise SkeletonLogError(
            at(path, 1, "version"),
            found=_shortened(header.get("version")),
            expected=f"1 to {VERSION}",
            fix="Use the version of Puppetline that recorded the take, or a newer one.",
        )
    if header.get("joints") != list(JOINTS):
        raise _value_error(path, 1, "joints", header.get("joints"), "the 20 joint names from hip_center to foot_right")


def _event(path: Path, number: int, line: dict[str, Any]) -> Event:
    time = line.get("t")
    if not _is_number(time):
        raise _value_error(path, number, "t", time, "seconds, a finite number")
    time = float(line["t"])
    if "lost" in line:
        return Lost(time, _integer(path, number, "lost", line), line.get("again") is True)
    if "tick" in line:
        return Tick(time)
    if "do" in line:
        if not isinstance(line["do"], str):
            raise _value_error(path, number, "do", line["do"], "the name of a command, a string")
        arguments = line.get("arguments")
        if not isinstance(arguments, dict):
            raise _value_error(path, number, "arguments", arguments, "a JSON object")
        return Cue(time, line["do"], arguments)
    return _frame(path, number, time, line)


def _frame(path: Path, number: int, time: float, line: dict[str, Any]) -> SkeletonFrame:
    user = _integer(path, number, "user", line)
    points, levels = (_joint_list(path, number, key, line.get(key)) for key in ("p", "c"))
    for joint, level in enumerate(levels):
        if not (_is_number(level) and 0 <= level <= 1):
            raise _value_error(path, number, f"c[{joint}]", level, "a number from 0 to 1")
    confidence = np.array(levels, dtype=np.float32)
    for joint, (point, level) in enumerate(zip(points, confidence, strict=True)):
        if level == LOST and point is not None:
            raise _value_error(path, number, f"p[{joint}]", point, "null, because its confidence is 0")
        if level != LOST and not _is_vector(point, 3):
            raise _value_error(
                path, number, f"p[{joint}]", point, "[x, y, z] in metres, because its confidence is not 0"
            )
    positions = np.array([(np.nan,) * 3 if point is None else point for point in points], dtype=np.float64)
    orientations, channels = _orientations(path, number, line), _channels(path, number, line)
    return SkeletonFrame(time, user, positions, confidence, orientations, channels)


def _channels(path: Path, number: int, line: dict[str, Any]) -> dict[str, float] | None:
    if "channels" not in line:
        return None
    values = line["channels"]
    if not (isinstance(values, dict) and all(_is_number(each) and 0 <= each <= 1 for each in values.values())):
        raise _value_error(path, number, "channels", values, "numbers from 0 to 1 by their names")
    return {name: float(value) for name, value in values.items()}


def _orientations(path: Path, number: int, line: dict[str, Any]) -> NDArray[np.float64] | None:
    if "o" not in line:
        return None
    quaternions = _joint_list(path, number, "o", line["o"])
    for joint, quaternion in enumerate(quaternions):
        if quaternion is not None and not _is_vector(quaternion, 4):
            raise _value_error(path, number, f"o[{joint}]", quaternion, "[w, x, y, z] or null")
    return np.array([(np.nan,) * 4 if value is None else value for value in quaternions], dtype=np.float64)


def _joint_list(path: Path, number: int, key: str, value: object) -> list[Any]:
    if not isinstance(value, list):
        raise _value_error(path, number, key, value, f"a list of {len(JOINTS)}")
    if len(value) != len(JOINTS):
        raise _value_error(path, number, key, f"a list of {len(value)}", f"a list of {len(JOINTS)}")
    return value


def _integer(path: Path, number: int, key: str, line: dict[str, Any]) -> int:
    value = line.get(key)
    if type(value) is not int:
        raise _value_error(path, number, key, value, "an integer")
    return value


def _is_vector(value: object, length: int) -> bool:
    return isinstance(value, list) and len(value) == length and all(map(_is_number, value))


def _is_number(value: Any) -> bool:
    """Return whether a JSON value is a number, not true or false, that is finite as a float64."""
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def _value_error(path: Path, number: int, key: str, found: object, expected: str) -> SkeletonLogError:
    return SkeletonLogError(at(path, number, key), found=_shortened(found), expected=expected, fix=_FIX)


def _shortened(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else text[:57] + "…"
