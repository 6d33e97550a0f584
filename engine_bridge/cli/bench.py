"""`puppetline bench`: what a character costs on this machine."""

from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import progress


@click.command()
@click.option("--mesh", type=FILE, help="Character to measure.  [default: an example with 43,243 vertices]")
@options.as_json
def bench(mesh: Path | None, as_json: bool) -> None:
    """Measure the speed and memory of a character on this machine.

    This takes about a minute.
    """
    from engine_bridge.inspection import benchmark

    with progress() as report:
        measured = benchmark.bench(mesh, progress=report)
    options.show(measured, as_json, benchmark.describe(measured))
