"""The command line: parses, calls, prints. Everything heavy is imported by the command that needs it."""

import json
import logging
import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import live as live_commands
from engine_bridge.cli.command_line import FILE, Finite, interrupts, progress
from puppetline.errors import PuppetlineError

if TYPE_CHECKING:
    from engine_bridge.export.convert import Summary
    from engine_bridge.puppet.puppet import Direction


class _Commands(click.Group):
    """Turns the one error family into a line on standard error and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with interrupts():
                return super().invoke(ctx)
        except PuppetlineError as error:
            click.echo(f"puppetline: {error}", err=True)
            ctx.exit(1)
        except (click.ClickException, click.exceptions.Exit):
            raise
        except KeyboardInterrupt:
            click.echo("puppetline: stopped", err=True)
            ctx.exit(1)
        except BrokenPipeError:  # whoever read the output has gone; click ends quietly
            raise
        except Exception as error:
            if os.environ.get("PUPPETLINE_DEBUG"):
                raise
            click.echo(
                f"puppetline: a fault in Puppetline itself: {type(error).__name__}: {error}. "
                "Please report it with the output of the same command under PUPPETLINE_DEBUG=1.",
                err=True,
            )
            ctx.exit(1)


AXIS = click.Choice(["x", "-x", "y", "-y", "z", "-z"])


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="puppetline")
def main() -> None:
    """Move any character mesh with a performer's skeleton."""
    logging.basicConfig(format="puppetline: %(message)s", level=logging.WARNING)


@main.command()
@click.argument("characters", nargs=-1, metavar="[CHARACTER]...")
@click.option("-o", "--output", default="out", show_default=True, type=FILE, help="Folder for everything that is made.")
@click.option("--live", is_flag=True, help="Stream them, over and over, instead of converting: puppetline serve.")
def demo(characters: tuple[str, ...], output: Path, live: bool) -> None:
    """Animate example characters: human and pegasus, or those named, or "all" five."""
    from engine_bridge.cli.demo import CASTING, play, prepare

    chosen = CASTING if "all" in characters else characters or ("human", "pegasus")
    for name in chosen:
        if name not in CASTING:
            raise click.UsageError(f"{name!r} is none of the characters {', '.join(CASTING)}, or all.")
    if live:
        with progress() as report:
            made = [prepare(name, output, report) for name in chosen]
        live_commands.stream([f"replay:{log}?loop" for log, _ in made], [puppet for _, puppet in made])
        return
    for name in chosen:
        with progress() as report:
            summary, picture = play(name, output, report)
        click.echo(_describe(summary))
        click.echo(f"  contact sheet  {picture}")


@main.command()
@click.argument("log", type=FILE)
@click.option("--puppet", required=True, type=FILE, help="Puppet file: the character, its handles, what moves them.")
@click.option("-o", "--output", required=True, type=FILE, help="The .glb to write.")
@click.option("--user", type=int, help="The performer to take. [default: the longest tracked]")
@click.option(
    "--rest-at",
    default=0.0,
    show_default=True,
    type=Finite(0),
    metavar="SECONDS",
    help="When the performer stands as the character does at rest.",
)
@click.option("--fps", default=30.0, show_default=True, type=Finite(1, 240), help="Keyframes a second.")
@click.option(
    "--max-gap",
    default=0.4,
    show_default=True,
    type=Finite(0),
    metavar="SECONDS",
    help="Bridge joints that are lost for no longer than this; hold them over longer gaps.",
)
@click.option(
    "--as",
    "form",
    default="morph",
    show_default=True,
    type=click.Choice(["morph", "skin", "frames", "rig"]),
    help="A few morph targets; bones that the mesh is bound to; a morph target for each keyframe, for short clips; or "
    "the joints of the skeleton that the character's file has.",
)
@click.option(
    "--tolerance",
    type=Finite(0, 1, min_open=True),
    help="Largest error of a vertex, as a fraction of the character's diagonal.  [default: 0.0005; of a skin 0.002]",
)
@click.option("--targets", type=click.IntRange(2), metavar="K", help="At most K morph targets, whatever the error.")
@click.option("--bones", type=click.IntRange(1, 128), metavar="N", help="N bones, whatever the error; with --as skin.")
@click.option("--preview", type=FILE, metavar="PNG", help="Draw a contact sheet of the clip as well.")
@click.option("--log-fps", type=Finite(0, min_open=True), metavar="FPS", help="For logs without a clock.")
@click.option("--log-up", type=click.Choice(["y", "z"]), help="For BVH. [default: detected]")
@click.option("--log-unit", type=Finite(0, min_open=True), metavar="METRES", help="For BVH. [default: detected]")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def convert(log: Path, puppet: Path, output: Path, preview: Path | None, as_json: bool, **choices: Any) -> None:
    """Turn a recorded skeleton LOG into an animated .glb."""
    from capture.formats.options import ReadOptions
    from engine_bridge.export.convert import convert as run
    from engine_bridge.performance.settings import Settings
    from engine_bridge.pictures import sheet
    from puppetline.files import check_writable

    for option, form in (("targets", "morph"), ("bones", "skin")):
        if choices[option] is not None and choices["form"] != form:
            raise click.UsageError(f"--{option} goes with --as {form}.")
    options = ReadOptions(fps=choices.pop("log_fps"), up=choices.pop("log_up"), unit=choices.pop("log_unit"))
    if preview is not None:
        check_writable(preview, ".png", inputs=(log, puppet))
    with progress() as report:
        clip, summary = run(log, puppet, output, Settings(log=options, **choices), report)
        if preview is not None:
            sheet.draw(clip, preview, f"{puppet.stem} · {log.stem}", lambda share: report("Drawing", share))
    if as_json:
        click.echo(json.dumps(asdict(summary), indent=2))
    else:
        click.echo(_describe(summary))


def _describe(summary: "Summary") -> str:
    """Put a conversion's summary into a few lines."""
    stretch, apart = (summary.stretch_p1, summary.stretch_p50, summary.stretch_p99), summary.parts_apart
    return "\n".join(
        [
            f"{summary.output}: {summary.frames:,} frames, {summary.seconds:.1f} s, {summary.bytes / 1e6:.1f} MB",
            _describe_form(summary),
            *(
                []
                if None in stretch
                else [f"  edge stretch   {' / '.join(f'{each:.3f}' for each in stretch)} (1st, 50th, 99th percentile)"]
            ),
            *([] if apart is None else [f"  parts apart    {apart:.2g} of the diagonal at most"]),
            *([f"  to solve for   {'; '.join(summary.repairs)}"] if summary.repairs else []),
            *(f"  note: {note}" for note in summary.notes),
        ]
    )


def _describe_form(summary: "Summary") -> str:
    """Say what the animation is made of, and how close it is."""
    if summary.form == "frames":
        return f"  morph targets  {summary.targets}, one for each keyframe, as solved"
    if summary.form == "rig":
        return (
            f"  joints         {summary.bones} animated, {summary.following} follow; "
            f"at most {summary.error:.2g} of the diagonal from where their bones take them"
        )
    name, count = ("bones", summary.bones) if summary.form == "skin" else ("morph targets", summary.targets)
    over = "" if summary.error <= summary.tolerance else f": as close as this number of {name.split()[-1]} comes"
    mean = "" if summary.rms is None else f", root mean square {summary.rms:.2g}"
    return (
        f"  {name:13}  {count}, largest error {summary.error:.2g} of the diagonal{mean} "
        f"(tolerance {summary.tolerance:g}){over}"
    )


@main.command()
@click.argument("mesh", type=FILE)
@click.option("-o", "--output", required=True, type=FILE, help="The puppet file to write.")
@click.option(
    "--handle",
    "handles",
    multiple=True,
    metavar="NAME=X,Y,Z",
    help="A handle of your own, instead of those proposed; can be repeated.",
)
@click.option(
    "--map",
    "maps",
    multiple=True,
    metavar="NAME=JOINT[,JOINT]",
    help="The joint that moves a handle, or several to average; for a limb one for each point; can be repeated.",
)
@click.option(
    "--limb",
    "ends",
    multiple=True,
    metavar="NAME=X,Y,Z",
    help="Where a limb ends that was not found, or named wrongly; can be repeated.",
)
@click.option("--up", type=AXIS, help="The mesh's own axis that points up.  [default: by its skeleton or shape]")
@click.option("--front", type=AXIS, help="The axis that it faces along.  [default: by its skeleton or shape]")
@click.option(
    "--scale",
    type=Finite(0, min_open=True),
    metavar="METRES",
    help="Metres a mesh unit.  [default: by the character's height]",
)
@click.option("--mirror", is_flag=True, help="The character is the performer's mirror image.")
@click.option("--preview", type=FILE, metavar="PNG", help="The picture of it.  [default: beside it, .handles.png]")
@click.option("--force", is_flag=True, help="Replace an existing puppet file.")
def new(
    mesh: Path,
    output: Path,
    handles: tuple[str, ...],
    maps: tuple[str, ...],
    ends: tuple[str, ...],
    up: "Direction | None",
    front: "Direction | None",
    scale: float | None,
    mirror: bool,
    preview: Path | None,
    force: bool,
) -> None:
    """Propose a puppet file for a MESH: its limbs, or handles where it has none, and joints to move them."""
    from engine_bridge.pictures import portrait
    from engine_bridge.puppet import proposal, puppet_file
    from puppetline.files import check_writable

    # not the plain name with .png, which is a texture's or a contact sheet's
    picture = preview or output.with_suffix(".handles.png")
    check_writable(output, ".toml", inputs=(mesh,))
    check_writable(picture, ".png", inputs=(mesh,))
    if output.exists() and not force:
        raise click.UsageError(f"{output} exists already; give --force to replace it.")
    proposed = proposal.new_puppet(
        mesh,
        output,
        handles=_pairs("--handle", handles),
        maps=_pairs("--map", maps),
        ends=_pairs("--limb", ends),
        up=up,
        front=front,
        scale=scale,
        mirror=mirror,
    )
    made = proposed.puppet
    puppet_file.dump(made, output)
    portrait.draw(made, proposed.character, picture, f"{output.stem} · {mesh.name}")
    counts = {"limbs": len(made.limb), "handles": len(made.handle)}
    listed = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
    click.echo(f"{output}: {listed}, shown in {picture}")
    for reason in proposed.assumed:
        click.echo(f"  assumed: {reason}")
    for note in proposed.notes:
        click.echo(f"  unclear: {note}")
    for limb in made.limb:
        gain = f" × {limb.gain:g}" if limb.gain != 1 else ""
        joints = ", ".join(" + ".join(dict.fromkeys(joints)) for joints in limb.driven_by)
        click.echo(f"  {limb.name:16} ({limb.follow})  ←  {joints}{gain}")
    for handle in made.handle:
        place = ", ".join(f"{value:.4g}" for value in handle.position)
        gain = f" × {handle.gain:g}" if handle.gain != 1 else ""
        click.echo(f"  {handle.name:16} ({place})  ←  {' + '.join(handle.driven_by) or 'stays'}{gain}")
    click.echo(f"Play it:  puppetline convert LOG --puppet {output} -o OUT.glb")


def _pairs(option: str, values: tuple[str, ...]) -> dict[str, str]:
    """Split NAME=VALUE options."""
    pairs = dict(value.rpartition("=")[::2] for value in values)
    if len(pairs) < len(values) or not all(name and value for name, value in pairs.items()):
        raise click.UsageError(f"{option} wants NAME=VALUE, each name once.")
    return pairs


@main.command()
@click.argument("file", type=FILE)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def inspect(file: Path, as_json: bool) -> None:
    """Say what a mesh, a skeleton log, a puppet file or a .glb holds."""
    from engine_bridge.cli.inspection import inspect as look

    facts = look(file)
    click.echo(json.dumps(facts, indent=2) if as_json else "\n".join(_outline(facts)))


def _outline(value: Any, depth: int = 0) -> Iterator[str]:
    """Lay nested values out as indented lines."""
    for key, item in value.items() if isinstance(value, dict) else enumerate(value, 1):
        label = f"{'  ' * depth}{str(key).replace('_', ' ')}"
        if isinstance(item, (dict, list)) and item and isinstance(next(iter(item)), (dict, str, list)):
            yield f"{label}:"
            yield from _outline(item, depth + 1)
        elif isinstance(item, list):
            yield f"{label}: {', '.join(map(_plain, item)) or 'none'}"
        else:
            yield f"{label}: {_plain(item)}"


def _plain(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    return f"{value:.5g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)


@main.command()
@click.option("--mesh", type=FILE, help="The character to measure.  [default: an example of 43,243 vertices]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def bench(mesh: Path | None, as_json: bool) -> None:
    """Measure what a character costs on this machine; takes a minute or two."""
    from engine_bridge.cli import bench as benchmark

    with progress() as report:
        measured = benchmark.bench(mesh, progress=report)
    click.echo(json.dumps(measured.as_dict(), indent=2) if as_json else benchmark.describe(measured))


for command in live_commands.COMMANDS:
    main.add_command(command)
