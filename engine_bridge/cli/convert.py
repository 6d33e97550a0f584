"""`puppetline convert`: a recording becomes an animated .glb."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from engine_bridge.cli import conversion, options
from engine_bridge.cli.options import FILE, Finite
from engine_bridge.cli.progress import progress


@click.command()
@click.argument("log", type=FILE)
@click.option("--puppet", required=True, type=FILE, help="Puppet file of the character.")
@options.output("The .glb file to write.")
@click.option("--user", type=int, help="User number of the performer.  [default: the one tracked longest]")
@click.option(
    "--start", default=0.0, show_default=True, type=Finite(0), metavar="SECONDS", help="Time at which the clip begins."
)
@click.option(
    "--stop", type=Finite(0), metavar="SECONDS", help="Time at which it ends.  [default: the recording's end]"
)
@conversion.settings_options
@click.option("--preview", type=FILE, metavar="PNG", help="Draw a contact sheet of the clip to this file.")
@options.as_json
def convert(log: Path, puppet: Path, output: Path, preview: Path | None, as_json: bool, **choices: Any) -> None:
    """Convert a recording LOG to an animated .glb."""
    from engine_bridge.export.convert import convert, describe
    from engine_bridge.pictures import clip_sheet
    from puppetline.files import check_writable

    settings = conversion.settings(**choices)
    if preview is not None:
        check_writable(preview, ".png", inputs=(log, puppet))
    with progress() as report:
        clip, summary = convert(log, puppet, output, settings, report)
        if preview is not None:
            clip_sheet.draw(clip, preview, f"{puppet.stem} · {log.stem}", lambda share: report("Drawing", share))
    if as_json:
        options.echo_json(asdict(summary))
    else:
        click.echo(describe(summary))
