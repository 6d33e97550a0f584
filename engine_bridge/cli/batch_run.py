"""A batch as the command runs it: its preparation, progress and summary."""

import os
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from engine_bridge.batch import manifest
from engine_bridge.batch.batch import Plan, Shard, Workers, log_size, make_jobs, make_plan, new_run
from engine_bridge.batch.batch import run as run_plan
from engine_bridge.batch.conversion import BatchSettings, Outcome
from engine_bridge.batch.recordings import find_recordings
from engine_bridge.batch.row import Row
from engine_bridge.batch.store import Store
from engine_bridge.cli.progress import interrupts, progress
from engine_bridge.performance.settings import Settings

MAX_REASONS = 20
"""Maximum number of rows in the table of reasons."""

NUMBER = re.compile(r"\d[\d.,]*")
"""Numbers in reasons, which do not make them different."""


@dataclass(frozen=True)
class Choices:
    """What a user chose; see the options of the command."""

    logs: tuple[str, ...]
    puppets: tuple[Path, ...]
    output: Path
    users: str
    workers: int | None
    scheduler: str | None
    dashboard: bool
    shard: Shard | None
    manifest: Path | None
    fail_fast: bool
    retry_failed: bool
    settings: Settings

    FIELDS: ClassVar = (
        "logs",
        "puppets",
        "output",
        "users",
        "workers",
        "scheduler",
        "dashboard",
        "shard",
        "manifest",
        "fail_fast",
        "retry_failed",
    )

    @property
    def manifest_path(self) -> Path:
        """The chosen path of the manifest, or the default one."""
        if self.manifest is not None:
            return self.manifest
        part = "" if self.shard is None else f".{self.shard.index}-of-{self.shard.count}"
        return self.output / f"manifest{part}.parquet"

    @property
    def where(self) -> Workers:
        """The chosen workers, or the default ones."""
        count = self.workers
        if count is None:
            count = 0 if self.shard is not None else len(os.sched_getaffinity(0))
        return Workers(count, self.scheduler, self.dashboard)


@dataclass(frozen=True)
class Result:
    """What a batch did.

    `results` and `failed` count rows of its jobs, `made` and `unchanged` those that were and were not converted now.
    """

    folder: str
    manifest: str
    results: int
    made: int
    unchanged: int
    failed: int
    seconds: float
    others: tuple[str, ...]
    failures: tuple[Row, ...]

    @property
    def per_hour(self) -> float:
        """Recordings per hour."""
        return 3600 * self.made / self.seconds if self.made else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        failures = [
            {name: getattr(row, name) for name in ("log", "puppet", "user", "message")} for row in self.failures
        ]
        return asdict(self) | {"clips_per_hour": self.per_hour, "failures": failures}


def list_waiting(choices: Choices) -> list[str]:
    """Return the names of the results that are missing or out of date."""
    _, plan = _prepare(choices, _batch_settings(choices), lambda _step, _share: None)
    return [job.name for job in plan.waiting]


def run(choices: Choices) -> Result:
    """Run a batch, and write its manifest.

    Raises
    ------
    PuppetlineError
    """
    batch = _batch_settings(choices)
    store, path = Store(batch.folder, batch.run), choices.manifest_path
    store.create()
    manifest.check_manifest(path)
    with progress() as report:
        others, plan = _prepare(choices, batch, report)
    start = time.perf_counter()
    outcomes = []
    try:
        with _shown(plan) as show:
            for outcome in run_plan(plan, batch, choices.where):
                outcomes.append(outcome)
                show(outcome)
    finally:
        seconds = time.perf_counter() - start
        records = [*plan.settled.values(), *(outcome.record for outcome in outcomes)]
        rows = [row for record in records for row in record.rows]
        if choices.shard is None:
            manifest.write_whole_manifest(path, store)
        else:
            manifest.write_manifest(path, sorted(rows, key=lambda row: (row.output, row.puppet, row.log)))
    failures = tuple(row for row in rows if row.state == "failed")
    return Result(
        folder=str(choices.output),
        manifest=str(path),
        results=len(rows) - len(failures),
        made=sum(row.state == "done" for outcome in outcomes for row in outcome.record.rows),
        unchanged=sum(row.state == "done" for record in plan.settled.values() for row in record.rows),
        failed=len(failures),
        seconds=seconds,
        others=tuple(map(str, others)),
        failures=failures,
    )


def describe(result: Result) -> str:
    """Return the result of a batch as lines of text."""
    lines = [
        f"{result.folder}: {result.results:,} results, {result.made:,} made now"
        + (f" ({result.per_hour:,.0f} per hour)" if result.made else "")
        + f", {result.unchanged:,} unchanged, {result.failed:,} failed",
        f"  manifest  {result.manifest}",
    ]
    if result.others:
        lines.append(f"  ignored   {len(result.others):,} files that are no recordings, such as {result.others[0]}")
    if result.failures:
        lines += ["", *_reasons(result.failures)]
    return "\n".join(lines)


def _reasons(failures: Sequence[Row]) -> list[str]:
    """Return a table of the reasons of failures, the most frequent first."""
    kinds = {id(row): NUMBER.sub("#", row.reason) for row in failures}
    counts = Counter(kinds.values())
    first: dict[str, Row] = {}
    for row in failures:
        first.setdefault(kinds[id(row)], row)
    lines = ["   failed  reason, and the first recording"]
    for kind, count in counts.most_common(MAX_REASONS):
        lines += [f"  {count:7,}  {first[kind].reason}", f"           {first[kind].message}"]
    if len(counts) > MAX_REASONS:
        lines.append(f"           … and {len(counts) - MAX_REASONS:,} other reasons, see the manifest")
    return lines


def _batch_settings(choices: Choices) -> BatchSettings:
    return BatchSettings(
        choices.output.absolute(),
        new_run(),
        choices.settings,
        choices.users,
        fail_fast=choices.fail_fast,
        retry_failed=choices.retry_failed,
    )


def _prepare(choices: Choices, batch: BatchSettings, report: Callable[[str, float], None]) -> tuple[list[Path], Plan]:
    """Return the files that are no recordings, and the plan."""
    report("Looking for recordings", 0.0)
    recordings = find_recordings(choices.logs, choices.output)
    report("Looking for recordings", 1.0)
    report("Preparing the characters", 0.0)
    jobs = make_jobs(recordings.found, choices.puppets, choices.settings, choices.users, choices.shard)
    report("Preparing the characters", 1.0)
    report("Looking for results", 0.0)
    plan = make_plan(jobs, batch)
    report("Looking for results", 1.0)
    return recordings.others, plan


@contextmanager
def _shown(plan: Plan) -> Iterator[Callable[[Outcome], None]]:
    """Yield a function that shows an outcome: a bar with rate and time left on a terminal, nothing elsewhere."""
    with interrupts() as check:
        if not sys.stderr.isatty():
            yield lambda _outcome: check()
            return
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        columns = (
            TextColumn("Converting"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[pace]}"),
        )
        pace = Pace([log_size(job) for job in plan.waiting])
        with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
            task = bars.add_task("", total=len(plan.waiting), pace="")

            def show(outcome: Outcome) -> None:
                check()
                pace.add(log_size(outcome.job), failed=outcome.record.has_failed)
                bars.update(task, advance=1, pace=pace.describe(bars.tasks[0].elapsed or 0.0))

            yield show


class Pace:
    """Rate and time left of a batch.

    Parameters
    ----------
    sizes : sequence of int
        Sizes of all recordings in bytes; larger ones take longer.
    """

    def __init__(self, sizes: Sequence[int]) -> None:
        self._total, self._size = sum(sizes), 0
        self._count = self._failed = 0

    def add(self, size: int, *, failed: bool) -> None:
        """Count a recording that was converted, or that failed."""
        self._size += size
        self._count += 1
        self._failed += failed

    def describe(self, elapsed: float) -> str:
        """Return the rate, the time left and the number of failures after some seconds."""
        rate = 3600 * self._count / max(elapsed, 1e-3)
        left = elapsed * (self._total - self._size) / max(self._size, 1)
        hours, rest = divmod(round(left), 3600)
        minutes, seconds = divmod(rest, 60)
        failed = f" · {self._failed:,} failed" if self._failed else ""
        return f"{rate:,.0f} per hour · {hours}:{minutes:02}:{seconds:02} left{failed}"
