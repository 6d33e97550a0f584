"""A whole batch: its preparation, its run with a manifest and a report, and a summary."""

import re
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from capture.formats.kinds import refusal
from engine_bridge.batch import manifest
from engine_bridge.batch.batch import BatchPlan, Shard, make_jobs, make_plan
from engine_bridge.batch.batch import run as run_plan
from engine_bridge.batch.conversion import BatchSettings, Outcome
from engine_bridge.batch.recordings import find_recordings
from engine_bridge.batch.report import write_report
from engine_bridge.batch.row import Row
from engine_bridge.batch.store import Store
from puppetline.errors import PuppetlineError

MAX_REASONS = 20
"""Maximum number of rows in the table of reasons."""

NUMBER = re.compile(r"\d[\d.,]*")
"""Numbers in reasons, which do not make them different."""


@dataclass(frozen=True)
class Result:
    """What a batch did.

    `made` and `unchanged` count the results of its jobs that were and were not converted now, and `per_hour` is the
    number of recordings per hour. `others` are files that are no recordings.
    """

    folder: str
    manifest: str
    report: str | None
    made: int
    unchanged: int
    per_hour: float
    others: tuple[str, ...]
    failures: tuple[Row, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        failures = [
            {name: getattr(row, name) for name in ("log", "puppet", "user", "message")} for row in self.failures
        ]
        return asdict(self) | {"failures": failures}


def prepare(
    logs: Sequence[str],
    puppets: Sequence[Path],
    batch: BatchSettings,
    shard: Shard | None,
    report: Callable[[str, float], None],
) -> tuple[list[Path], BatchPlan]:
    """Return the files that are no recordings, and the plan for the others.

    Raises
    ------
    PuppetlineError
    """
    report("Looking for recordings", 0.0)
    recordings = find_recordings(logs, batch.folder, batch.settings.log)
    report("Looking for recordings", 1.0)
    step = "Preparing the characters" if puppets else "Listing the results"
    report(step, 0.0)
    jobs = make_jobs(recordings.found, puppets, batch, shard)
    report(step, 1.0)
    report("Looking for results", 0.0)
    plan = make_plan(jobs, batch)
    report("Looking for results", 1.0)
    return recordings.others, plan


def run(
    plan: BatchPlan,
    others: Sequence[Path],
    batch: BatchSettings,
    shard: Shard | None,
    workers: int,
    table: Path,
    page: Path | None,
    check: Callable[[], None],
    show: Callable[[Outcome], None],
    draw: Callable[[float], None],
) -> Result:
    """Run a batch, and write its manifest and report.

    Parameters
    ----------
    plan, others
        From `prepare`.
    batch : BatchSettings
    shard : Shard or None
        The part of the batch; None for all of it.
    workers : int
        Number of worker processes; 0 for none.
    table : Path
        The manifest.
    page : Path or None
        The report; None for none.
    check : callable
        Called often; what it raises ends the batch, and the manifest is written.
    show : callable
        Called with each outcome.
    draw : callable
        Called with the share of the report that is drawn.

    Raises
    ------
    PuppetlineError
    """
    store = Store(batch.folder, batch.run)
    with store.opened():
        manifest.check_manifest(table)
        start = time.perf_counter()
        outcomes: list[Outcome] = []
        try:
            for outcome in run_plan(plan, batch, workers, check):
                outcomes.append(outcome)
                show(outcome)
        except BaseException:
            with suppress(PuppetlineError):  # such as a full disk, which is being reported
                _write_manifest(shard, store, table, plan, outcomes)
            raise
        seconds = time.perf_counter() - start
        rows = _write_manifest(shard, store, table, plan, outcomes)
        if page is not None:
            write_report(page, rows, store, batch, draw)
    new = [row for outcome in outcomes for row in outcome.record.rows]
    old = [row for record in plan.settled.values() for row in record.rows]
    failures = tuple(row for row in (*old, *new) if row.state == "failed")
    made, unchanged = (sum(row.state == "done" for row in part) for part in (new, old))
    return Result(
        folder=str(store.folder),
        manifest=str(table),
        report=None if page is None else str(page),
        made=made,
        unchanged=unchanged,
        per_hour=3600 * len(outcomes) / seconds,
        others=tuple(map(str, others)),
        failures=failures,
    )


def describe(result: Result) -> str:
    """Return the result of a batch as lines of text."""
    rate = f" ({result.per_hour:,.0f} per hour)" if result.made else ""
    lines = [
        f"{result.folder}: {result.made:,} made{rate}, {result.unchanged:,} unchanged, {len(result.failures):,} failed",
        f"  manifest  {result.manifest}",
    ]
    if result.report:
        lines.append(f"  report    {result.report}")
    if result.others:
        lines.append(f"  ignored   {len(result.others):,} files that are no recordings:")
        lines += [f"            {other}: {refusal(Path(other)).found}" for other in result.others[:MAX_REASONS]]
        if len(result.others) > MAX_REASONS:
            lines.append(f"            … and {len(result.others) - MAX_REASONS:,} others")
    if result.failures:
        lines += ["", *_reasons(result.failures)]
    return "\n".join(lines)


def _reasons(failures: Sequence[Row]) -> list[str]:
    """Return a table of the reasons of failures, the most frequent first."""
    kinds: dict[str, list[Row]] = {}
    for row in failures:
        kinds.setdefault(NUMBER.sub("#", row.reason), []).append(row)
    frequent = sorted(kinds.values(), key=len, reverse=True)
    lines = ["   failed  reason, for the first recording"]
    lines += [f"  {len(rows):7,}  {rows[0].message}" for rows in frequent[:MAX_REASONS]]
    if len(frequent) > MAX_REASONS:
        lines.append(f"           … and {len(frequent) - MAX_REASONS:,} other reasons, see the manifest")
    return lines


def _write_manifest(
    shard: Shard | None, store: Store, path: Path, plan: BatchPlan, outcomes: Sequence[Outcome]
) -> Sequence[Row]:
    """Write the rows of a shard, or those of all results in the folder, and return them."""
    if shard is None:
        return manifest.write_whole_manifest(path, store)
    records = plan.settled | {outcome.job.name: outcome.record for outcome in outcomes}
    rows = [row for _, record in sorted(records.items()) for row in record.rows]
    manifest.write_manifest(path, rows)
    return rows
