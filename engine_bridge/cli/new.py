"""`puppetline new`: a puppet file is proposed for a mesh."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE, Finite
from puppetline.errors import MeshError

if TYPE_CHECKING:
    from engine_bridge.puppet.proposal import Proposal
    from engine_bridge.puppet.puppet import Puppet

AXIS = click.Choice(["x", "-x", "y", "-y", "z", "-z"])

BODY = "body", "up", "front", "turn", "scale", "plan", "mirror"
"""Names of the options that `body_options` adds."""

body_options = options.together(
    (
        click.option(
            "--body",
            type=click.IntRange(min=0),
            metavar="NUMBER",
            help="The body that moves, if the mesh shows several; 0 for everything in the file.  [default: the first]",
        ),
        click.option("--up", type=AXIS, help="Axis of the mesh that points up.  [default: from its skeleton or shape]"),
        click.option(
            "--front", type=AXIS, help="Axis of the mesh that points forward.  [default: from its skeleton or shape]"
        ),
        click.option(
            "--turn",
            type=Finite(-180, 180),
            metavar="DEGREES",
            help="How far the character is turned from the front to its left.  [default: from its shape]",
        ),
        click.option(
            "--scale",
            type=Finite(0, min_open=True),
            metavar="METRES",
            help="Metres per mesh unit.  [default: from the character's height and body]",
        ),
        click.option(
            "--plan",
            type=click.Choice(["upright", "two legs", "four legs", "many legs", "wings", "no legs"]),
            help="How limbs follow the performer, and which are looked for in the shape.  [default: the likeliest]",
        ),
        click.option("--mirror", is_flag=True, help="Make the character the performer's mirror image."),
    )
)
"""Adds the options for how a character stands, and for how its limbs follow the performer."""


@click.command()
@click.argument("mesh", type=FILE)
@options.output("The puppet file to write.", "MESH.toml")
@click.option(
    "--handle",
    "handles",
    multiple=True,
    metavar="NAME=X,Y,Z",
    help="A handle at this point; replaces the proposed limbs. Can be repeated.",
)
@click.option(
    "--map",
    "maps",
    multiple=True,
    metavar="NAME=JOINT[,JOINT]",
    help="The joint that moves a handle, or several to average; for a limb, one joint per point. Can be repeated.",
)
@click.option(
    "--limb",
    "ends",
    multiple=True,
    metavar="NAME=X,Y,Z",
    help="The tip of a limb that was not found, or that has the wrong name. Can be repeated.",
)
@body_options
@click.option(
    "--preview", type=FILE, metavar="PNG", help="File for the image of the puppet.  [default: OUTPUT with .handles.png]"
)
@click.option("--force", is_flag=True, help="Replace an existing puppet file.")
def new(
    mesh: Path,
    output: Path | None,
    handles: tuple[str, ...],
    maps: tuple[str, ...],
    ends: tuple[str, ...],
    preview: Path | None,
    force: bool,
    **body: Any,
) -> None:
    """Propose a puppet file for a MESH.

    It contains the mesh's limbs, or handles if the mesh has no limbs, and the joints that move them.
    """
    from engine_bridge.pictures import puppet_diagram
    from engine_bridge.puppet import proposal, puppet_file
    from puppetline.files import check_new, check_writable

    _check_no_recording(mesh)
    output = output or Path(f"{mesh.stem}.toml")
    check_writable(output, ".toml", inputs=(mesh,))
    picture = preview or output.with_suffix(".handles.png")  # plain .png may be the name of a texture or contact sheet
    check_writable(picture, ".png", inputs=(mesh,))
    if not force:
        check_new(output)
    proposed = proposal.new_puppet(
        mesh,
        output,
        handles=_pairs("--handle", handles),
        maps=_pairs("--map", maps),
        ends=_pairs("--limb", ends),
        **body,
    )
    puppet_file.dump(proposed.puppet, output, plan_text(proposed))
    title = f"{output.stem} · {mesh.name} · {proposed.summary}"
    puppet_diagram.draw(proposed.puppet, proposed.character, picture, title)
    counts = {"limbs": len(proposed.puppet.limb), "handles": len(proposed.puppet.handle)}
    click.echo(
        f"{output}: {', '.join(f'{count} {what}' for what, count in counts.items() if count)}, shown in {picture}"
    )
    for line in describe(proposed):
        click.echo(f"  {line}")
    _echo_mapping(proposed.puppet)
    click.echo(f"Convert a recording:  puppetline convert LOG --puppet {options.quoted(output)}")
    click.echo(check_line(proposed))


def _check_no_recording(mesh: Path) -> None:
    """Refuse a recording in place of a mesh."""
    from capture.formats import recognize

    if mesh.is_file() and recognize(mesh):
        fix = f"To convert the recording: puppetline animate MESH {options.quoted(mesh)}"
        raise MeshError(mesh, found="a recording", expected="a mesh", fix=fix)


def plan_text(proposed: "Proposal") -> str:
    """Return what the body plan of a proposal is; "" for a puppet without limbs."""
    from engine_bridge.puppet.body_plans import PLANS

    return f"Body plan {proposed.plan!r}. {PLANS[proposed.plan].about}" if proposed.plan else ""


def check_line(proposed: "Proposal") -> str:
    """Return what was found, for a person to compare with the picture, and the options that correct it."""
    return (
        f"Check: {proposed.summary}, which looks at you in the image. "
        "If that is wrong, correct it with --front, --turn, --up, --plan or --body."
    )


def describe(proposed: "Proposal") -> list[str]:
    """Return the body plan of a proposal, what was assumed and what is unclear, as lines of text."""
    lines = [plan_text(proposed)] if proposed.plan else []
    lines += [f"assumed: {reason}" for reason in proposed.assumed]
    return lines + [f"unclear: {note}" for note in proposed.notes]


def _echo_mapping(puppet: "Puppet") -> None:
    """Print which joints move each limb and handle."""
    for limb in puppet.limb:
        joints = ", ".join(" + ".join(dict.fromkeys(joints)) for joints in limb.driven_by)
        click.echo(f"  {limb.name:16} ({limb.follow})  ←  {joints}{_times(limb.gain)}")
    for handle in puppet.handle:
        place = ", ".join(f"{value:.4g}" for value in handle.position)
        click.echo(f"  {handle.name:16} ({place})  ←  {' + '.join(handle.driven_by) or 'fixed'}{_times(handle.gain)}")


def _times(gain: float) -> str:
    return f" × {gain:g}" if gain != 1 else ""


def _pairs(option: str, values: tuple[str, ...]) -> dict[str, str]:
    """Split NAME=VALUE options."""
    pairs = dict(value.rpartition("=")[::2] for value in values)
    if len(pairs) < len(values) or not all(name and value for name, value in pairs.items()):
        raise click.UsageError(f"{option} requires NAME=VALUE, with each name once.")
    return pairs
