"""`puppetline clip`: a recording becomes motion that an engine plays without a service."""

from pathlib import Path
from typing import Any

import click

from engine_bridge.cli import conversion, options
from engine_bridge.cli.options import FILE
from engine_bridge.cli.progress import progress


@click.command()
@click.argument("log", type=FILE)
@click.option("--puppet", required=True, type=FILE, help="Puppet file of the character.")
@options.output("The .clip file to write.")
@click.option("--name", metavar="NAME", help="Name of the character in the file.  [default: the puppet file's name]")
@click.option("--user", type=int, help="User number of the performer.  [default: the one tracked longest]")
@conversion.reading_options
@options.as_json
def clip(log: Path, puppet: Path, output: Path, name: str | None, as_json: bool, **choices: Any) -> None:
    """Convert a recording LOG to a clip, which the Godot addon and the Unity package play without a service."""
    from engine_bridge.service.clip_export import write_clip

    with progress() as report:
        summary = write_clip(log, puppet, output, name, conversion.reading_settings(**choices), report)
    options.show(
        summary,
        as_json,
        f"{summary.output}: {summary.frames:,} frames, {summary.seconds:.1f} s, {summary.bytes / 1e6:.1f} MB",
        f"  character      {summary.character}, {summary.vertices:,} vertices, revision {summary.revision}",
        *(f"  note: {note}" for note in summary.notes),
    )
