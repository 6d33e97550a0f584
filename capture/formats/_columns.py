"""What the columns of a table are, by their names: time, frame, person, joint, and x, y, z and state of a joint."""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from capture.bone_names import is_known
from capture.formats._cells import Cells
from capture.formats.positions import is_person

MAX_NAMES = 600
"""Number of rows up to which these may be the coordinates of joints."""

AXES = ("x", "y", "z")
AXIS_NUMBERS = ("0", "1", "2"), ("1", "2", "3"), ("", "1", "2"), ("", "", "")
"""What three columns of a joint in a row may end in instead of x, y and z; pandas numbers names that repeat."""

_WORD = re.compile("[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")

TABLE = tomllib.loads(Path(__file__).with_name("table_words.toml").read_text(encoding="utf-8"))

WORDS: dict[str, frozenset[str]] = {kind: frozenset(words.split()) for kind, words in TABLE.items() if kind != "units"}


_ANGLE = re.compile("angle|flex|extension|duction|euler|quat|rotation|orientation|tilt", re.IGNORECASE)
ANGLES_SHARE = 1 / 3
"""Share of names with a word for rotations from which all values are such."""


class Column(NamedTuple):
    """What a column is.

    Attributes
    ----------
    role : str
        "x", "y", "z", "state", "time", "frame", "person", "joint", or "" for a column that is not used.
    joint : str
        Name of the joint whose coordinate or state it is; a number, or "" if the rows or their order tell.
    person : str
        Number of the performer whose joint it is, as in ``Body 2 Head X``; "" without one.
    """

    role: str
    joint: str = ""
    person: str = ""


@dataclass(frozen=True, slots=True)
class Layout:
    """What the columns of a table are.

    Attributes
    ----------
    joints : dict of str to dict
        Columns of a joint's "x", "y", "z" and "state" by its name; a column with several numbers is its "x" only.
    fields : dict of str to int
        Columns that are "time", "frame", "person" or "joint".
    """

    joints: dict[str, dict[str, int]]
    fields: dict[str, int]


def parse(names: Sequence[Sequence[str]]) -> list[Column]:
    """Return what the columns are whose header's cells are given, from top to bottom."""
    columns: list[Column] = []
    in_space: set[int] = set()
    for cells in names:
        words = [word for cell in cells for word in _words(cell)]
        is_numbered = len(words) > 2 and words[0] in WORDS["person"] and words[1].isdecimal()
        person, words = (words[1], words[2:]) if is_numbered else ("", words)
        in_space |= {len(columns)} if "world" in words else set()
        columns.append(_parse(words)._replace(person=person))
    better = {columns[index] for index in in_space}  # than those in the picture
    is_row = any(column.role == "x" and not column.joint for column in better)  # of one joint
    columns = [
        Column("")
        if (column in better and column.role and index not in in_space)
        or (is_row and column.role in AXES and column.joint)
        else column
        for index, column in enumerate(columns)
    ]
    placed = {column[1:] for column in columns if column.role in AXES}
    return [column if column.role != "state" or column[1:] in placed else Column("") for column in columns]


def with_numbers_as_axes(columns: Sequence[Column]) -> list[Column]:
    """Return the columns of which three in a row are the axes of a joint; none if these are not a person's joints."""
    split = [(re.sub("_?[0-9]+$", "", column.joint), column) for column in columns]
    found: list[Column] = []
    for joint, group in groupby(split, key=lambda each: (each[0], each[1].role, each[1].person)):
        own = [column for _, column in group]
        numbers = tuple(column.joint.removeprefix(joint[0]).lstrip("_") for column in own)
        is_joint = joint[0] and not joint[1] and numbers in AXIS_NUMBERS
        found += [Column(axis, joint[0], joint[2]) for axis in AXES] if is_joint else own
    return found if is_person([column.joint for column in found if column.role == "z"]) else []


def with_frames_in_rows(cells: Cells) -> Cells:
    """Return cells of which a row had the coordinates of a joint over time, after their name, with frames in rows."""
    names = [row[0] for row in cells.rows]
    if not is_person([column.joint for column in parse([[name] for name in names[:MAX_NAMES]]) if column.role == "z"]):
        return cells
    rows = [list(row) for row in zip(*(row[1:] for row in cells.rows), strict=True)]
    return replace(
        cells,
        names=[[name] for name in names],
        rows=rows,
        lines=cells.lines[:1] * len(rows),
        origin=[*range(len(names))],
    )


def without_prefix(names: Sequence[str]) -> list[str]:
    """Return the numbers that names consist of after the same word, as Landmark_0; other names as they are."""
    numbers = [re.sub("[A-Za-z_ ]*", "", name, count=1) for name in names]
    prefixes = {name.removesuffix(number) for name, number in zip(names, numbers, strict=True)}
    return numbers if len(prefixes) == 1 and all(number.isdecimal() for number in numbers) else list(names)


def of_angles(names: Sequence[str]) -> str:
    """Return that names are those of rotations, for messages about values without positions; "" if they are not."""
    count = sum(_ANGLE.search(name) is not None for name in names)
    return ": angles, which give no positions without their skeleton" if count > ANGLES_SHARE * len(names) else ""


def _words(cell: str) -> list[str]:
    words = [word.lower() for word in _WORD.findall(cell)]
    return [part for word in words for part in _without_axis(word)]


def _without_axis(word: str) -> tuple[str, ...]:
    """Split a letter x, y or z from the end or the beginning of a word that is known without it."""
    if len(word) > 1 and not is_known(word):
        for own, axis in ((word[:-1], word[-1]), (word[1:], word[0])):
            if axis in AXES and (is_known(own) or own in WORDS["filler"]):
                return (own, axis)
    return (word,)


def _parse(words: list[str]) -> Column:
    own = set(words)
    axes = [index for index, word in enumerate(words) if word in AXES]
    if own & WORDS["other"]:
        return Column("")
    if axes:
        return Column(words[axes[-1]], _joint(words[: axes[-1]] + words[axes[-1] + 1 :]))
    for kind in ("state", "short_state"):
        rest = [word for word in words if word not in WORDS[kind]]
        if len(rest) < len(words) and (_joint(rest) or kind == "state") and not set(rest) & WORDS["time"]:
            return Column("state", _joint(rest))
    if own & WORDS["time"] and not any(map(is_known, own - WORDS["time"])):
        return Column("time")
    for role in ("person", "joint"):
        if own & WORDS[role] and own <= WORDS[role] | WORDS["id"]:
            return Column(role)
    return Column("frame" if own <= WORDS["frame"] else "", _joint(words))


def _joint(words: Sequence[str]) -> str:
    return "_".join(word for word in words if word not in WORDS["filler"])
