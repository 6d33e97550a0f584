"""`puppetline keys`: a CURVE key pair."""

from pathlib import Path

import click

from engine_bridge.cli.options import FILE


@click.command()
@click.argument("file", type=FILE)
def keys(file: Path) -> None:
    """Write new CURVE keys to FILE (NAME.key_secret) and NAME.key."""
    from engine_bridge.service.security.credentials import make_curve_keys

    make_curve_keys(file)
    public = file.with_suffix(".key")
    click.echo(f"{file}: secret key, keep it private; {public}: public key, give it to the other side.")
