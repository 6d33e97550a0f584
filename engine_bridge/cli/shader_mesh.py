"""`puppetline shader-mesh`: a character whose vertices an engine's shader moves."""

from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE


@click.command("shader-mesh")
@click.argument("puppet", type=FILE)
@options.output("The .glb file to write.")
@options.as_json
def shader_mesh(puppet: Path, output: Path, as_json: bool) -> None:
    """Write a .glb of PUPPET for an engine's shader.

    Each vertex has its isoline coordinates as texture coordinates, so that the shader can move it by live controls.
    """
    from engine_bridge.export.shader_mesh import write_shader_mesh

    summary = write_shader_mesh(puppet, output)
    surfaces = f"{summary.surfaces} surface{'s' if summary.surfaces > 1 else ''}"
    size = f"{summary.vertices:,} vertices in {surfaces}, {summary.bytes / 1e6:.1f} MB"
    line = f"{summary.output}: {size}, isoline coordinates of {summary.fields} fields"
    options.show(summary, as_json, line, *(f"  note: {note}" for note in summary.notes))
