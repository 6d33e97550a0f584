"""`puppetline convert`: a recording becomes an animated .glb."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import conversion, options
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import progress

if TYPE_CHECKING:
    from engine_bridge.export.convert import Summary


@click.command()
@click.argument("log", type=FILE)
@click.option("--puppet", required=True, type=FILE, help="Puppet file of the character.")
@options.output("The .glb file to write.")
@click.option("--user", type=int, help="User number of the performer.  [default: the one tracked longest]")
@conversion.settings_options
@click.option("--preview", type=FILE, metavar="PNG", help="Draw a contact sheet of the clip to this file.")
@options.as_json
def convert(log: Path, puppet: Path, output: Path, preview: Path | None, as_json: bool, **choices: Any) -> None:
    """Convert a recording LOG to an animated .glb."""
    from engine_bridge.export.convert import convert
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


def describe(summary: "Summary") -> str:
    """Return the summary of a conversion as lines of text."""
    lines = [
        f"{summary.output}: {summary.frames:,} frames, {summary.seconds:.1f} s, {summary.bytes / 1e6:.1f} MB",
        _describe_form(summary),
    ]
    stretch = (summary.stretch_p1, summary.stretch_p50, summary.stretch_p99)
    if None not in stretch:
        lines.append(f"  edge stretch   {' / '.join(f'{each:.3f}' for each in stretch)} (1st, 50th, 99th percentile)")
    if summary.parts_apart is not None:
        lines.append(f"  parts apart    at most {summary.parts_apart:.2g} of the diagonal")
    if summary.repairs:
        lines.append(f"  solver's copy  {'; '.join(summary.repairs)}")
    lines += [f"  note: {note}" for note in summary.notes]
    return "\n".join(lines)


def _describe_form(summary: "Summary") -> str:
    """Return what the animation consists of, and its error."""
    if summary.form == "frames":
        return f"  morph targets  {summary.targets}, one for each keyframe, exactly as solved"
    if summary.form == "rig":
        return (
            f"  joints         {summary.bones} animated, {summary.following} follow; "
            f"at most {summary.error:.2g} of the diagonal from where their bones take them"
        )
    name, count = ("bones", summary.bones) if summary.form == "skin" else ("morph targets", summary.targets)
    over = "" if summary.error <= summary.tolerance else f": the closest with this number of {name.split()[-1]}"
    mean = "" if summary.rms is None else f", root mean square {summary.rms:.2g}"
    return (
        f"  {name:13}  {count}, largest error {summary.error:.2g} of the diagonal{mean} "
        f"(tolerance {summary.tolerance:g}){over}"
    )
