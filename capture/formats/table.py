"""Tables of joint positions as text, whose columns are known by their names.

A table has a row per frame, with x, y and z of each joint (and perhaps its state) in columns or in one cell, or a row
per joint. Columns may be in any order, and any others beside them: `capture.formats._columns` tells what their names
mean, `capture.formats._cells` how a file is split. Without names, the number of columns tells the number of joints, and
`capture.formats.joint_sets` their order. `ReadOptions.columns` names the columns of tables that are none of these.

A position that is empty, NaN or 0 0 0 is lost. `capture.formats.positions` finds unit, axes and missing joints.
"""

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats import smpl
from capture.formats._cells import number
from capture.formats._columns import TABLE, Layout, without_prefix
from capture.formats._rows import read_lines, whole_lines
from capture.formats._table import EXPORT, UNNAMED, Table
from capture.formats.clips import DEFAULT_FPS, MAX_JOINTS, frame_rate
from capture.formats.joint_sets import UnclearOrderError, numbered
from capture.formats.options import ReadOptions
from capture.formats.positions import clip_of_positions
from capture.formats.proportions import refuse_rotations
from capture.skeleton import INFERRED, LOST, TRACKED
from puppetline.errors import SkeletonLogError

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

UNITS_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ticks": 1e7, "ns": 1e9}
"""Units of time in a second."""

ROWS_OF_KIND = 100
"""Number of rows by which four numbers of a joint are told to be rotations."""

EACH_ROW_SHARE = 0.5
"""Share of rows of a joint with times of their own from which these do not tell frames apart."""

MAX_FRAME_STEP = 7
"""Largest common step between numbers of frames; times in milliseconds have larger ones."""

_STATES = {"nottracked": LOST, "none": LOST, "false": LOST, "inferred": INFERRED, "low": INFERRED}
_STATES |= {"tracked": TRACKED, "medium": TRACKED, "high": TRACKED, "true": TRACKED}


class Performer(NamedTuple):
    """One performer: names (J), positions (T, J, 3), confidences (T, J), perhaps seconds (T), and notes."""

    names: Sequence[str]
    positions: Floats
    confidence: NDArray[np.float32]
    times: Floats | None
    notes: tuple[str, ...] = ()


def may_be(head: bytes) -> bool:
    """Return whether a file's head is text that is neither JSON nor XML."""
    is_marked = head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"{", b"<", b"[{", b"[["))
    return b"\0" not in head and not is_marked


def matches(head: bytes) -> bool:
    """Return whether a file's head is a table with the positions of a person's joints."""
    if not may_be(head):
        return False
    try:
        return Table(Path("table"), whole_lines(head), ReadOptions()).has_joints
    except UnclearOrderError:
        return True
    except SkeletonLogError:
        return False


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip per performer.

    Raises
    ------
    SkeletonLogError
        A row has too few or too many cells, a coordinate is no number, the joints are no person's or in no known order.
    """
    return clips_of(Table(path, read_lines(path, errors="replace"), options), "table")


def clips_of(table: Table, log_format: str) -> list[SkeletonClip]:
    """Return one clip per performer in a table; the errors are those of `read`."""
    if parameters := table.parameters:
        return [smpl.clip_of(table.path, log_format, parameters, table.options, table.notes)]
    found = [
        (user if len(table.layouts) == 1 else number, _performer(table, layout, rows))
        for number, layout in enumerate(table.layouts)
        for user, rows in _people(table, layout).items()
    ]
    present = [(user, performer) for user, performer in found if np.nan_to_num(performer.positions).any()]
    clips = []
    for user, performer in present or found[:1]:
        clip = clip_of_positions(
            table.path,
            log_format,
            performer.names,
            performer.positions,
            table.options,
            times=performer.times,
            confidence=performer.confidence,
            notes=(*table.notes, *performer.notes),
        )
        clips.append(replace(clip, user=user))
    return clips


def columns(path: Path, options: ReadOptions) -> dict[str, str]:
    """Return what each column of a table is taken for, by its name.

    Raises
    ------
    SkeletonLogError
        The file is no table of joint positions.
    """
    table = Table(path, read_lines(path, errors="replace"), options)
    meanings: dict[int, str] = {}
    for user, layout in enumerate(() if table.parameters else table.layouts):
        meanings |= {column: role for role, column in layout.fields.items()}
        whose = "" if len(table.layouts) == 1 else f"performer {user}: "
        for joint, own in layout.joints.items():
            for role, column in own.items():
                meanings[column] = whose + (role if joint.startswith(UNNAMED) else f"{joint} {role}")
    other = "parameter of the SMPL body" if table.parameters else "not used"
    return {table.column_name(column): meanings.get(column, other) for column in range(table.width)}


def confidence_of(states: Floats) -> NDArray[np.float32]:
    """Convert a recorder's states to confidences.

    States are 0 lost, 1 inferred and 2 (or more) tracked; if all are 0 or 1, 0 is inferred, because recorders write it
    for good positions too. Shares from 0 to 1 are inferred below one half. Other numbers say nothing.
    """
    known = states[np.isfinite(states)]
    if not len(known) or known.min() < 0 or known.max() > 3 or (known.max() > 1 and not _is_whole(known)):
        return np.full(states.shape, TRACKED, np.float32)
    if known.max() > 1:
        return np.array([LOST, INFERRED, TRACKED, TRACKED], np.float32)[np.nan_to_num(states).astype(int)]
    return np.where(states >= INFERRED, TRACKED, INFERRED).astype(np.float32)


def seconds_of(
    values: Floats, options: ReadOptions, units: Sequence[float] = (), *, counts: bool = False
) -> tuple[Floats | None, tuple[str, ...]]:
    """Convert times in any unit, or numbers of frames, to seconds.

    Parameters
    ----------
    values : (T,) float64
    options : ReadOptions
        `fps` is the rate at which frames are numbered, if it is known.
    units : sequence of float
        Possible numbers of units in a second; any, if there is none.
    counts : bool
        Whether they are numbers of frames.

    Returns
    -------
    times : (T,) float64 or None
        None if the values do not increase like times.
    notes : tuple of str
        That the rate is assumed.
    """
    steps = np.diff(values)
    steps = steps[steps > 0]
    if len(values) > 1 and len(steps) < len(values) / 4:
        return None, ()
    step = float(np.median(steps)) if len(steps) else 1.0
    if counts or (not units and _is_whole(values) and step <= MAX_FRAME_STEP):
        fps, notes = frame_rate(options, DEFAULT_FPS)
        return values / fps, notes
    unit = min(units or UNITS_PER_SECOND.values(), key=lambda count: abs(np.log(step / count * DEFAULT_FPS)))
    return values / unit, ()


def _people(table: Table, layout: Layout) -> dict[int, Rows]:
    """Return the rows of each person."""
    rows = np.arange(len(table.cells.rows))
    ids = table.texts(layout, "person")
    known = list(dict.fromkeys(each for each in ids if each))
    if len(known) <= 1:
        return {0: rows}
    numbers = [int(each) for each in known if each.isdecimal() and len(each) < 18]
    users = numbers if len(set(numbers)) == len(known) else range(len(known))
    return {user: rows[[own == each for own in ids]] for user, each in zip(users, known, strict=True)}


def _performer(table: Table, layout: Layout, rows: Rows) -> Performer:
    positions = np.stack([table.positions(own)[rows] for own in layout.joints.values()], axis=1)
    confidence = np.stack([_confidence(table, own)[rows] for own in layout.joints.values()], axis=1)
    if all("state" in own for own in layout.joints.values()):
        some = rows[:ROWS_OF_KIND]
        states = [[number(table.cells.rows[row][own["state"]]) for own in layout.joints.values()] for row in some]
        refuse_rotations(table.path, np.dstack([positions[: len(some)], np.array(states, dtype=np.float64)]))
    performer = Performer(list(layout.joints), positions, confidence, None)
    if performer.names[0].startswith(UNNAMED):
        if positions.shape[1] == 1:
            rows, performer = _with_a_row_per_joint(table, layout, rows, positions[:, 0], confidence[:, 0])
        else:
            own = [table.cells.rows[rows[0]][column] for role, column in layout.fields.items() if "joint" in role]
            is_named = len(own) == positions.shape[1]
            performer = performer._replace(
                names=own if is_named else [str(index) for index in range(len(performer.names))]
            )
    performer = performer._replace(names=without_prefix(performer.names))
    if all(name.isdecimal() for name in performer.names):
        numbers = [int(name) for name in performer.names]
        names, order = numbered(table.path, numbers, performer.positions, table.options.joints, "a table")
        performer = Performer(names, performer.positions[:, order], performer.confidence[:, order], None)
    times, notes = _times(table, layout, rows)
    return performer._replace(times=times, notes=notes)


def _confidence(table: Table, own: dict[str, int]) -> NDArray[np.float32]:
    if "state" not in own:
        return np.full(len(table.cells.rows), TRACKED, np.float32)
    texts = [row[own["state"]].lower().replace("_", "") for row in table.cells.rows]
    if any(text in _STATES for text in texts):
        return np.array([_STATES.get(text, TRACKED) for text in texts], np.float32)
    values = np.array([number(text) for text in texts], dtype=np.float64)
    is_inferred = "inferred" in table.column_name(own["state"]).lower()
    return confidence_of(1 - values / 2 if is_inferred else values)


def _with_a_row_per_joint(
    table: Table, layout: Layout, rows: Rows, positions: Floats, confidence: NDArray[np.float32]
) -> tuple[Rows, Performer]:
    """Return the first rows of the frames, and the performer of whom each row has one joint.

    A frame ends where its number or time changes, or where a joint would repeat.
    """
    texts = {role: table.texts(layout, role) for role in ("joint", "frame", "time")}
    joints = [texts["joint"][row] for row in rows] if texts["joint"] else [""] * len(rows)
    keys = [tuple(texts[role][row] for role in ("frame", "time") if texts[role]) for row in rows]
    if texts["joint"] and len(set(keys)) > EACH_ROW_SHARE * len(keys):  # the moments of joints, not of frames
        keys = [()] * len(rows)
    if not (texts["joint"] or keys[0]):
        count = table.joints_per_frame(layout)
        joints = [str(index % count) for index in range(len(rows))]
    starts: list[int] = []
    names: list[str] = []
    seen: set[str] = set()
    for index, (key, joint) in enumerate(zip(keys, joints, strict=True)):
        if index == 0 or key != keys[index - 1] or joint in seen:
            starts.append(index)
            seen = set()
        names.append(joint or str(len(seen)))
        seen.add(names[-1])
    distinct = list(dict.fromkeys(names))
    if len(distinct) == 1:
        table.refuse("a table with the positions of a single point", EXPORT)
    if len(distinct) > MAX_JOINTS:
        table.refuse(f"rows of {len(distinct)} joints, more than the {MAX_JOINTS} of any skeleton")
    place = {name: index for index, name in enumerate(distinct)}
    frame = np.searchsorted(starts, np.arange(len(rows)), side="right") - 1
    joint_of_row = np.array([place[name] for name in names])
    points = np.full((len(starts), len(distinct), 3), np.nan)
    sure = np.zeros(points.shape[:2], np.float32)
    points[frame, joint_of_row], sure[frame, joint_of_row] = positions, confidence
    return rows[starts], Performer(distinct, points, sure, None)


def _times(table: Table, layout: Layout, rows: Rows) -> tuple[Floats | None, tuple[str, ...]]:
    """Return the seconds of rows, None without a column that tells them, and notes."""
    for role in ("time", "frame"):
        texts = table.texts(layout, role)
        values = moments([texts[row] for row in rows]) if texts else None
        if values is not None:
            name = table.column_name(layout.fields[role]).lower()
            words = name.translate(str.maketrans("_()[]", "     ")).split()
            units = [UNITS_PER_SECOND[unit] for unit, own in TABLE["units"].items() if set(own.split()) & set(words)]
            times, notes = seconds_of(values, table.options, units, counts=role == "frame")
            if times is not None:
                return times, notes
    return None, ()


def _is_whole(values: Floats) -> bool:
    return bool((values == np.round(values)).all())


def moments(texts: Sequence[str]) -> Floats | None:
    """Return the numbers, or the seconds between dates or times of day, in texts; None if they are neither."""
    values = [number(text) for text in texts]
    if None not in values:
        found = np.array(values, dtype=np.float64)
        return found if np.isfinite(found).all() else None
    try:
        stamps = list(map(_stamp, texts))
        return np.array([(stamp - stamps[0]).total_seconds() for stamp in stamps])
    except (ValueError, TypeError):
        return None


def _stamp(text: str) -> datetime:
    """Return the moment that a date, a time of day, or a duration such as ``0 days 00:00:40.129`` tells."""
    days, _, clock = text.rpartition("days ")
    return datetime.fromisoformat(clock if "-" in clock else f"2000-01-01T{clock}") + timedelta(days=int(days or 0))
