"""Conversion of the recordings of a batch, in any process."""

import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from capture.clip import SkeletonClip
from capture.sensors.recorded_video import read_recording
from capture.timeline import choose
from engine_bridge.batch.identity import FileState, identity, performer_identity, result_key
from engine_bridge.batch.row import Row
from engine_bridge.batch.store import Job, Record, Store
from engine_bridge.export.convert import Summary, convert_timeline
from engine_bridge.export.performer.convert import PerformerSummary, convert_performer, upright_performers
from engine_bridge.performance.clip import Clip, load_timeline, perform, timeline_of
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared
from engine_bridge.performance.settings import PerformerFormat, Settings
from puppetline.errors import OutputError, PuppetError, PuppetlineError, SkeletonLogError

MAX_STARTS = 3
"""Number of times that a conversion may end with its process before it counts as failed."""

MAX_RIGS = 8
"""Number of characters that a process keeps; jobs are ordered by character."""


SUMMARY_COLUMNS, PERFORMER_COLUMNS = (
    sorted({field.name for field in fields(Row)} & {field.name for field in fields(kind)} - {"form", "output", "user"})
    for kind in (Summary, PerformerSummary)
)
"""Columns whose values the summary of a conversion has, for a character and for a performer."""


@dataclass(frozen=True)
class BatchSettings:
    """What all jobs of a batch share.

    Attributes
    ----------
    folder : Path
        Absolute path of the results.
    run : str
        Unique name of the batch.
    settings : Settings
    users : {"longest", "all"}
        Performers of a recording that are converted.
    performer : {"bvh", "vrma", "glb"}, optional
        Format of animations of the performers themselves, without characters.
    fail_fast : bool
        Start nothing after a failure.
    retry_failed : bool
        Retry jobs that have failed in an earlier batch.
    """

    folder: Path
    run: str
    settings: Settings
    users: str
    performer: PerformerFormat | None = None
    fail_fast: bool = False
    retry_failed: bool = False

    @property
    def ending(self) -> str:
        """The ending of the results' names."""
        return f".{self.performer or 'glb'}"


@dataclass(frozen=True)
class Outcome:
    """A job with its record."""

    job: Job
    record: Record


def convert_job(job: Job, batch: BatchSettings, check: Callable[[], None] = lambda: None) -> Outcome:
    """Convert a recording; one that cannot be converted results in a failed row.

    A job with a current record, which another batch has made meanwhile, is not converted again.

    Parameters
    ----------
    job : Job
    batch : BatchSettings
    check : callable, optional
        Called often; raises an error to stop.

    Raises
    ------
    OutputError
        Results cannot be written, for example because the disk is full.
    PuppetError
        A puppet or character has changed since the start of the batch.
    """
    store = Store(batch.folder, batch.run)
    record = store.load(job.name)
    if record is None or not is_settled(record, job, store, batch):
        record = _Conversion(job, store, batch, check).record()
    return Outcome(job, record)


def is_settled(record: Record, job: Job, store: Store, batch: BatchSettings) -> bool:
    """Return whether a job needs no conversion, because its results are current, or because it has failed before."""
    if record.has_failed and batch.retry_failed and record.run != batch.run:
        return False
    return store.is_current(record, job)


def solve_again(row: Row, settings: Settings) -> Clip:
    """Return the solved clip of a result, for images.

    Raises
    ------
    PuppetlineError
    """
    chosen = replace(settings, user=row.user)
    timeline, notes = load_timeline(Path(row.log), chosen)
    return perform(load_prepared(Path(row.puppet)), timeline, chosen, notes, lambda _stage, _share: None)


class _Conversion:
    """The conversion of one recording.

    Parameters
    ----------
    job : Job
    store : Store
    batch : BatchSettings
    check : callable
    """

    def __init__(self, job: Job, store: Store, batch: BatchSettings, check: Callable[[], None]) -> None:
        self._job, self._store, self._batch, self._check = job, store, batch, check
        self._rig = None if job.puppet is None else _rig(job, job.puppet, batch)
        of_performers = performer_identity(batch.settings, batch.users, batch.ending)
        if job.puppet is None and of_performers != job.identity:
            raise _changed(job.log)
        form = batch.performer or batch.settings.form
        self._row = Row("failed", "", str(job.log), str(job.puppet or ""), None, None, form)

    def record(self) -> Record:
        """Convert the recording for its performers, write the record, and return it."""
        starts = self._store.start(self._job)
        record = Record(self._job.identity, self._batch.run, None, (self._row,), {})
        try:
            state = FileState.of(self._job.log)
            self._row = replace(self._row, key=result_key(self._job.identity, state, self._job.name))
            record = replace(record, log=state)
            if starts >= MAX_STARTS:
                record = replace(record, rows=(_failed(self._row, self._killed()),))
            else:
                record = self._of_performers(record)
        except OSError as error:
            record = replace(record, rows=(_failed(self._row, self._unreadable(error)),))
        self._store.save(self._job, record)
        return record

    def _of_performers(self, record: Record) -> Record:
        """Convert the recording, and return its record with a row per performer."""
        try:
            clips = read_recording(self._job.log, self._batch.settings.log)
        except Exception as error:  # an internal error with one recording must not stop the others either
            self._check()  # compiled code turns an interrupt into another error
            return replace(record, rows=(_failed(self._row, error),))
        rows, files = [], {}
        for user in [clip.user for clip in clips] if self._batch.users == "all" and clips else [None]:
            row = replace(self._row, format=clips[0].format if clips else None, user=user)
            output = self._job.name + ("" if user is None else f".user{user}") + self._batch.ending
            try:
                rows.append(self._of_performer(clips, row, output))
                files[output] = FileState.of(self._batch.folder / output)
            except Exception as error:
                self._check()
                if isinstance(error, OutputError) and isinstance(error.__cause__, OSError):  # not about this recording
                    raise
                rows.append(_failed(row, error))
        return replace(record, rows=tuple(rows), files=files)

    def _of_performer(self, clips: list[SkeletonClip], row: Row, output: str) -> Row:
        """Write the result of one performer, and return its row."""
        start = time.perf_counter()
        with self._store.written(output) as partial:
            try:
                values = self._write(clips, row, partial)
            except OutputError as error:  # it has the temporary name of the file
                if error.where != str(partial):
                    raise
                where = self._store.folder / output
                raise OutputError(where, found=error.found, expected=error.expected, fix=error.fix) from error.__cause__
        user, seconds = choose(clips, row.user)[0].user, time.perf_counter() - start
        return replace(row, state="done", output=output, user=user, conversion_seconds=seconds, **values)

    def _write(self, clips: list[SkeletonClip], row: Row, output: Path) -> dict[str, Any]:
        """Write a file, and return values of its row."""
        log, settings = self._job.log, replace(self._batch.settings, user=row.user)
        if self._rig is None:
            made = convert_performer(upright_performers(clips), log, output, log.stem, settings, self._progress)
            return {name: getattr(made, name) for name in PERFORMER_COLUMNS}
        settings = settings.for_puppet(self._rig.puppet)
        timeline, notes = timeline_of(clips, log, settings)
        _, summary = convert_timeline(self._rig, timeline, output, log.stem, settings, notes, self._progress)
        return {"form": settings.form, **{name: getattr(summary, name) for name in SUMMARY_COLUMNS}}

    def _progress(self, _stage: str, _share: float) -> None:
        self._check()

    def _killed(self) -> SkeletonLogError:
        return SkeletonLogError(
            self._job.log,
            found=f"a recording whose conversion has ended its process {MAX_STARTS} times",
            expected="a conversion that ends",
            fix="Convert it alone to see why. The memory may be too small for it.",
        )

    def _unreadable(self, error: OSError) -> SkeletonLogError:
        return SkeletonLogError(
            self._job.log,
            found=f"a file that cannot be read ({error.strerror})",
            expected="a readable recording",
            fix="Check the path and its permissions.",
        )


def _failed(row: Row, error: Exception) -> Row:
    """Return a row with the reason why there is no result."""
    if isinstance(error, PuppetlineError):
        return replace(row, reason=error.found, message=str(error))
    if isinstance(error, MemoryError):
        return replace(row, reason="not enough memory", message=f"{row.log}: not enough memory to convert it.")
    reason = f"internal error: {type(error).__name__}: {error}"
    return replace(row, reason=reason, message=f"{row.log}: {reason}. Please report it with this recording.")


@lru_cache(maxsize=MAX_RIGS)
def _loaded(puppet: Path, settings: Settings, users: str) -> tuple[PreparedCharacter, str]:
    """Return a puppet with its prepared character, and its identity."""
    prepared = load_prepared(puppet)
    return prepared, identity(prepared, settings, users)


def _rig(job: Job, puppet: Path, batch: BatchSettings) -> PreparedCharacter:
    """Return the prepared character of a job; raise an error if it is not the one that the batch began with."""
    prepared, found = _loaded(puppet, batch.settings, batch.users)
    if found != job.identity:
        raise _changed(puppet)
    return prepared


def _changed(where: Path) -> PuppetError:
    return PuppetError(
        where,
        found="another puppet file, character or version of Puppetline than at the start of the batch",
        expected="the same on all machines during the whole batch",
        fix="Run the command again, with the same version of Puppetline on all machines.",
    )
