"""`puppetline convert`: a recording becomes an animated character, or an animation of its performers."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import conversion, options
from engine_bridge.cli.options import FILE, Finite
from engine_bridge.cli.progress import progress

if TYPE_CHECKING:
    from engine_bridge.performance.settings import Settings


@click.command()
@click.argument("log", type=FILE)
@click.option(
    "--puppet",
    type=FILE,
    help="Puppet file of the character.  [default: none; the performer's own skeleton is animated]",
)
@options.output("The .glb file to write; without a puppet .bvh, .vrma or .glb.")
@click.option(
    "--user",
    type=int,
    help="User number of the performer.  [default: the one tracked longest; without a puppet, all, a file for each]",
)
@click.option(
    "--start", default=0.0, show_default=True, type=Finite(0), metavar="SECONDS", help="Time at which the clip begins."
)
@click.option(
    "--stop", type=Finite(0), metavar="SECONDS", help="Time at which it ends.  [default: the recording's end]"
)
@conversion.settings_options
@click.option("--preview", type=FILE, metavar="PNG", help="Draw a contact sheet of the clip to this file.")
@options.as_json
def convert(log: Path, puppet: Path | None, output: Path, preview: Path | None, as_json: bool, **choices: Any) -> None:
    """Convert a recording LOG to an animated .glb of a character, or to an animation of its performers."""
    from engine_bridge.export.convert import convert, describe
    from engine_bridge.pictures import clip_sheet
    from puppetline.files import check_writable

    conversion.check_output(output, puppet is not None)
    if puppet is None:
        conversion.refuse_without_puppet(preview=preview, **choices)
        _convert_performers(log, output, conversion.settings(**choices), as_json)
        return
    settings = conversion.settings(**choices)
    if preview is not None:
        check_writable(preview, ".png", inputs=(log, puppet))
    with progress() as report:
        clip, summary = convert(log, puppet, output, settings, report)
        if preview is not None:
            title = f"{puppet.stem} · {log.stem}"
            clip_sheet.draw(clip, preview, title, lambda share: report("Drawing", share), file=output)
    options.show(summary, as_json, describe(summary))


def _convert_performers(log: Path, output: Path, settings: "Settings", as_json: bool) -> None:
    """Convert a recording to animations of its performers."""
    from engine_bridge.export.performer.convert import convert_performers, describe

    with progress() as report:
        made = convert_performers(log, output, settings, report)
    options.show(made, as_json, describe(made))
