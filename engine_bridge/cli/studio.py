"""`puppetline studio`: the panel in a browser."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from engine_bridge.cli.options import FILE
from puppetline.errors import PuppetlineError

if TYPE_CHECKING:
    from engine_bridge.studio.server import Served


@click.command()
@click.argument("file", required=False, type=FILE, metavar="[PUPPET.toml | MESH]")
@click.option(
    "--folder", type=FILE, help="Folder for uploads, characters, takes and exports.  [default: the user's data folder]"
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=7480, show_default=True, type=click.IntRange(0, 65535), help="Port of the page.")
@click.option(
    "--origin",
    "origins",
    multiple=True,
    metavar="URL",
    help="Another address that leads to the page, such as https://studio.example of a proxy. Can be repeated.",
)
@click.option(
    "--token-file", type=FILE, help="Token for pages, required if other machines can connect; see puppetline token."
)
@click.option(
    "--sound", metavar="NAME|FILE.wav", help="Record this microphone (name, number or default) or file with takes."
)
@click.option("--service", metavar="HOST:PORT", help="Join the service whose stream is there, instead of starting one.")
@click.option("--service-token-file", type=FILE, help="The token that this service requires.")
@click.option("--kiosk", type=FILE, hidden=True, help="Service file of the joined service, which has a kiosk.")
@click.option("--browser/--no-browser", default=None, help="Open a browser.  [default: where there is a desktop]")
def studio(
    file: Path | None,
    folder: Path | None,
    host: str,
    port: int,
    origins: tuple[str, ...],
    token_file: Path | None,
    sound: str | None,
    service: str | None,
    service_token_file: Path | None,
    kiosk: Path | None,
    browser: bool | None,
) -> None:
    """Set up, play, record and export characters in a browser, until stopped.

    PUPPET.toml or MESH is opened first.
    """
    import asyncio

    from capture.sound_input import is_sound_file, open_sound
    from engine_bridge.cli.compile_ahead import compiling_ahead
    from engine_bridge.inspection.files import KIND_NAMES, kind_of
    from engine_bridge.service.monitoring import logs
    from engine_bridge.service.security.credentials import read_token
    from engine_bridge.studio.server import StudioSettings, run, studio_folder

    if service is not None and any(each is not None for each in (file, folder, sound)):
        raise click.UsageError(
            "--service cannot be combined with a file, --folder or --sound: the service has its own."
        )
    if service is None and service_token_file is not None:
        raise click.UsageError("--service-token-file requires --service.")
    if file is not None and (kind := kind_of(file)) not in ("puppet", "character"):
        raise PuppetlineError(
            file,
            found=KIND_NAMES[kind],
            expected="a puppet file or a mesh",
            fix="Start without it, then drop it on the page.",
        )
    if sound is not None:
        open_sound(sound, Path()).close()  # refuses a missing one now
    logs.setup("text", "warning")
    settings = StudioSettings(
        folder=folder or studio_folder(),
        host=host,
        port=port,
        origins=origins,
        token_file=token_file,
        first=file,
        sound=sound if sound is None or not is_sound_file(sound) else str(Path(sound).absolute()),
        service=service,
        service_token=None if service is None else read_token(service_token_file),
        kiosk=kiosk,
    )
    running: list[Served] = []

    def started(served: "Served") -> None:
        running.append(served)
        link = served.link()
        click.echo(f"The studio is at {link}")
        click.echo("The address can be used once. Stop the studio with Ctrl-C.")
        if kiosk is not None:
            click.echo(f"The visitors' screen is at {served.screen}")
            no_phones = "no films. Connect this machine to a network, or set phone_address or phone_port in [kiosk]."
            click.echo(f"Visitors' phones open {served.phones or no_phones}")
        else:
            click.echo(f"OBS shows the characters from {served.screen}")
        if _has_desktop() if browser is None else browser:
            click.launch(link)

    def entered() -> None:
        click.echo(f"For another browser: {running[0].link()}")

    with compiling_ahead(at_once=service is None):  # while the page loads and somebody looks at it
        asyncio.run(run(settings, started, entered))


def _has_desktop() -> bool:
    """Return whether a browser would open on a screen in front of the user."""
    import os
    import sys

    if sys.platform in ("darwin", "win32"):
        return "SSH_CONNECTION" not in os.environ
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
