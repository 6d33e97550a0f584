"""Tables whose columns a file of the user names (`ReadOptions.columns`)."""

from pathlib import Path

from capture.formats._cells import Cells
from capture.formats._columns import AXES, Layout
from puppetline import toml_schema
from puppetline.errors import SkeletonLogError, at


def layout_of_file(path: Path, cells: Cells) -> Layout:
    """Return the layout of a table whose columns a file of the user names, with a line for each joint.

    Raises
    ------
    SkeletonLogError
        The file cannot be read, is no TOML, or names columns that the table does not have.
    """
    text = toml_schema.read_text(path, "a file that names columns", "Check the path.", SkeletonLogError)
    joints, fields = {}, {}
    for name, own in toml_schema.parse(text, path, SkeletonLogError).items():
        columns = [
            column
            for each in (own if isinstance(own, list) else [own])
            for column in _columns_of(path, cells, name, each)
        ]
        is_field = name in ("time", "frame", "person", "joint")
        if len(columns) not in ((1,) if is_field else range(3, 8)):
            raise SkeletonLogError(
                at(path, field=name),
                found=f"{len(columns)} columns",
                expected="the columns of x, y and z, or one column with all three",
                fix="Correct this line.",
            )
        if is_field:
            fields[name] = columns[0]
        else:
            joints[name] = dict(zip((*AXES, "state"), columns, strict=False))
    if not joints:
        raise SkeletonLogError(
            path,
            found="no columns of a joint",
            expected='lines such as Head = ["HX", "HY", "HZ"]',
            fix="Add a line for each joint.",
        )
    return Layout(joints, fields)


def _columns_of(path: Path, cells: Cells, field: str, name: object) -> list[int]:
    """Return the columns of a column of the file, which has a name or a number from 1."""
    origin, count = cells.origin, cells.origin[-1] + 1
    names = [" ".join(each) for each in cells.names]
    chosen = [
        index
        for index, column in enumerate(origin)
        if name == column + 1
        or name == names[index]
        or (origin.count(column) > 1 and name == " ".join(cells.names[index][:-1]))
    ]
    if not chosen:
        raise SkeletonLogError(
            at(path, field=field),
            found=f"the column {name!r}",
            expected=f"a number from 1 to {count}, or a name of the table such as {names[0]!r}",
            fix="Correct this line.",
        )
    return chosen
