"""`puppetline bake`: a character's morph targets for live use."""

from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE, Finite
from engine_bridge.cli.progress import progress


@click.command()
@click.argument("puppet", type=FILE)
@options.output("The .glb file to write.")
@click.option(
    "--log",
    "logs",
    multiple=True,
    type=FILE,
    help="Recording to fit the morph targets to. Can be repeated.  [default: generated motion]",
)
@options.targets
@click.option(
    "--tolerance",
    type=Finite(0, 1, min_open=True),
    help="Largest error of a vertex, as a fraction of the character's diagonal.  [default: 0.002]",
)
@options.as_json
def bake(
    puppet: Path, output: Path, logs: tuple[Path, ...], targets: int | None, tolerance: float | None, as_json: bool
) -> None:
    """Write a .glb of PUPPET with morph targets for live motion."""
    from engine_bridge.export.bake import bake

    with progress() as report:
        summary = bake(puppet, output, logs, targets=targets, tolerance=tolerance, progress=report)
    size = f"{summary.targets} morph targets, {summary.bytes / 1e6:.1f} MB"
    options.show(
        summary,
        as_json,
        f"{summary.output}: {size}, from {summary.frames:,} frames of motion",
        f"  largest error  {summary.error:.2g} of the diagonal, root mean square {summary.rms:.2g} "
        f"(tolerance {summary.tolerance:g})",
        *(f"  note: {note}" for note in (*summary.repairs, *summary.notes)),
    )
