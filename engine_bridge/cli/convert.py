"""`puppetline convert`: a recording becomes an animated .glb."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE, Finite
from engine_bridge.cli.progress import progress

if TYPE_CHECKING:
    from engine_bridge.export.convert import Summary


@click.command()
@click.argument("log", type=FILE)
@click.option("--puppet", required=True, type=FILE, help="Puppet file of the character.")
@options.output("The .glb file to write.")
@click.option("--user", type=int, help="User number of the performer.  [default: the one tracked longest]")
@click.option(
    "--rest-at",
    default=0.0,
    show_default=True,
    type=Finite(0),
    metavar="SECONDS",
    help="Time at which the performer's pose matches the character's rest pose.",
)
@click.option("--fps", default=30.0, show_default=True, type=Finite(1, 240), help="Keyframes per second.")
@click.option(
    "--max-gap",
    default=0.4,
    show_default=True,
    type=Finite(0),
    metavar="SECONDS",
    help="Interpolate a joint over gaps up to this long; over longer gaps, hold its last position.",
)
@click.option(
    "--as",
    "form",
    default="morph",
    show_default=True,
    type=click.Choice(["morph", "skin", "frames", "rig"]),
    help="What is animated: a few morph targets; new bones with a skin; a morph target per keyframe, for short clips; "
    "or the joints of the skeleton in the character's file.",
)
@click.option(
    "--tolerance",
    type=Finite(0, 1, min_open=True),
    help="Largest error of a vertex, as a fraction of the character's diagonal.  [default: 0.0005; for a skin 0.002]",
)
@options.targets
@click.option(
    "--bones", type=click.IntRange(1, 128), metavar="N", help="Number of bones, whatever the error; with --as skin."
)
@click.option(
    "--compact", is_flag=True, help="Write small integers and fewer keyframes, within the tolerance; not for Godot."
)
@click.option("--meshopt", is_flag=True, help="Compress all arrays without loss, for three.js and Babylon.js.")
@click.option("--preview", type=FILE, metavar="PNG", help="Draw a contact sheet of the clip to this file.")
@click.option(
    "--log-fps", type=Finite(0, min_open=True), metavar="FPS", help="Frame rate of a recording without timestamps."
)
@click.option("--log-up", type=click.Choice(["y", "z"]), help="Up axis of a BVH recording.  [default: detected]")
@click.option(
    "--log-unit",
    type=Finite(0, min_open=True),
    metavar="METRES",
    help="Length unit of a BVH recording.  [default: detected]",
)
@options.as_json
def convert(log: Path, puppet: Path, output: Path, preview: Path | None, as_json: bool, **choices: Any) -> None:
    """Convert a recording LOG to an animated .glb."""
    from capture.formats.options import ReadOptions
    from engine_bridge.export.convert import convert
    from engine_bridge.performance.settings import Settings
    from engine_bridge.pictures import clip_sheet
    from puppetline.files import check_writable

    for option, form in (("targets", "morph"), ("bones", "skin")):
        if choices[option] is not None and choices["form"] != form:
            raise click.UsageError(f"--{option} requires --as {form}.")
    read_options = ReadOptions(fps=choices.pop("log_fps"), up=choices.pop("log_up"), unit=choices.pop("log_unit"))
    if preview is not None:
        check_writable(preview, ".png", inputs=(log, puppet))
    with progress() as report:
        clip, summary = convert(log, puppet, output, Settings(log=read_options, **choices), report)
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
    if summary.keyframes < summary.frames:
        lines.append(f"  keyframes      {summary.keyframes:,}; the other frames are interpolated within the tolerance")
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
    if summary.form == "frames" and not summary.error:
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
