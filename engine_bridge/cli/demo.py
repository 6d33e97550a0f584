"""`puppetline demo`: example characters, converted or streamed."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from engine_bridge.cli import serve
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import Reporter, progress

if TYPE_CHECKING:
    from engine_bridge.export.convert import Summary


@click.command()
@click.argument("characters", nargs=-1, metavar="[CHARACTER]...")
@click.option("-o", "--output", default="out", show_default=True, type=FILE, help="Folder for all files.")
@click.option("--live", is_flag=True, help="Stream the characters in a loop instead of converting them.")
@click.option("--film", "as_film", is_flag=True, help="Make a film of two characters, with sound: film.mp4.")
def demo(characters: tuple[str, ...], output: Path, live: bool, as_film: bool) -> None:
    """Animate example characters.

    CHARACTER is biped, dinosaur, dog, human, pegasus or all. The default is human and pegasus.
    """
    from engine_bridge.character import examples

    if as_film:
        if characters or live:
            raise click.UsageError("--film goes with no CHARACTER and not with --live.")
        _film(output)
        return
    names = tuple(examples.MOTIONS) if "all" in characters else characters or ("human", "pegasus")
    for name in names:
        if name not in examples.MOTIONS:
            raise click.UsageError(f"{name!r} is not one of the characters {', '.join(examples.MOTIONS)} or all.")
    if live:
        with progress() as report:
            prepared = [examples.prepare(name, output, report) for name in names]
        serve.serve_puppets([f"replay:{log}?loop" for log, _ in prepared], [puppet for _, puppet in prepared])
        return
    from engine_bridge.export.convert import describe

    for name in names:
        with progress() as report:
            summary, sheet = _convert(name, output, report)
        click.echo(describe(summary))
        click.echo(f"  contact sheet  {sheet}")


def _film(folder: Path) -> None:
    """Write the files of the example film, and make it."""
    from engine_bridge.character import examples
    from engine_bridge.cli.film import describe
    from engine_bridge.film.av_library import require_av
    from engine_bridge.film.film import make_video

    require_av()
    with progress() as report:
        scene = examples.prepare_film(folder, report)
        summary = make_video(scene, folder / "film.mp4", 0.0, None, False, report)
    click.echo(describe(summary))


def _convert(name: str, folder: Path, report: Reporter) -> "tuple[Summary, Path]":
    """Write the files of an example and convert them; return the summary and the path of the contact sheet."""
    from engine_bridge.character import examples
    from engine_bridge.export.convert import convert
    from engine_bridge.performance.settings import Settings
    from engine_bridge.pictures import clip_sheet

    log, puppet = examples.prepare(name, folder, report)
    title = f"{name}_{examples.MOTIONS[name]}"
    output, picture = folder / f"{title}.glb", folder / f"{title}.png"
    clip, summary = convert(log, puppet, output, Settings(), report)
    label = f"{name} · {examples.MOTIONS[name]}"
    clip_sheet.draw(clip, picture, label, lambda share: report("Drawing", share), file=output)
    return summary, picture
