"""`puppetline FILE`: what can be done with a file."""

from pathlib import Path

import click

from engine_bridge.cli.options import FILE, quoted

COMMANDS_FOR = {
    "character": (
        ("animate {file} RECORDING", "move it as the performer of a recording moves"),
        ("new {file}", "propose its limbs, in a puppet file that you can edit"),
        ("studio {file}", "set it up, play, record and export in a browser"),
        ("rig {file} -o RIGGED.glb", "give it a skeleton and skin weights"),
        ("inspect {file}", "describe it"),
    ),
    "log": (
        ("animate MESH {file}", "move a character as its performer moves"),
        ("convert {file} -o {stem}.vrma", "animate the performer's own skeleton (.vrma, .bvh or .glb)"),
        ("look --source replay:{file}", "show what is in it"),
        ("inspect {file}", "describe it"),
    ),
    "puppet": (
        ("convert RECORDING --puppet {file}", "move the character as the performer of a recording moves"),
        ("studio {file}", "edit it, play, record and export in a browser"),
        ("serve --puppet {file} --source demo:walk", "stream the character live to an engine"),
        ("inspect {file}", "describe it"),
    ),
    "scene": (("film {file}", "make the film"), ("inspect {file}", "describe it")),
    "service": (("serve --config {file}", "start the service"), ("inspect {file}", "describe it")),
    "clip": (("inspect {file}", "describe it; the Godot addon and the Unity package play it"),),
}
"""Arguments of commands, and what they do, by the kind of file."""


@click.command(hidden=True)
@click.argument("files", nargs=-1, type=FILE)
def suggestions(files: tuple[Path, ...]) -> None:
    """Print what can be done with a file, or with a mesh and a recording."""
    from engine_bridge.inspection.files import kind_of

    kinds = [kind_of(file) for file in files]
    if sorted(kinds) == ["character", "log"]:
        mesh, recording = files[kinds.index("character")], files[kinds.index("log")]
        click.echo(f"puppetline animate {quoted(mesh)} {quoted(recording)}")
        return
    for file, kind in zip(files, kinds, strict=True):
        names = {"file": quoted(file), "stem": quoted(Path(file.stem))}
        lines = [(each.format(**names), about) for each, about in COMMANDS_FOR[kind]]
        width = max(len(command) for command, _ in lines)
        for command, about in lines:
            click.echo(f"puppetline {command:{width}}  {about}")
