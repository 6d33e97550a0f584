"""`puppetline token`: a secret that a service and its clients share."""

from pathlib import Path

import click

from engine_bridge.cli.options import FILE


@click.command()
@click.argument("file", type=FILE)
def token(file: Path) -> None:
    """Write a new token to FILE, for the service and its clients."""
    from engine_bridge.service.security.credentials import make_token

    make_token(file)
    click.echo(f"{file}: pass it to puppetline serve --token-file, and give it to the clients.")
