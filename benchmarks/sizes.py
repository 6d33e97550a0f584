"""Sizes of exported files: ``python -m benchmarks.sizes [--as FORM …] [--puppet FILE --log FILE]``.

A row of the table is a character with its motion, by default each example character with its own. It has the megabytes
of the plain file, with --compact, with --meshopt and with both, and the printed error of the last one as a fraction of
the tolerance.
"""

import argparse
import tempfile
from pathlib import Path

from engine_bridge.character import examples
from engine_bridge.cli import benchmark
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

CHOICES = ({}, {"compact": True}, {"meshopt": True}, {"compact": True, "meshopt": True})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--as", dest="forms", nargs="+", default=["morph"], choices=["morph", "frames", "rig"])
    parser.add_argument("--puppet", type=Path)
    parser.add_argument("--log", type=Path)
    options = parser.parse_args()
    if (options.puppet is None) != (options.log is None):
        parser.error("--puppet requires --log, and --log requires --puppet")
    print("| character | motion | `--as` | plain | `--compact` | `--meshopt` | both | smaller by | error / tolerance |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as place, benchmark.own_cache(Path(place)):
        folder = Path(place)
        for name in examples.MOTIONS if options.puppet is None else [options.puppet.stem]:
            given = options.log, options.puppet
            log, puppet = examples.prepare(name, folder) if options.puppet is None else given
            for form in options.forms:
                made = [
                    convert(log, puppet, folder / "out.glb", Settings(form=form, **choice))[1] for choice in CHOICES
                ]
                sizes = " | ".join(f"{summary.bytes / 1e6:.2f}" for summary in made)
                ratio, error = made[0].bytes / made[-1].bytes, made[-1].error / made[-1].tolerance
                print(f"| {name} | {log.stem} | `{form}` | {sizes} | {ratio:.1f} × | {error:.2f} |", flush=True)


if __name__ == "__main__":
    main()
