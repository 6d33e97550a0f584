"""`puppetline align`: where sensors are, from their recordings of one performer."""

from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE


@click.command()
@click.argument("logs", nargs=-1, required=True, type=FILE)
@options.output("The .toml file to write, for --source fused:FILE.toml.")
@click.option(
    "--source",
    "sources",
    multiple=True,
    metavar="URI",
    help="The sensor that made each recording, in the order of LOGS.  [default: replay the recordings]",
)
@options.as_json
def align(logs: tuple[Path, ...], output: Path, sources: tuple[str, ...], as_json: bool) -> None:
    """Compute sensor poses from recordings of the same motion.

    LOGS are two or more recordings, one from each sensor.
    """
    from capture.sources import alignment

    if len(logs) < 2:
        raise click.UsageError("Give two or more recordings.")
    summaries = alignment.align(logs, sources, output)
    lines = [f"{output}: {len(logs)} sensors, in the coordinates of {logs[0]}"]
    for each in summaries:
        x, y, z = each.position
        tilt, turn, roll = each.rotation
        lines += [
            f"  {each.log}: at ({x:.2f}, {y:.2f}, {z:.2f}) m, tilt {tilt:.1f}°, turn {turn:.1f}°, roll {roll:.1f}°, "
            f"clock {1000 * each.clock:+.1f} ms",
            f"    joints {each.residual_cm:.1f} cm apart (mean) in {each.seconds:.1f} s; "
            f"left and right differ in {100 * each.swapped:.0f} % of the frames",
            *(f"    note: {note}" for note in each.notes),
        ]
    options.show(summaries, as_json, *lines)
