"""`puppetline film`: a scene file becomes a video, or a .glb with all characters and their animations."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE, Finite
from engine_bridge.cli.progress import progress

if TYPE_CHECKING:
    from engine_bridge.film.film import FilmSummary


@click.command()
@click.argument("scene", type=FILE)
@options.output("The .mp4, .webm, .gif or .glb file to write.", "SCENE.mp4")
@click.option("--draft", is_flag=True, help="Draw half the width, height and frame rate, for a quick look.")
@click.option(
    "--start", default=0.0, show_default=True, type=Finite(0), metavar="SECONDS", help="Time at which the film begins."
)
@click.option("--stop", type=Finite(0), metavar="SECONDS", help="Time at which it ends.  [default: the scene's end]")
@click.option("--share", is_flag=True, help="Also write a poster (.jpg) and a small .gif beside the .mp4.")
@options.force
@options.as_json
def film(
    scene: Path,
    output: Path | None,
    draft: bool,
    start: float,
    stop: float | None,
    share: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Make a film of a SCENE file: characters, takes, sounds, cameras and titles.

    Videos require the extra film: pip install 'puppetline[film]'.
    """
    from engine_bridge.film.film import make_video
    from engine_bridge.film.film_document import make_document
    from engine_bridge.film.sharing import check_sharing, share_video

    output = options.named(output, f"{scene.stem}.mp4", force)
    if share and output.suffix.lower() != ".mp4":
        raise click.UsageError("--share requires an .mp4.")
    if share:
        check_sharing(output, scene, force)
    with progress() as report:
        if output.suffix.lower() == ".glb":
            if draft or start or stop is not None:
                raise click.UsageError("--draft, --start and --stop are for videos.")
            summary = make_document(scene, output, report)
        else:
            summary = make_video(scene, output, start, stop, draft, report)
            if share:
                share_video(output)
    options.show(summary, as_json, describe(summary))


def describe(summary: "FilmSummary") -> str:
    """Return the summary of a film as lines of text."""
    lines = [f"{summary.output}: {summary.frames:,} frames, {summary.seconds:.1f} s, {summary.bytes / 1e6:.1f} MB"]
    if summary.width:
        sound = f", {summary.sounds} sound track{'s' * (summary.sounds != 1)}" if summary.sounds else ""
        lines.append(f"  picture        {summary.width} × {summary.height} at {summary.fps:g} per second{sound}")
    return "\n".join([*lines, *(f"  note: {note}" for note in summary.notes)])
