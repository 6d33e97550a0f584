"""`puppetline doctor`: what works on this machine."""

from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE


@click.command()
@click.option("--source", "sources", multiple=True, metavar="URI", help="Source that must work here. Can be repeated.")
@click.option(
    "--takes", type=FILE, metavar="FOLDER", help="Folder for takes, which must be writable.  [default: takes]"
)
@options.as_json
def doctor(sources: tuple[str, ...], takes: Path | None, as_json: bool) -> None:
    """Report what works on this machine.

    It checks libraries, ports, folders, sensors, sources and the network. The exit code is 1 if something does not work
    that Puppetline requires or that you have asked for.
    """
    from engine_bridge.inspection import machine

    findings = machine.examine(takes, sources)
    options.show(findings, as_json, machine.text(findings))
    if any(finding.ok is False for finding in findings):
        raise click.exceptions.Exit(1)
