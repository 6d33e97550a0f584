"""`puppetline batch`: many recordings become animated characters, or animations of their performers."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import conversion, options
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import interrupts, progress

if TYPE_CHECKING:
    from engine_bridge.batch.batch import BatchPlan, Shard
    from engine_bridge.batch.conversion import Outcome
    from engine_bridge.performance.settings import PerformerFormat


PACE_SECONDS = 3600.0
"""Time over which the speed is averaged that determines the time left, in seconds."""


def part_of_batch(_ctx: click.Context, _param: click.Parameter, value: str | None) -> "Shard | None":
    """Read a part of a batch, such as 3/16, or report why it is refused."""
    from engine_bridge.batch.batch import Shard

    if value is None:
        return None
    index, _, count = value.partition("/")
    if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise click.BadParameter(f"{value} is not a part like 3/16, from 1/16 to 16/16.")
    return Shard(int(index), int(count))


@click.command()
@click.argument("logs", nargs=-1, required=True)
@click.option("--puppet", "puppets", multiple=True, type=FILE, help="Puppet file of a character. Can be repeated.")
@click.option(
    "--performer",
    type=click.Choice(["bvh", "vrma", "glb"]),
    help="Instead of characters, write the performers' own skeletons in this format.",
)
@options.output("Folder for the results; it is created if it does not exist.")
@click.option(
    "--users",
    default="longest",
    show_default=True,
    type=click.Choice(["longest", "all"]),
    help="Convert the performer of a recording who is tracked longest, or each one to a file of its own.",
)
@conversion.settings_options
@click.option(
    "--workers",
    type=click.IntRange(0),
    metavar="N",
    help="Worker processes; 0 converts in the command's own process.  [default: one per CPU; with --shard 0]",
)
@click.option(
    "--shard",
    metavar="I/N",
    callback=part_of_batch,
    help="Convert only this part of the results, such as 3/16, for array jobs.",
)
@click.option(
    "--manifest",
    type=FILE,
    help="Table of all results, .parquet or .csv.  [default: manifest.parquet in the folder; with --shard, "
    "manifest.I-of-N.parquet]",
)
@click.option(
    "--report/--no-report",
    default=True,
    show_default=True,
    help="Write report.html with histograms and the worst results; not with --shard.",
)
@click.option("--fail-fast", is_flag=True, help="Stop after the first failure.")
@click.option("--retry-failed", is_flag=True, help="Try recordings again that failed in an earlier batch.")
@click.option("--dry-run", is_flag=True, help="List the results that would be made, and make nothing.")
@options.as_json
def batch(
    logs: tuple[str, ...],
    puppets: tuple[Path, ...],
    performer: "PerformerFormat | None",
    output: Path,
    users: str,
    workers: int | None,
    shard: "Shard | None",
    manifest: Path | None,
    report: bool,
    fail_fast: bool,
    retry_failed: bool,
    dry_run: bool,
    as_json: bool,
    **choices: Any,
) -> None:
    """Convert many recordings LOGS with one or more characters, or to animations of their performers.

    LOGS are files, folders, quoted patterns like 'data/**/*.txt', and @LIST for a file with one of these per line.

    The command can be stopped or killed at any time. Run it again to continue: results that are up to date are kept.
    """
    from engine_bridge.batch import run
    from engine_bridge.batch.batch import new_run
    from engine_bridge.batch.conversion import BatchSettings
    from puppetline.child_process import processor_count

    if workers is None:
        workers = processor_count() if shard is None else 0
    if bool(puppets) == (performer is not None):
        raise click.UsageError("Name characters with --puppet, or choose a format with --performer.")
    if performer is not None:
        conversion.refuse_without_puppet(**choices)
    settings = conversion.settings(user=None, **choices)
    given = BatchSettings(output.absolute(), new_run(), settings, users, performer, fail_fast, retry_failed)
    with progress() as show:
        others, plan = run.prepare(logs, tuple(dict.fromkeys(puppets)), given, shard, show)
    if dry_run:
        ending = (".user*" if users == "all" else "") + given.ending
        names = [job.name + ending for job in plan.waiting]
        if as_json or names:
            options.show({"waiting": names}, as_json, *names)
        return
    part = "" if shard is None else f".{shard.index}-of-{shard.count}"
    table = manifest or output / f"manifest{part}.parquet"
    page = output / "report.html" if report and shard is None else None
    with shown(plan) as shows:
        result = run.run(plan, others, given, shard, workers, table, page, *shows)
    options.show(result.as_dict(), as_json, run.describe(result))
    if result.failures:
        raise click.exceptions.Exit(1)


@contextmanager
def shown(
    plan: "BatchPlan",
) -> "Iterator[tuple[Callable[[], None], Callable[[Outcome], None], Callable[[float], None]]]":
    """Yield functions that raise Ctrl-C, show an outcome, and show the share of the report that is drawn.

    On a terminal, they update a bar with rate and time left; elsewhere, they show nothing.
    """
    with interrupts() as check:
        if not sys.stderr.isatty():
            yield check, lambda _outcome: None, lambda _share: check()
            return
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        from engine_bridge.batch.batch import log_size

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[pace]}"),
            TimeRemainingColumn(),
        )
        show_on = Console(stderr=True)
        with Progress(*columns, console=show_on, transient=True, speed_estimate_period=PACE_SECONDS) as bars:
            task = bars.add_task("Converting", total=sum(map(log_size, plan.waiting)), pace="")
            done: list[Outcome] = []

            def show(outcome: "Outcome") -> None:
                done.append(outcome)
                failed = sum(each.record.has_failed for each in done)
                rate = 3600 * len(done) / max(bars.tasks[0].elapsed or 0.0, 1e-3)
                pace = f"{len(done):,}/{len(plan.waiting):,} · {rate:,.0f} per hour"
                pace += f" · {failed:,} failed" if failed else ""
                bars.update(task, advance=log_size(outcome.job), pace=pace)

            def draw(share: float) -> None:
                check()
                bars.update(task, description="Drawing the worst results", completed=share, total=1.0, pace="")

            yield check, show, draw
