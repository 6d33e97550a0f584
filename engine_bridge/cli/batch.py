"""`puppetline batch`: many recordings become animated .glb files of several characters."""

from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import conversion, options
from engine_bridge.cli.options import FILE

if TYPE_CHECKING:
    from engine_bridge.batch.batch import Shard


class PartOfBatch(click.ParamType):  # type: ignore[type-arg]  # generic in newer versions of click only
    """A part of a batch, such as 3/16."""

    name = "I/N"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> "Shard":
        """Read a part, or report why it is refused."""
        from engine_bridge.batch.batch import Shard

        index, _, count = str(value).partition("/")
        if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
            self.fail(f"{value} is not a part like 3/16, from 1/16 to 16/16.", param, ctx)
        return Shard(int(index), int(count))


@click.command()
@click.argument("logs", nargs=-1, required=True)
@click.option(
    "--puppet", "puppets", required=True, multiple=True, type=FILE, help="Puppet file of a character. Can be repeated."
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
    help="Worker processes on this machine; 0 converts in the command's own process, without Dask.  "
    "[default: one per CPU; with --shard 0]",
)
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of this Dask scheduler, such as tcp://head:8786.")
@click.option("--dashboard", is_flag=True, help="Serve Dask's dashboard on http://127.0.0.1:8787/status.")
@click.option(
    "--shard", type=PartOfBatch(), help="Convert only this part of the results, such as 3/16, for array jobs."
)
@click.option(
    "--manifest",
    type=FILE,
    help="Table of all results, .parquet or .csv.  [default: manifest.parquet in the folder; with --shard, "
    "manifest.I-of-N.parquet]",
)
@click.option("--fail-fast", is_flag=True, help="Stop after the first failure.")
@click.option("--retry-failed", is_flag=True, help="Try recordings again that failed in an earlier batch.")
@click.option("--dry-run", is_flag=True, help="List the results that would be made, and make nothing.")
@options.as_json
def batch(as_json: bool, dry_run: bool, **choices: Any) -> None:
    """Convert many recordings LOGS with one or more characters.

    LOGS are files, folders, quoted patterns like 'data/**/*.txt', and @LIST for a file with one of these per line.

    The command can be stopped or killed at any time. Run it again to continue: results that are up to date are kept.
    """
    from engine_bridge.cli import batch_run

    if choices["scheduler"] is not None and (choices["workers"] is not None or choices["dashboard"]):
        raise click.UsageError("--scheduler excludes --workers and --dashboard.")
    own = {name: choices.pop(name) for name in batch_run.Choices.FIELDS}
    chosen = batch_run.Choices(**own, settings=conversion.settings(user=None, **choices))
    if dry_run:
        names = batch_run.list_waiting(chosen)
        options.echo_json({"waiting": names}) if as_json else click.echo("\n".join(names), nl=bool(names))
        return
    result = batch_run.run(chosen)
    if as_json:
        options.echo_json(result.as_dict())
    else:
        click.echo(batch_run.describe(result))
    if result.failed:
        raise click.exceptions.Exit(1)
