"""`puppetline record`: a source is recorded to a take."""

import sys
from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import Finite


@click.command()
@options.source
@options.output("The take to write.")
@click.option(
    "--seconds", type=Finite(0, min_open=True), help="Duration of the take in seconds.  [default: until Ctrl-C]"
)
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option("--sound", is_flag=True, help="Record the microphone beside the take, as a .wav.")
@click.option("--sound-device", metavar="NAME", help="Name or number of the microphone.  [default: the system's]")
@click.option(
    "--sensor",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Record the images of a RealSense (FILE.db3) or an Orbbec sensor (FILE.bag) too; its source plays them.",
)
@options.as_json
def record(
    source: str,
    output: Path,
    seconds: float | None,
    force: bool,
    sound: bool,
    sound_device: str | None,
    sensor: Path | None,
    as_json: bool,
) -> None:
    """Record a source to a take.

    puppetline convert reads takes, and the source replay: plays them.
    """
    from contextlib import ExitStack, closing

    from capture import native_output
    from capture.sound_input import open_sound
    from capture.sources.registry import check_records, open_recording_sensor, open_source
    from capture.sources.take import record as record_take
    from capture.sources.take import remove_existing

    def report(frames: int, elapsed: float) -> None:
        if sys.stderr.isatty():
            click.echo(f"\r{frames:,} frames, {elapsed:.0f} s", err=True, nl=False)

    with native_output.logged(), ExitStack() as stack:
        heard = sound or sound_device is not None
        microphone = stack.enter_context(closing(open_sound(sound_device or "default", Path()))) if heard else None
        if sensor is not None:
            check_records(source, sensor)
            remove_existing(sensor, force)
        begun = open_source(source) if sensor is None else open_recording_sensor(source, sensor)
        opened = stack.enter_context(closing(begun))
        summary = record_take(opened, output, seconds, report, force, microphone)
    if sys.stderr.isatty():
        click.echo(err=True)
    if summary.why:
        click.echo(f"puppetline: {summary.why}", err=True)
    if as_json or output.exists():
        users = ", ".join(map(str, summary.users)) or "none"
        lost = f", {summary.sound_overflows} overflows" if summary.sound_overflows else ""
        lines = [f"{summary.take}: {summary.frames:,} frames, {summary.seconds:.1f} s, performers: {users}"]
        lines += [f"  sound          {summary.sound}{lost}"] if summary.sound else []
        options.show(summary, as_json, *lines)
    if summary.why:
        raise click.exceptions.Exit(1)
