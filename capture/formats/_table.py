"""A text table's columns as a person's joints: by names, by a file of the user's, or by their number.

A TRC is a table whose names are those of three columns each; other numbers are above them.
"""

import itertools
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from capture.formats import smpl
from capture.formats._cells import PARTS, DecimalCommaError, UnevenError, number, split
from capture.formats._columns import (
    AXES,
    WORDS,
    Column,
    Layout,
    of_angles,
    parse,
    with_frames_in_rows,
    with_numbers_as_axes,
    without_prefix,
)
from capture.formats._rows import Line
from capture.formats.clips import with_stated_rate
from capture.formats.joint_order import COUNTS, names_by_shape
from capture.formats.joint_sets import MAX_MISFIT, Fit, as_of, clearest, fits, refuse_image
from capture.formats.layouts import HOLISTIC, JOINT_SETS
from capture.formats.options import ReadOptions
from capture.formats.positions import WHOLE_BODY, is_person, missing_joints, part_of_a_person
from capture.formats.skeleton_joints import BY_SHAPE_NOTE
from puppetline.errors import SkeletonLogError, at

Floats = NDArray[np.float64]

UNNAMED = "\0"
"""Beginning of the names of joints whose columns do not name them."""

MAX_LINES_ABOVE = 12
_VALUE = re.compile(r"\b([A-Za-z]+(?: [A-Za-z]+)?)[\s:=,;]+([0-9]+(?:\.[0-9]+)?)\b")
"""The name and number of a value in the lines above a table."""

MAX_EXTRA_COLUMNS = 3
"""Number of columns without a header that are no positions."""

EXPORT = "Export the motion as BVH, or the positions of the joints as a table (CSV)."
IN_SPACE = "Use the tracker's positions in space, or the video itself."
NAME_COLUMNS = "Name the columns in the first line, or those of each joint in a file: --columns FILE."
"""What to do with text that is no table, with positions in an image, and with columns that are not understood."""

ROWS = "a table, whose rows have numbers"
"""What was expected of text without such rows."""

WIDTHS = (3, 4, 7)
"""Numbers of a joint without a header: x y z, then a state or a quaternion."""

_PART = re.compile("((left|right)_)?(hand|face)_.*[0-9]$")
"""Landmarks of a hand or a face, which trackers number apart."""

NAMED_ROWS = 200
"""Number of rows by which cells are told to be names of joints."""

MIN_JOINTS = 2
"""Number of joints with positions from which angles in other columns do not matter."""

MAX_MISSING = 2
"""Number of missing joints up to which a table that is no person's is told so."""

GROUP_SIZES = range(4, 9)
"""Numbers of a joint in a row in which each begins with the joint's number."""

OTHER_LAYOUTS = {171: ("cad60", [*range(11, 165, 14), *range(155, 171, 4)])}
"""Joint set, and first columns of the joints, of tables without a header whose joints differ: CAD-60."""


class Table:
    """A table, and what its columns are.

    Parameters
    ----------
    path : Path
        The recording, for error messages.
    lines : sequence of Line
    options : ReadOptions

    Raises
    ------
    SkeletonLogError
        The lines are no table of numbers, `options` do not fit it, or several orders of joints do.
    """

    def __init__(self, path: Path, lines: Sequence[Line], options: ReadOptions) -> None:
        above = _VALUE.findall("".join(text for _, text in lines[:MAX_LINES_ABOVE]))
        options, stated = with_stated_rate(options, ((name, float(value)) for name, value in above))
        self.path, self.options = path, options
        is_trc = bool(lines) and lines[0][1].startswith("PathFileType")
        header = next((k for k, (_, text) in enumerate(lines) if is_trc and text.lower().startswith("frame#")), 0)
        try:
            cells = split(lines[header:])
        except UnevenError as error:
            line, found, expected = error.args
            raise SkeletonLogError(
                at(path, line),
                found=f"{found} columns",
                expected=f"{expected} columns, as in most lines",
                fix="Correct or delete this line, or record again.",
            ) from error
        except DecimalCommaError:
            fix = "Export it with points in numbers, or with semicolons between them."
            self.refuse("a table with commas both in numbers and between them", fix)
        if cells is None:
            raise SkeletonLogError(path, found="text without rows of numbers", expected=ROWS, fix=EXPORT)
        self._above = "".join(text for at, text in lines if at < cells.lines[0]) if cells.lines else ""
        self.cells = cells = with_frames_in_rows(cells)
        self.width = len(cells.names)
        self._names = [" ".join(names) for names in cells.names]
        self._known: dict[int, Floats] = {}
        self.notes: tuple[str, ...] = stated
        if cells.cut_off is not None:
            self.notes = (*self.notes, f"The file ends in the middle of line {cells.cut_off}. This frame is omitted.")
        if cells.left_out:
            self.notes = (*self.notes, f"{cells.left_out} lines have another form than the others. They are omitted.")
        if cells.filled:
            note = f"{cells.filled} rows have fewer cells than the header. Their last cells are missing."
            self.notes = (*self.notes, note)
        if options.columns:
            from capture.formats._columns_file import layout_of_file

            self._layouts = [layout_of_file(options.columns, cells)]
        else:
            self._layouts = self._trc(lines[header][1]) if header else self._named() or self._unnamed()

    def column_name(self, column: int) -> str:
        return self._names[column] or f"column {column + 1}"

    def refuse(self, found: str, fix: str = NAME_COLUMNS) -> NoReturn:
        raise SkeletonLogError(
            self.path,
            found=found,
            expected="a table with x, y and z of a person's joints in columns such as HeadX or left_knee.y",
            fix=fix,
        )

    # What the columns are

    def _trc(self, header: str) -> list[Layout]:
        """Return the layout of a TRC: a frame, a time, then x, y and z of each name in its header."""
        names = [name.strip() for name in re.split("[\t,]", header)[2:] if name.strip()]
        joints = {
            name: {axis: 2 + 3 * index + k for k, axis in enumerate(AXES)}
            for index, name in enumerate(names)
            if 5 + 3 * index <= self.width
        }
        return [Layout(joints, {"frame": 0} if self.options.fps else {"frame": 0, "time": 1})] if joints else []

    def _named(self) -> list[Layout]:
        columns = parse(self.cells.names)
        if not any(column.role in AXES for column in columns):
            numbered = with_numbers_as_axes(columns)
            last = [self._numbers(index) for index, column in enumerate(numbered) if column.role == "z"]
            is_score = all((np.isnan(each) | ((each >= 0) & (each <= 1))).all() for each in last)
            columns = columns if is_score else numbered
        people = list(dict.fromkeys(column.person for column in columns if column.person and column.joint))
        layouts = [
            self._of_columns([each if each.person in ("", person) else Column("") for each in columns])
            for person in people or [""]
        ]
        return [layout for layout in layouts if layout is not None]

    def _of_columns(self, columns: Sequence[Column]) -> Layout | None:
        joints: dict[str, dict[str, int]] = {}
        fields: dict[str, int] = {}
        repeats: dict[str, int] = {}
        for index, (role, joint, _) in enumerate(columns):
            if role in (*AXES, "state"):
                name = joint
                if not joint:  # one joint in each row, or several without names
                    name = f"{UNNAMED}{repeats.get(role, 0)}"
                    repeats[role] = repeats.get(role, 0) + 1
                joints.setdefault(name, {}).setdefault(role, index)
            elif role == "joint":
                fields.setdefault(role if role not in fields else f"joint {len(fields)}", index)
            elif role and (index == 0 or self._names[index]):
                fields.setdefault(role, index)
        joints = {name: own for name, own in joints.items() if own.keys() >= set(AXES)}
        if not joints:
            return None
        unnamed = {name: own for name, own in joints.items() if name.startswith(UNNAMED)}
        if len(joints) == len(unnamed) == 1 and "joint" not in fields and self._joints_counted(fields.get("frame", -1)):
            fields["joint"] = fields.pop("frame")  # an ID that counts joints
        if len(joints) > len(unnamed):
            joints = {name: own for name, own in joints.items() if name not in unnamed and not _PART.match(name)}
            joints = dict(zip(without_prefix(list(joints)), joints.values(), strict=True))
            is_numbered = all(name.isdecimal() for name in joints)
            return Layout(joints, fields) if is_numbered or is_person(list(joints)) else None
        is_known = len(joints) > 1 or fields or self._is_of_joints
        is_known = is_known or self._joint_set_of_rows(next(iter(joints.values()))) is not None
        return Layout(joints, fields) if is_known else None

    def _unnamed(self) -> list[Layout]:
        """Return the layout without names in which the columns are a person's joints, if there is one."""
        named = sum(map(bool, self._names))
        if named in (*range(MAX_EXTRA_COLUMNS + 1, self.width), self.width) and not self._are_numbered():
            return []
        if rows := self._rows_with_names() or self._numbered_groups():
            return rows
        found: list[tuple[Fit, Layout]] = []
        for name, starts, size in self._candidates():
            sample = np.stack([self.positions({"x": x, "y": x + 1, "z": x + 2}) for x in starts], axis=1)
            roles = (*AXES, "state") if size == 4 else AXES
            joints = {
                joint: {role: start + k for k, role in enumerate(roles)}
                for joint, start in zip(JOINT_SETS[name], starts, strict=True)
            }
            above = [column.role for column in parse(self.cells.names[: starts[0]])]
            fields = {role: index for index, role in enumerate(above) if role and self._names[index]}
            layout = Layout(joints, fields or ({"time": 0} if starts[0] else {}))
            found += [(fit, layout) for fit in fits(sample, [name])]
        if found:
            best = clearest(self.path, [fit for fit, _ in found], f"a table with {self.width} columns")
            return [layout for fit, layout in found if fit is best]
        if by_shape := self._by_shape():
            return by_shape
        own = dict(zip((*AXES, "state"), range(self.width), strict=False))
        if self.width in (3, 4) and self._joint_set_of_rows(own):
            return [Layout({f"{UNNAMED}0": own}, {})]
        return self._numbered_rows()

    def _by_shape(self) -> list[Layout]:
        """Return the layout of columns that are x y z of joints in an unknown order, if these move as a person's do."""
        has_words = None in map(number, self.cells.rows[0])
        if self.options.joints or has_words or self.width % 3 or self.width // 3 not in COUNTS:
            return []
        starts = range(0, self.width, 3)
        axes = [dict(zip(AXES, range(start, start + 3), strict=True)) for start in starts]
        names = names_by_shape(np.stack([self.positions(own) for own in axes], axis=1))
        if not is_person(names):
            return []
        self.notes = (*self.notes, BY_SHAPE_NOTE)
        return [Layout({name: own for name, own in zip(names, axes, strict=True) if name}, {})]

    def _rows_with_names(self) -> list[Layout]:
        """Return the layout of rows of which each has the name of a joint in a cell, and its x, y and z after it."""
        rows = self.cells.rows[:NAMED_ROWS]
        numbers = np.array([[np.nan if (each := number(cell)) is None else each for cell in row] for row in rows])
        steps = np.diff(numbers, axis=0)
        is_time: NDArray[np.bool_] = np.all(steps >= 0, axis=0) & np.any(steps > 0, axis=0)
        is_place: NDArray[np.bool_] = np.all(np.isfinite(numbers), axis=0) & ~is_time
        for joint in np.flatnonzero(np.isnan(numbers).all(axis=0)).tolist():
            first = next((k for k in range(joint + 1, self.width - 2) if is_place[k : k + 3].all()), None)
            names = list(dict.fromkeys(row[joint] for row in rows))
            is_damaged = any(name in self._above for name in names)  # a row without numbers
            if first is not None and not is_damaged and is_person(names):
                own = dict(zip(AXES, range(first, first + 3), strict=True))
                others = [k for k in range(self.width) if k != joint and k not in own.values()]
                times = [
                    k for k in others if is_time[k] or (np.isnan(numbers[:, k]).all() and rows[0][k][:1].isdigit())
                ]
                states = [k for k in others if k > first and k not in times]
                own |= {"state": states[0]} if states else {}
                return [Layout({f"{UNNAMED}0": own}, {"joint": joint} | ({"time": times[0]} if times else {}))]
        return []

    def _numbered_rows(self) -> list[Layout]:
        """Return the layout of rows that have a joint's number, which begins again at 0 or 1, before x, y and z."""
        for column in range(self.width - 3):
            count = self._joints_counted(column)
            if count and all(number(row[column + 3]) is not None for row in self.cells.rows[:count]):
                own = self._with_best_depth(column, count)
                return [Layout({f"{UNNAMED}0": own}, {"joint": column} | ({"time": column - 1} if column else {}))]
        return []

    def _joints_counted(self, column: int) -> int:
        """Return how many joints a column counts from 0 or 1, again and again; 0 if it does not."""
        numbers = [row[column] for row in self.cells.rows] if column >= 0 else [""]
        first = int(numbers[0] == "1")
        count = next((index for index, cell in enumerate(numbers) if index and cell == str(first)), 0)
        expected = (str(first + index % count) for index in range(3 * count))
        is_joint = count > 4 and all(cell == each for cell, each in zip(numbers, expected, strict=False))
        return count if is_joint else 0

    def _with_best_depth(self, column: int, count: int) -> dict[str, int]:
        """Return the columns of x, y and that z, of those after them, with which `count` joints are a person."""
        names = [name for name, joints in JOINT_SETS.items() if len(joints) == count]
        layouts = []
        for z in range(column + 3, self.width):
            own = {"x": column + 1, "y": column + 2, "z": z}
            if any(number(row[z]) is None for row in self.cells.rows[:count]):
                break
            whole = self.positions(own)[: len(self.cells.rows) // count * count]
            layouts += [(fit.misfit, z, own) for fit in fits(whole.reshape(-1, count, 3), names)[:1]]
        return min(layouts)[2] if layouts else {axis: column + 1 + k for k, axis in enumerate(AXES)}

    def _numbered_groups(self) -> list[Layout]:
        """Return the layout of rows in which each joint's number stands before its x, y and z."""
        first, *others = self.cells.rows
        fixed = [cell.isdecimal() and all(row[column] == cell for row in others) for column, cell in enumerate(first)]
        for size, start in itertools.product(GROUP_SIZES, range(MAX_EXTRA_COLUMNS + 1)):
            columns = range(start, self.width - size + 1, size)
            if len(columns) > 4 and all(fixed[column] for column in columns):
                numbers = [int(first[column]) for column in columns]
                roles = (*AXES, "state")[: size - 1]
                joints = {
                    str(number): {role: column + 1 + k for k, role in enumerate(roles)}
                    for number, column in zip(numbers, columns, strict=True)
                }
                if numbers == sorted(set(numbers)):
                    return [Layout(joints, {"time": start - 1} if start else {})]
        return []

    def _are_numbered(self) -> bool:
        return all(name.strip().replace(".", "").isdecimal() for name in self._names if name)

    def _candidates(self) -> Iterable[tuple[str, list[int], int]]:
        """Yield joint sets, the first columns of their joints, and how many columns a joint has."""
        chosen = self.options.joints
        if self.width in OTHER_LAYOUTS and chosen in (None, OTHER_LAYOUTS[self.width][0]):
            name, starts = OTHER_LAYOUTS[self.width]
            yield name, starts, 4
        words = [k for k, cell in enumerate(self.cells.rows[0]) if number(cell) is None]
        for (name, joints), size in itertools.product(JOINT_SETS.items(), WIDTHS):
            extra = self.width - size * len(joints)
            if chosen in (None, name) and 0 <= extra <= max(len(words), MAX_EXTRA_COLUMNS):
                for before in range(extra + 1):
                    places = range(before, before + size * len(joints), size)
                    if not any(place <= word < place + 3 for place in places for word in words):
                        yield name, [*places], size

    @property
    def _is_of_joints(self) -> bool:
        """Whether a name says that a row is a joint."""
        return any(set(name.lower().replace("_", " ").split()) & WORDS["joint"] for name in self._names)

    def joints_per_frame(self, layout: Layout) -> int:
        """Return how many rows a frame has, if each row is a joint."""
        name = self._joint_set_of_rows(next(iter(layout.joints.values())))
        if name is None:
            self.refuse("rows of x y z, in no order of joints that gives a person")
        return len(JOINT_SETS[name])

    def _joint_set_of_rows(self, own: dict[str, int]) -> str | None:
        """Return the set of joints of which each frame has a row."""
        rows = self.positions(own)
        steps = np.diff(rows, axis=0)
        if ((steps >= 0).all(axis=0) & (steps > 0).any(axis=0)).any():  # a time, no coordinate
            return None
        best: list[Fit] = []
        for name, joints in JOINT_SETS.items():
            count = len(rows) // len(joints)
            if not count or self.options.joints not in (None, name) or name in HOLISTIC:
                continue
            of_joints = rows[len(joints) :] - rows[: -len(joints)]  # from frame to frame
            if not len(of_joints) or _typical_length(of_joints) < _typical_length(steps):  # else the path of a point
                best += fits(rows[: count * len(joints)].reshape(count, -1, 3), [name])
        if not (self.options.joints or self._is_of_joints):  # points of a mesh are rows of x y z too
            best = [fit for fit in best if fit.misfit < MAX_MISFIT]
        return min(best, key=lambda fit: fit.misfit).name if best else None

    # What the rows are

    @property
    def layouts(self) -> list[Layout]:
        """The columns of each performer, or one layout if performers share columns; an error without positions."""
        if not self._layouts:
            self._refuse_columns()
        return self._layouts

    def _refuse_columns(self) -> NoReturn:
        """Raise the error that says what the columns are instead of a person's joints."""
        named = [
            name
            for name, cells in zip(self._names, self.cells.names, strict=True)
            if len(cells) == 1 or set(cells) - set(PARTS)
        ]
        columns = parse(self.cells.names)
        roles, joints = {column.role for column in columns}, [column.joint for column in columns if column.role == "z"]
        if named:
            found = f"a table with the columns {', '.join(named[:12])}{' …' if len(named) > 12 else ''}"
            found += as_of(len(joints))
        else:
            found = f"a table with {self.cells.origin[-1] + 1} columns without names{as_of(self.width // 3)}"
            for _, starts, _ in self._candidates():
                points = [self.positions({"x": x, "y": x + 1, "z": x + 2}) for x in starts]
                refuse_image(self.path, np.stack(points, axis=1))
        if part := part_of_a_person(joints):
            self.refuse(f"{found}{part}", WHOLE_BODY)
        if len(joints) < MIN_JOINTS and (angles := of_angles(named)):
            self.refuse(f"{found}{angles}", EXPORT)
        # a shoulder without an elbow may be a collar
        missing = [joint for joint in missing_joints(joints) if not joint.startswith("shoulder")]
        if 0 < len(missing) <= MAX_MISSING:
            found += f", which have no {' and '.join(missing)}"
        if roles >= {"x", "y"} and "z" not in roles:
            self.refuse(f"{found}, which have no z: positions in an image", IN_SPACE)
        self.refuse(found, NAME_COLUMNS if roles >= set(AXES) or not named else f"{EXPORT} {NAME_COLUMNS}")

    @property
    def has_joints(self) -> bool:
        """Whether the columns are positions of joints, or parameters of the SMPL body."""
        return bool(self._layouts or self.parameters)

    @property
    def parameters(self) -> smpl.Parameters | None:
        """The parameters of the SMPL body in columns without names other than numbers; None of other tables."""
        is_numbered = all(not name or name[-1].isdecimal() for name in self._names[1:])
        if self._layouts or not is_numbered or None in map(number, self.cells.rows[0]):
            return None
        return smpl.in_rows(np.stack([self._numbers(column) for column in range(self.width)], axis=1))

    def texts(self, layout: Layout, role: str) -> list[str]:
        """Return the cells of the column with a role; an empty list without it."""
        column = layout.fields.get(role)
        return [] if column is None else [row[column] for row in self.cells.rows]

    def positions(self, own: dict[str, int]) -> Floats:
        """Return the positions (R, 3) in a joint's columns; NaN if unknown."""
        return np.stack([self._numbers(own[axis]) for axis in AXES], axis=1)

    def _numbers(self, column: int) -> Floats:
        """Return the numbers (R,) of a column; NaN if unknown."""
        if column not in self._known:
            found = [number(row[column]) for row in self.cells.rows]
            if None in found:
                index = found.index(None)
                raise SkeletonLogError(
                    at(self.path, self.cells.lines[index]),
                    found=f"{self.cells.rows[index][column][:40]!r} in {self.column_name(column)}",
                    expected="a number",
                    fix="Correct or delete this line, or record again.",
                )
            self._known[column] = np.array(found, dtype=np.float64)
        return self._known[column]


def _typical_length(ways: Floats) -> float:
    """Return the median length of ways (R, 3) that are known."""
    return float(np.nanmedian(np.linalg.norm(ways, axis=1)))
