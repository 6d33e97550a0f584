"""A batch: its jobs, the choice of those that have to run, and their outcomes."""

import hashlib
import uuid
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from engine_bridge.batch.conversion import BatchSettings, Outcome, convert_job, is_settled
from engine_bridge.batch.identity import identity, performer_identity
from engine_bridge.batch.recordings import Recording
from engine_bridge.batch.store import Job, Record, Store
from engine_bridge.batch.workers import convert_in_processes
from engine_bridge.performance.prepared_character import load_prepared
from puppetline.errors import PuppetError


@dataclass(frozen=True)
class Shard:
    """Part `index` of `count` parts of a batch; the first has index 1."""

    index: int
    count: int

    def has(self, name: str) -> bool:
        """Return whether a job is in this part. It depends on the job's name only, and not on other jobs."""
        number = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
        return number % self.count == self.index - 1


@dataclass(frozen=True)
class BatchPlan:
    """The jobs of a batch.

    Attributes
    ----------
    settled : dict
        Records of the jobs that need no conversion, by the jobs' names.
    waiting : list of Job
        The other jobs, which have to run, ordered by puppet.
    """

    settled: dict[str, Record]
    waiting: list[Job]


def new_run() -> str:
    """Return a unique name for a batch."""
    return uuid.uuid4().hex[:16]


def make_jobs(
    recordings: Sequence[Recording], puppets: Sequence[Path], batch: BatchSettings, shard: Shard | None
) -> list[Job]:
    """Return the jobs for all recordings with all puppets, or for the performers of all recordings without a puppet.

    Each character is prepared, so that errors are found before the jobs start, and workers find it in the cache.

    Raises
    ------
    PuppetlineError
        A puppet or its character cannot be used, or two puppet files have the same name.
    """
    names: dict[str, Path] = {}
    for puppet in puppets:
        other = names.setdefault(puppet.stem, puppet)
        if other != puppet:
            raise PuppetError(
                puppet,
                found=f"the same name as {other}",
                expected="puppet files with different names, which name the folders of their results",
                fix="Rename one of them.",
            )
    jobs = []
    if batch.performer is not None:
        of_performers = performer_identity(batch.settings, batch.users, batch.ending)
        jobs = [Job(recording.name, recording.path, None, of_performers) for recording in recordings]
    for name, puppet in names.items():
        of_puppet = identity(load_prepared(puppet), batch.settings, batch.users)
        for recording in recordings:
            jobs.append(Job(f"{name}/{recording.name}", recording.path, puppet.absolute(), of_puppet))
    return [job for job in jobs if shard is None or shard.has(job.name)]


def make_plan(jobs: list[Job], batch: BatchSettings) -> BatchPlan:
    """Return the plan for jobs: those with a current record are settled, and the others wait."""
    store = Store(batch.folder, batch.run)
    records = ((job, store.load(job.name)) for job in jobs)
    settled = {job.name: record for job, record in records if record and is_settled(record, job, store, batch)}
    return BatchPlan(settled, [job for job in jobs if job.name not in settled])


def run(
    plan: BatchPlan, batch: BatchSettings, workers: int, check: Callable[[], None]
) -> Generator[Outcome, None, None]:
    """Run the waiting jobs of a plan, and yield each outcome as soon as it is known.

    Parameters
    ----------
    plan : BatchPlan
    batch : BatchSettings
        The folders of its store exist.
    workers : int
        Number of worker processes; 0 to run the jobs in this process.
    check : callable
        Called often; raises an error to stop.

    Raises
    ------
    PuppetlineError
        See `engine_bridge.batch.workers.convert_in_processes`.
    """
    outcomes = (
        convert_in_processes(plan.waiting, batch, workers, check)
        if workers
        else (convert_job(job, batch, check) for job in plan.waiting)
    )
    with closing(outcomes):
        for outcome in outcomes:
            yield outcome
            if batch.fail_fast and outcome.record.has_failed:
                return


def log_size(job: Job) -> int:
    """Return the size of a job's recording in bytes, at least 1; 1 if it cannot be read."""
    try:
        return max(job.log.stat().st_size, 1)
    except OSError:
        return 1
