"""Conversion of the recordings of a batch, in any process."""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from capture.clip import SkeletonClip
from capture.formats import read_log
from capture.timeline import choose
from engine_bridge.batch.identity import FileState, identity, result_key
from engine_bridge.batch.row import Row
from engine_bridge.batch.store import Job, Record, Store
from engine_bridge.export.convert import convert_timeline, load_rig_for
from engine_bridge.performance.clip import timeline_of
from engine_bridge.performance.rig import Rig
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError, PuppetError, PuppetlineError, SkeletonLogError

MAX_STARTS = 3
"""Number of times that a conversion may end with its process before it counts as failed."""

MAX_RIGS = 8
"""Number of characters that a process keeps; jobs are ordered by character."""


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
    fail_fast : bool
        Start nothing after a failure.
    retry_failed : bool
        Try again what has failed in an earlier batch.
    """

    folder: Path
    run: str
    settings: Settings
    users: str
    fail_fast: bool = False
    retry_failed: bool = False


@dataclass(frozen=True)
class Outcome:
    """A job with its record, and the time that it took in seconds."""

    job: Job
    record: Record
    seconds: float


def convert_jobs(jobs: Iterable[Job], batch: BatchSettings) -> list[Outcome]:
    """Convert some recordings one after another; a recording that cannot be converted is a failed row.

    What is up to date is not converted, so that the jobs of a killed process can be given to another one.

    Raises
    ------
    OutputError
        Results cannot be written, for example because the disk is full.
    PuppetError
        A puppet or character is not that of the batch any more.
    """
    store, outcomes = Store(batch.folder, batch.run), []
    for job in jobs:
        start = time.perf_counter()
        record = store.load(job.name)
        if record is None or not is_settled(record, job, store, batch):
            record = _convert(job, store, batch)
        outcomes.append(Outcome(job, record, time.perf_counter() - start))
        if batch.fail_fast and record.has_failed:
            break
    return outcomes


def is_settled(record: Record, job: Job, store: Store, batch: BatchSettings) -> bool:
    """Return whether a job needs no conversion, because its results are there, or because it has failed before."""
    if record.has_failed and batch.retry_failed and record.run != batch.run:
        return False
    return store.is_current(record, job)


def _convert(job: Job, store: Store, batch: BatchSettings) -> Record:
    """Convert a recording for its performers, and write the record."""
    rig = _rig(job, batch.settings, batch.users)
    failed = Row("failed", "", str(job.log), str(job.puppet), None, None, batch.settings.form)
    record = Record(job.identity, batch.run, None, (failed,), {})
    starts = store.start(job)
    try:
        state = FileState.of(job.log)
        record = replace(record, log=state)
        failed = replace(failed, key=result_key(job.identity, state, job.name))
        if starts >= MAX_STARTS:
            raise SkeletonLogError(
                job.log,
                found=f"a recording whose conversion has ended its process {starts} times",
                expected="a conversion that ends",
                fix="Convert it alone to see why. The memory may be too small for it.",
            )
        record = _convert_performers(job, rig, record, failed, store, batch)
    except OSError as error:
        unreadable = SkeletonLogError(
            job.log,
            found=f"a file that cannot be read ({error.strerror})",
            expected="a readable recording",
            fix="Check the path and its permissions.",
        )
        record = replace(record, rows=(_failed(failed, unreadable),))
    except SkeletonLogError as error:
        record = replace(record, rows=(_failed(failed, error),))
    store.save(job, record)
    return record


def _convert_performers(job: Job, rig: Rig, record: Record, failed: Row, store: Store, batch: BatchSettings) -> Record:
    """Return the record of a recording that can be read, with one row per performer."""
    try:
        clips = read_log(job.log, batch.settings.log)
    except MemoryError as error:
        return replace(record, rows=(_failed(failed, error),))
    rows, files = [], {}
    for user in [clip.user for clip in clips] if batch.users == "all" and clips else [None]:
        row = replace(failed, format=clips[0].format if clips else None, user=user)
        output = f"{job.name}.glb" if user is None else f"{job.name}.user{user}.glb"
        try:
            rows.append(_convert_performer(clips, job, rig, row, output, store, batch.settings))
            files[output] = FileState.of(batch.folder / output)
        except Exception as error:  # a mistake of the program about one recording must not stop the others either
            if isinstance(error, OutputError) and isinstance(error.__cause__, OSError):
                raise
            rows.append(_failed(row, error))
    return replace(record, rows=tuple(rows), files=files)


def _convert_performer(
    clips: list[SkeletonClip], job: Job, rig: Rig, row: Row, output: str, store: Store, settings: Settings
) -> Row:
    """Write the result of one performer, and return its row."""
    start = time.perf_counter()
    chosen = replace(settings, user=row.user)
    timeline, notes = timeline_of(clips, job.log, chosen)
    with store.written(output) as partial:
        try:
            _, summary = convert_timeline(rig, timeline, partial, job.log.stem, chosen, notes)
        except OutputError as error:  # it names the file under its temporary name
            if error.where != str(partial):
                raise
            raise OutputError(
                store.folder / output, found=error.found, expected=error.expected, fix=error.fix
            ) from error.__cause__
    return replace(
        row,
        state="done",
        output=output,
        user=choose(clips, row.user)[0].user,
        frames=summary.frames,
        seconds=summary.seconds,
        targets=summary.targets,
        bones=summary.bones,
        error=summary.error,
        rms=summary.rms,
        stretch_p1=summary.stretch_p1,
        stretch_p50=summary.stretch_p50,
        stretch_p99=summary.stretch_p99,
        parts_apart=summary.parts_apart,
        bytes=summary.bytes,
        conversion_seconds=time.perf_counter() - start,
        notes=summary.notes,
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
def _loaded(puppet: Path, settings: Settings, users: str) -> tuple[Rig, str]:
    """Return a puppet with its prepared character, and its identity."""
    rig = load_rig_for(puppet, settings)
    return rig, identity(rig, settings, users)


def _rig(job: Job, settings: Settings, users: str) -> Rig:
    """Return the prepared character of a job; raise an error if it is not the one that the batch began with."""
    rig, found = _loaded(job.puppet, settings, users)
    if found != job.identity:
        raise PuppetError(
            job.puppet,
            found="another puppet file, character or version of Puppetline than at the start of the batch",
            expected="the same on all machines during the whole batch",
            fix="Run the command again, with the same version of Puppetline on all workers.",
        )
    return rig
