"""`puppetline rig`: a skeleton and skin weights for any mesh."""

from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import progress


@click.command()
@click.argument("source", type=FILE, metavar="MESH|PUPPET")
@options.output("The .glb or .vrm file to write. A .vrm is bound with straight arms and legs to a new skeleton.")
@click.option(
    "--names",
    type=click.Choice(["vrm", "mixamo", "unreal", "rigify", "godot"]),
    help="Names of humanoid joints.  [default: vrm]",
)
@click.option(
    "--pose",
    type=click.Choice(["rest", "t"]),
    help="Bind the mesh as the file has it, or with straight arms and legs.  [default: rest; .vrm: t]",
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
    default=None,
    help="Keep the skeleton and weights of a file that has them, or make new ones.  [default: keep; .vrm and t: new]",
)
@click.option("--name", metavar="TEXT", help="Name of the avatar in a .vrm.  [default: as in the puppet file]")
@click.option("--author", "authors", multiple=True, metavar="TEXT", help="Author of the avatar; may be repeated.")
@click.option("--licence", metavar="URL", help="Web address of the avatar's licence.")
@options.as_json
def rig(
    source: Path,
    output: Path,
    names: str | None,
    pose: str | None,
    influences: int,
    keep_skin: bool | None,
    name: str | None,
    authors: tuple[str, ...],
    licence: str | None,
    as_json: bool,
) -> None:
    """Write a .glb with a skeleton and skin weights for a MESH, or for the limbs in a PUPPET file; or an avatar."""
    from engine_bridge.export.rig_file import RigSettings, describe, write_rig
    from engine_bridge.export.vrm_file import VRM_ENDING, write_vrm

    settings = RigSettings(names, pose or "rest", influences, keep_skin is not False)  # type: ignore[arg-type]  # the choices
    stated = {"name": name, "authors": authors, "licence": licence}
    given = {key: value for key, value in stated.items() if value}
    avatar = output.suffix.lower() == VRM_ENDING
    if given and not avatar:
        raise click.UsageError("--name, --author and --licence require -o CHARACTER.vrm.")
    if avatar and pose == "rest":
        raise click.UsageError("--pose rest requires a .glb: a .vrm is bound in a T-pose.")
    if keep_skin and (avatar or pose == "t"):
        cause = "a .vrm" if avatar else "--pose t"
        raise click.UsageError(f"--keep-skin cannot be combined with {cause}, which requires a new skin.")
    with progress() as report:
        if avatar:
            summary = write_vrm(source, output, settings, given, report)
        else:
            summary = write_rig(source, output, settings, report)
    options.show(summary, as_json, describe(summary))
