"""`puppetline convert`: a recording becomes an animated character, or an animation of its performers."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import conversion, options
from engine_bridge.cli.options import FILE
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
@options.output(
    "The .glb file to write; without a puppet .bvh, .vrma or .glb, a file for each performer.",
    "PUPPET_LOG.glb; without a puppet, none",
)
@conversion.clip_options
@click.option("--preview", type=FILE, metavar="PNG", help="Draw a contact sheet of the clip to this file.")
@options.force
@options.as_json
def convert(
    log: Path,
    puppet: Path | None,
    output: Path | None,
    preview: Path | None,
    force: bool,
    as_json: bool,
    **choices: Any,
) -> None:
    """Convert a recording LOG to an animated .glb of a character, or to an animation of its performers."""
    from engine_bridge.export.convert import convert, describe
    from engine_bridge.pictures import clip_sheet
    from puppetline.files import check_writable

    if puppet is None:
        if output is None:
            raise click.UsageError("Without --puppet, --output is required: a .bvh, .vrma or .glb file.")
        conversion.check_output(output, has_puppet=False)
        conversion.refuse_without_puppet(preview=preview, **choices)
        _convert_performers(log, output, conversion.settings(**choices), as_json)
        return
    output = options.named(output, f"{puppet.stem}_{log.stem}.glb", force)
    conversion.check_output(output, has_puppet=True)
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
