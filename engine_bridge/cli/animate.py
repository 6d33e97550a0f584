"""`puppetline animate`: a mesh moves as the performer of a recording, in one step."""

from pathlib import Path
from typing import Any

import click

from engine_bridge.cli import conversion, new, options
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import progress
from puppetline.errors import MeshError


@click.command()
@click.argument("mesh", type=FILE)
@click.argument("recording", type=FILE)
@options.output("The .glb file to write; a contact sheet is drawn beside it.", "MESH_RECORDING.glb")
@click.option("--puppet-out", type=FILE, metavar="TOML", help="Keep the proposed puppet file, to edit it.")
@new.body_options
@conversion.clip_options
@click.option("--force", is_flag=True, help="Replace existing files.")
@options.as_json
def animate(
    mesh: Path,
    recording: Path,
    output: Path | None,
    puppet_out: Path | None,
    force: bool,
    as_json: bool,
    **choices: Any,
) -> None:
    """Animate a MESH with a RECORDING: propose its limbs, convert the recording, and draw a contact sheet.

    To edit the limbs, keep them with --puppet-out, and use puppetline convert.
    """
    from engine_bridge.export.convert import convert_timeline, describe
    from engine_bridge.performance.clip import load_timeline
    from engine_bridge.performance.prepared_character import make_prepared
    from engine_bridge.pictures import clip_sheet
    from engine_bridge.puppet import proposal, puppet_file
    from puppetline.files import check_new, check_writable

    _check_mesh(mesh, recording)
    output = output or Path(f"{mesh.stem}_{recording.stem}.glb")
    conversion.check_output(output, has_puppet=True)
    check_writable(output, ".glb", inputs=(mesh, recording))
    sheet = output.with_suffix(".sheet.png")  # plain .png may be the name of a texture
    for path, ending in ((output, ".glb"), (sheet, ".png"), (puppet_out, ".toml")):
        if path is not None:
            check_writable(path, ending, inputs=(mesh, recording))
            if not force:
                check_new(path)
    body = {name: choices.pop(name) for name in new.BODY}
    settings = conversion.settings(**choices)
    with progress() as report:
        timeline, notes = load_timeline(recording, settings, animals=True)
        report("Preparing the character", 0.0)
        proposed = proposal.new_puppet(mesh, puppet_out or output, **body)
        if puppet_out is not None:
            puppet_file.dump(proposed.puppet, puppet_out, new.plan_text(proposed))
        prepared = make_prepared(proposed.puppet, proposed.character)
        report("Preparing the character", 1.0)
        clip, summary = convert_timeline(prepared, timeline, output, recording.stem, settings, notes, report)
        title = f"{mesh.stem} · {recording.stem}"
        clip_sheet.draw(clip, sheet, title, lambda share: report("Drawing", share), file=output)
    about = [*(f"  {line}" for line in new.describe(proposed)), new.check_line(proposed)]
    options.show(summary, as_json, describe(summary), f"  contact sheet  {sheet}", *about)


def _check_mesh(mesh: Path, recording: Path) -> None:
    """Refuse another kind of file in place of a mesh, with the command that was meant."""
    from engine_bridge.inspection.files import KIND_NAMES, kind_of

    if (kind := kind_of(mesh)) == "character":
        return
    meant = "animate MESH RECORDING"
    if kind == "log" and kind_of(recording) == "character":
        meant = f"animate {options.quoted(recording)} {options.quoted(mesh)}"
    elif kind == "puppet":
        meant = f"convert {options.quoted(recording)} --puppet {options.quoted(mesh)}"
    raise MeshError(mesh, found=KIND_NAMES[kind], expected="a mesh", fix=f"Use puppetline {meant}")
