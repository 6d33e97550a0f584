"""`puppetline listen`: what a client of a service receives."""

from pathlib import Path

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE, Finite


@click.command()
@click.argument("address", default="127.0.0.1:7400")
@click.option("--character", "characters", multiple=True, help="Receive only this character. Can be repeated.")
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    default=("controls",),
    show_default=True,
    type=click.Choice(["controls", "morphs", "vertices", "vertices16", "joints", "handles", "performer"]),
    help="What to receive. Can be repeated.",
)
@click.option(
    "--seconds",
    type=Finite(0, min_open=True),
    help="Duration in seconds, from the first message.  [default: until Ctrl-C]",
)
@click.option("--token-file", type=FILE, help="The token that the service requires.")
@options.as_json
def listen(
    address: str,
    characters: tuple[str, ...],
    kinds: tuple[str, ...],
    seconds: float | None,
    token_file: Path | None,
    as_json: bool,
) -> None:
    """Measure what a client of the service at ADDRESS receives.

    It reports rates, latency and gaps. The default ADDRESS is 127.0.0.1:7400.
    """
    from engine_bridge.client import listening
    from engine_bridge.service.security.credentials import read_token

    def notice(text: str) -> None:
        click.echo(f"puppetline: {text}", err=True)

    token = read_token(token_file)
    report = listening.listen(address, seconds=seconds, token=token, characters=characters, kinds=kinds, notice=notice)
    options.show(report, as_json, listening.describe(report))
