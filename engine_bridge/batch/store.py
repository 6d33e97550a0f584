"""The folder of a batch: results, and records of what they were made from.

Every file is written to `PARTIAL_FOLDER` under a unique name, synchronised to the disk and then renamed. A result is
renamed before its record is written, and the record contains the hash of the result. A result under its name is
therefore always complete, whenever a process is killed. A result that does not match its record is recognised and made
again. No locks are needed: processes that convert the same recording at the same time write equal files.
"""

import os
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from engine_bridge.batch.identity import FileState
from engine_bridge.batch.row import Row
from puppetline.files import output_errors, written_whole

OWN_FOLDER = ".puppetline"
"""Folder for everything but results, in the folder of a batch."""

PARTIAL_FOLDER, RECORD_FOLDER, SHEET_FOLDER = "partial", "records", "sheets"
"""Folders in `OWN_FOLDER` for incomplete files, for records, and for contact sheets of the report."""

STALE_SECONDS = 86_400
"""Age after which an incomplete file, whose process must have been killed, is deleted, in seconds."""


@dataclass(frozen=True)
class Job:
    """A recording that is to be converted with a puppet.

    Attributes
    ----------
    name : str
        Name of the results without ending, relative to the folder of the batch.
    log : Path
        Absolute path.
    puppet : Path or None
        Absolute path; None for an animation of the performer.
    identity : str
        From `engine_bridge.batch.identity.identity`.
    """

    name: str
    log: Path
    puppet: Path | None
    identity: str


@dataclass(frozen=True)
class Record:
    """The outcome of a job.

    Attributes
    ----------
    identity : str
        The job's.
    run : str
        Unique name of the batch that has written this record.
    log : FileState or None
        The recording; None if it could not be read.
    rows : tuple of Row
        One per performer, as in the manifest.
    files : dict
        State of each result by its path relative to the folder of the batch.
    """

    identity: str
    run: str
    log: FileState | None
    rows: tuple[Row, ...]
    files: dict[str, FileState]

    @property
    def has_failed(self) -> bool:
        """Whether no result could be made for some performer."""
        return any(row.state == "failed" for row in self.rows)


RECORD = TypeAdapter(Record)
"""Reads and writes records as JSON."""


class Store:
    """The folder of a batch.

    Parameters
    ----------
    folder : Path
    run : str
        Unique name of this batch.
    """

    def __init__(self, folder: Path, run: str) -> None:
        self.folder, self.run = folder, run
        self._own = folder / OWN_FOLDER
        self._partial = self._own / PARTIAL_FOLDER
        self._records = self._own / RECORD_FOLDER

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Create the folders and check that files can be written; at the end, delete incomplete files of this batch.

        At the start, incomplete files of other batches are deleted if they are older than `STALE_SECONDS`.

        Raises
        ------
        OutputError
        """
        with output_errors(self.folder):
            for folder in (self._partial, self._records, self._own / SHEET_FOLDER):
                folder.mkdir(parents=True, exist_ok=True)
            probe = self._partial / f"{self.run}.probe"
            probe.touch()
            probe.unlink()
            for path in self._partial.iterdir():
                with suppress(FileNotFoundError):
                    if path.stat().st_mtime < time.time() - STALE_SECONDS:
                        path.unlink()
        try:
            yield
        finally:
            with suppress(OSError):
                for path in self._partial.iterdir():
                    if self.run in path.name:
                        path.unlink(missing_ok=True)

    def load(self, name: str) -> Record | None:
        """Read the record of a job; None if it is missing, damaged or of another version."""
        return _read(self._record(name))

    def records(self) -> Iterator[tuple[str, Record]]:
        """Yield the path of each complete record, and the record, in the order of their names."""
        for path in self.record_paths():
            record = _read(Path(path))
            if record is not None:
                yield path, record

    def record_paths(self) -> list[str]:
        """Return the paths of all records."""
        return sorted(
            os.path.join(folder, name)  # noqa: PTH118  # ten times as fast as a Path for each of 100,000 records
            for folder, _, names in os.walk(self._records)
            for name in names
            if name.endswith(".json") and not name.startswith(".")
        )

    def is_current(self, record: Record, job: Job) -> bool:
        """Return whether a record is of this job, its recording has not changed, and its results are complete."""
        return (
            record.identity == job.identity
            and record.log is not None
            and record.log.is_of(job.log)
            and self.is_whole(record)
        )

    def is_whole(self, record: Record) -> bool:
        """Return whether all results of a record exist and are complete."""
        return all(state.is_of(self.folder / name) for name, state in record.files.items())

    def save(self, job: Job, record: Record) -> None:
        """Write the record of a job; delete results of its former record that the new one does not have.

        Raises
        ------
        OutputError
        """
        former = self.load(job.name)
        path = self._record(job.name)
        with output_errors(self.folder / job.name):
            path.parent.mkdir(parents=True, exist_ok=True)
            for name in (former.files.keys() if former else set()) - record.files.keys():
                (self.folder / name).unlink(missing_ok=True)
        with written_whole(path) as beside:
            beside.write_bytes(RECORD.dump_json(record))
        self._starts(job.name).unlink(missing_ok=True)

    @contextmanager
    def written(self, name: str) -> Iterator[Path]:
        """Yield a path to write a result to; then synchronise the file to the disk and give it its name.

        Parameters
        ----------
        name : str
            Path of the result relative to the folder of the batch.

        Raises
        ------
        OutputError
        """
        final = self.folder / name
        partial = self._partial / f"{self.run}-{uuid.uuid4().hex}{final.suffix}"
        try:
            yield partial
            with output_errors(final):
                with partial.open("rb") as file:
                    os.fsync(file.fileno())
                final.parent.mkdir(parents=True, exist_ok=True)
                partial.replace(final)
        finally:
            partial.unlink(missing_ok=True)

    def start(self, job: Job) -> int:
        """Record that the conversion of a job starts; return how often it has started in this batch without a record.

        Raises
        ------
        OutputError
        """
        path = self._starts(job.name)
        with output_errors(self.folder / job.name):
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("a+", encoding="utf-8") as file:
                file.seek(0)
                before = file.read().split().count(self.run)
                file.write(f"{self.run}\n")
        return before

    def sheet(self, row: Row) -> Path:
        """Return the path of the contact sheet of a result."""
        return self._own / SHEET_FOLDER / f"{row.key[:32]}-{row.user}.png"

    def _record(self, name: str) -> Path:
        return self._records / f"{name}.json"

    def _starts(self, name: str) -> Path:
        return self._records / f"{name}.started"


def _read(path: Path) -> Record | None:
    try:
        return RECORD.validate_json(path.read_bytes())
    except (OSError, ValidationError):  # absent, damaged, or of another version
        return None
