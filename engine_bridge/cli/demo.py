"""`puppetline demo`: example characters, converted or streamed."""

from pathlib import Path

import click

from engine_bridge.cli import convert, serve
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import progress


@click.command()
@click.argument("characters", nargs=-1, metavar="[CHARACTER]...")
@click.option("-o", "--output", default="out", show_default=True, type=FILE, help="Folder for all files.")
@click.option("--live", is_flag=True, help="Stream the characters in a loop instead of converting them.")
def demo(characters: tuple[str, ...], output: Path, live: bool) -> None:
    """Animate example characters.

    CHARACTER is biped, dinosaur, dog, human, pegasus or all. The default is human and pegasus.
    """
    from engine_bridge.cli import examples

    names = tuple(examples.MOTIONS) if "all" in characters else characters or ("human", "pegasus")
    for name in names:
        if name not in examples.MOTIONS:
            raise click.UsageError(f"{name!r} is not one of the characters {', '.join(examples.MOTIONS)} or all.")
    if live:
        with progress() as report:
            prepared = [examples.prepare(name, output, report) for name in names]
        serve.serve_puppets([f"replay:{log}?loop" for log, _ in prepared], [puppet for _, puppet in prepared])
        return
    for name in names:
        with progress() as report:
            summary, sheet = examples.convert_example(name, output, report)
        click.echo(convert.describe(summary))
        click.echo(f"  contact sheet  {sheet}")
