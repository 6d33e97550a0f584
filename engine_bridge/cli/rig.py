"""`puppetline rig`: a skeleton and skin weights for any mesh."""

from dataclasses import asdict
from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import progress


@click.command()
@click.argument("source", type=FILE, metavar="MESH|PUPPET")
@options.output("The .glb file to write.")
@click.option(
    "--names",
    type=click.Choice(["vrm", "mixamo", "unreal", "rigify", "godot"]),
    help="Names of humanoid joints.  [default: vrm]",
)
@click.option(
    "--pose",
    type=click.Choice(["rest", "t"]),
    default="rest",
    show_default=True,
    help="Bind the mesh as the file has it, or with straight arms and legs.",
)
@click.option(
    "--influences",
    type=click.Choice([4, 8]),
    default=4,
    show_default=True,
    help="Maximum number of joints per vertex. All programs support 4.",
)
@click.option(
    "--keep-skin/--new-skin",
    "keep_skin",
    default=True,
    help="Keep the skeleton and weights of a file that has them, or make new ones.  [default: keep]",
)
@options.as_json
def rig(
    source: Path,
    output: Path,
    names: str | None,
    pose: str,
    influences: int,
    keep_skin: bool,
    as_json: bool,
) -> None:
    """Write a .glb with a skeleton and skin weights for a MESH, or for the limbs in a PUPPET file."""
    from engine_bridge.export.rig_file import RigSettings, describe, write_rig

    settings = RigSettings(names, pose, influences, keep_skin)  # type: ignore[arg-type]  # the choices are those
    with progress() as report:
        summary = write_rig(source, output, settings, report)
    if as_json:
        options.echo_json(asdict(summary))
    else:
        click.echo(describe(summary))
