"""`puppetline look`: what a source sees, and why nothing moves."""

import os
import sys
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE, Finite
from puppetline import clock

if TYPE_CHECKING:
    from capture.sensors.source_report import SourceReport

STATUS_PERIOD_SECONDS = 0.2
"""Time between two updates of the status line, in seconds."""


@click.command()
@options.source
@click.option("-o", "--output", type=FILE, help="The .png file to write.")
@click.option("--live", is_flag=True, help="Show a status line in this terminal.")
@click.option(
    "--seconds",
    type=Finite(0, min_open=True),
    help="Duration in seconds.  [default: 3 from the first data; with --live until Ctrl-C]",
)
@options.as_json
def look(source: str, output: Path | None, live: bool, seconds: float | None, as_json: bool) -> None:
    """Show what a source sees, and explain why nothing moves.

    The exit code is 1 if no performer is in view.
    """
    from capture.sensors.diagnosis import diagnose
    from engine_bridge.pictures.source_view import draw
    from puppetline.files import check_writable, written_whole

    if output is None and not live:
        raise click.UsageError("Give -o, --live, or both.")
    if live and not sys.stdout.isatty():
        raise click.UsageError("--live requires a terminal. Use -o look.png to draw an image.")
    if output is not None:
        check_writable(output, ".png")
    if sys.stderr.isatty():
        click.echo(f"looking at {source} …", err=True)
    report, connected = _watch_live(source, seconds) if live else (_watch(source, seconds), True)
    if output is not None:
        with written_whole(output) as partial:
            draw(report, diagnose(report)).save(partial, format="PNG")
    if connected:
        _print(report, output, as_json)
    if not (connected and report.performers):
        raise click.exceptions.Exit(1)


def _print(report: "SourceReport", output: Path | None, as_json: bool) -> None:
    """Print what was seen, and why nothing moves."""
    from capture.sensors.diagnosis import describe, diagnose, summary

    problems = diagnose(report)
    lines = [f"{'' if output is None else f'{output}: '}{report.source}, {report.seconds:.1f} s"]
    lines += [f"  {describe(performer)}" for _, performer in sorted(report.performers.items())]
    if report.sensor_tilt is not None:
        lines.append(f"  the sensor: {report.sensor_tilt}")
    lines += [f"  {problem.what}" + (f"\n    → {problem.fix}" if problem.fix else "") for problem in problems]
    options.show(summary(report, problems), as_json, *lines)


def _watch(source: str, seconds: float | None) -> "SourceReport":
    """Return what a source sees during some seconds."""
    from capture import native_output
    from capture.sensors.source_report import observe
    from capture.sources.registry import open_source

    with native_output.logged(), closing(open_source(source)) as opened:
        return observe(opened, 3.0 if seconds is None else seconds)


def _watch_live(source: str, seconds: float | None) -> "tuple[SourceReport, bool]":
    """Show a status line; return what the source saw last, and whether the terminal is still connected."""
    import math
    from dataclasses import replace

    from rich.live import Live
    from rich.text import Text

    from capture import native_output
    from capture.reconnecting import ReopeningSource
    from capture.sensors.diagnosis import STATUS_SECONDS, status_line
    from capture.sensors.source_report import SourceMonitor
    from capture.sources.registry import open_source
    from engine_bridge.service.system_signals import Signals

    with ExitStack() as stack:
        signals = stack.enter_context(Signals())
        stack.enter_context(native_output.logged())
        opened = ReopeningSource(source, lambda: open_source(source))
        stack.callback(opened.close)
        signals.waiting = True
        monitor = SourceMonitor(opened, STATUS_SECONDS)
        end = clock.now() + (math.inf if seconds is None else seconds)
        try:
            with Live(auto_refresh=False, transient=True) as line:
                while not (signals.stop or signals.take_reload() or monitor.ended or clock.now() >= end):
                    due = min(clock.now() + STATUS_PERIOD_SECONDS, end)
                    while not (signals.stop or monitor.ended) and clock.now() < due:
                        monitor.receive(due)
                    line.update(Text(status_line(monitor.report())), refresh=True)
            connected = sys.stdout.isatty()  # false after SIGHUP from a terminal that was closed
        except OSError:  # the terminal was closed while the line was written
            connected = False
        if not connected:  # writing remaining output to a closed terminal would make the exit fail
            _discard_output()
        report = replace(monitor.report(), retried=False)
    return report, connected


def _discard_output() -> None:
    """Discard what this process prints from now on."""
    with open(os.devnull, "w") as nowhere:  # noqa: PTH123
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere.fileno(), stream.fileno())
