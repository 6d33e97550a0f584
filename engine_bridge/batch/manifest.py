"""The manifest: a table with a row per result, as Parquet or CSV."""

import csv
import os
from collections.abc import Sequence
from dataclasses import asdict, fields
from importlib.util import find_spec
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from engine_bridge.batch.row import Row
from engine_bridge.batch.store import Store
from puppetline.errors import OutputError
from puppetline.files import check_writable, written_whole

ENDINGS = (".parquet", ".csv")

COLUMNS = tuple(field.name for field in fields(Row))


def check_manifest(path: Path) -> None:
    """Check before the work that a manifest can be written.

    Raises
    ------
    PuppetlineError
    """
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise OutputError(
            path, found=f"the ending {ending!r}", expected=" or ".join(ENDINGS), fix=f"Call it {path.stem}.csv."
        )
    if ending == ".parquet" and find_spec("pyarrow") is None:
        raise OutputError(
            f"--manifest {path}",
            found="no installation of pyarrow",
            expected="the Python package pyarrow, or the ending .csv",
            fix=f"Install it: pip install 'puppetline[batch]'. Or add --manifest {path.stem}.csv.",
        )
    check_writable(path, ending)


def write_whole_manifest(path: Path, store: Store) -> list[Row]:
    """Write the rows of all records whose results are complete, and return them.

    Another batch may write to the folder at the same time. If the records have changed while the manifest was written,
    it is therefore written again: the last batch that writes it has read all of them.

    Raises
    ------
    OutputError
    """
    while True:
        before = _versions(store)
        rows = [row for _, record in store.records() if store.is_whole(record) for row in record.rows]
        write_manifest(path, rows)
        if _versions(store) == before:
            return rows


def write_manifest(path: Path, rows: Sequence[Row]) -> None:
    """Write a manifest, completely or not at all.

    Raises
    ------
    OutputError
    """
    with written_whole(path) as beside:
        if path.suffix.lower() == ".csv":
            _write_csv(beside, rows)
        else:
            _write_parquet(beside, rows)


def _write_csv(path: Path, rows: Sequence[Row]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for row in rows:
            writer.writerow(
                ["" if value is None else value for value in (asdict(row) | {"notes": " ".join(row.notes)}).values()]
            )


def _write_parquet(path: Path, rows: Sequence[Row]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {int: pa.int64(), float: pa.float64(), tuple: pa.list_(pa.string())}

    def of_column(hint: Any) -> Any:
        """Return the type of a column whose values have a type such as ``int | None``; text is the default."""
        kind = get_args(hint)[0] if isinstance(hint, UnionType) else get_origin(hint) or hint
        return types.get(kind, pa.string())

    values = {column: [getattr(row, column) for row in rows] for column in COLUMNS}
    schema = pa.schema([(column, of_column(hint)) for column, hint in get_type_hints(Row).items()])
    pq.write_table(pa.table(values, schema=schema), path)


def _versions(store: Store) -> dict[str, int]:
    """Return the time of modification of each record."""
    return {path: os.stat(path).st_mtime_ns for path in store.record_paths()}  # noqa: PTH116  # as in `record_paths`
