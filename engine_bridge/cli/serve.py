"""`puppetline serve`: the live service."""

import gc
import logging
import math
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli.options import FILE, Finite
from puppetline import clock
from puppetline.child_process import kept_running, wait_for_parent
from puppetline.errors import ServiceError

if TYPE_CHECKING:
    from engine_bridge.service.loading.service_file import ServiceFile

COMPILING = "compiling, once on this machine"
"""Event of the log while functions are compiled; the studio shows it."""

STUDIO_PORT = 7480
"""Default port of the studio's page."""


@click.command()
@click.option("--config", type=FILE, metavar="SERVICE.toml", help="Service file, instead of options.")
@click.option("--puppet", "puppets", multiple=True, type=FILE, help="Puppet file of a character. Can be repeated.")
@click.option(
    "--source",
    "sources",
    multiple=True,
    metavar="URI",
    help="Source of skeletons, for all puppet files or one for each; docs/live.md lists them.  [default: osc:7110]",
)
@click.option(
    "--sound",
    is_flag=False,
    flag_value="default",
    metavar="[DEVICE|FILE.wav]",
    help="Microphone, or a .wav in its place: its loudness opens mouths, and it is recorded beside takes.",
)
@click.option("--loop", is_flag=True, help="Add ?loop to every recorded source, to play it in a loop.")
@click.option(
    "--people",
    type=click.Choice(["each", "nearest", "queue"]),
    help="Which performers drive the characters if several are in view.  [default: each]",
)
@click.option(
    "--calibrate",
    type=click.Choice(["still", "at_once", "command"]),
    help="When a performer's pose is mapped to the character's rest pose.  [default: still]",
)
@click.option("--idle", type=FILE, metavar="LOG", help="Recording to play while no performer drives the character.")
@click.option("--morphs", type=FILE, metavar="GLB", help="Output of puppetline bake, to stream morph weights.")
@click.option("--host", help="Address to listen on.  [default: 127.0.0.1]")
@click.option(
    "--port",
    type=click.IntRange(0, 65534),
    help="Port of the stream; the control socket uses the next port.  [default: 7400]",
)
@click.option("--token-file", type=FILE, help="Token that clients must send; puppetline token FILE writes one.")
@click.option(
    "--osc", "targets", multiple=True, metavar="HOST:PORT", help="Also send OSC to this address. Can be repeated."
)
@click.option("--osc-rate", type=Finite(1, 1000), help="Frames per second for each OSC receiver.  [default: 30]")
@click.option(
    "--websocket",
    type=click.IntRange(0, 65534),
    metavar="PORT",
    help="Also serve web pages over WebSocket, on this port of --host.",
)
@click.option(
    "--origin",
    "origins",
    multiple=True,
    metavar="URL",
    help="Origin of web pages that may connect, such as http://localhost:8000. Can be repeated.",
)
@click.option("--takes", type=FILE, metavar="FOLDER", help="Folder that takes are recorded to.  [default: takes]")
@click.option("--metrics", type=click.IntRange(1, 65535), metavar="PORT", help="Port for Prometheus, on loopback only.")
@click.option(
    "--announce/--no-announce", default=None, help="Announce the service on the network by mDNS.  [default: yes]"
)
@click.option(
    "--studio",
    is_flag=False,
    flag_value=STUDIO_PORT,
    type=click.IntRange(0, 65535),
    metavar="[PORT]",
    help="Also serve the page of puppetline studio for this service, on this port of 127.0.0.1.  [default port: 7480]",
)
@click.option("--status", is_flag=True, help="Show a live status table.")
@click.option(
    "--log-format",
    default="text",
    show_default=True,
    type=click.Choice(["text", "json"]),
    help="Format of the log on standard error.",
)
@click.option(
    "--log-level",
    default="info",
    show_default=True,
    type=click.Choice(["debug", "info", "warning", "error"]),
    help="Least severe messages that are logged.",
)
# the studio's: get ready, and wait until the service file is written
@click.option("--wait", is_flag=True, default=None, hidden=True)
def serve(
    config: Path | None,
    studio: int | None,
    status: bool,
    log_format: Any,
    log_level: str,
    wait: bool | None,
    **settings: Any,
) -> None:
    """Stream characters that performers drive live, until stopped."""
    if wait:
        from engine_bridge.service import commands, loading, service  # noqa: F401 - most of the time until it serves

        wait_for_parent()
    service_file, folder = _service_file(config, settings)
    _run(service_file, folder, config, studio, status, log_format, log_level)


def serve_puppets(sources: list[str], puppets: list[Path]) -> None:
    """Serve puppet files with the default settings, each with its own source, until stopped."""
    from engine_bridge.service.loading import service_file

    _run(service_file.from_flags(tuple(sources), tuple(puppets), {}, {}, {}), Path())


def _run(
    settings: "ServiceFile",
    folder: Path,
    config: Path | None = None,
    studio: int | None = None,
    status: bool = False,
    log_format: Any = "text",
    log_level: str = "info",
) -> None:
    """Serve until stopped; a service file `config` is read again at each reload."""
    gc.disable()  # while modules are loaded, which leaves almost no garbage
    from engine_bridge.service.system_signals import Signals

    with ExitStack() as stack:
        signals = stack.enter_context(Signals())
        from capture import native_output
        from engine_bridge.service.monitoring import logs

        stack.enter_context(native_output.logged())
        logs.setup(log_format, log_level)
        stack.enter_context(logs.beside())
        display = None
        if status:
            from engine_bridge.service.monitoring.status_table import StatusDisplay

            display = StatusDisplay()
            stack.callback(display.close)
        if studio is not None:
            # it starts while this process loads its modules and the characters
            stack.enter_context(_studio(settings, folder, studio, config))
        from engine_bridge.service.commands import commands
        from engine_bridge.service.loading import service_file
        from engine_bridge.service.service import Service
        from puppetline.compiling import reported

        read_settings = None if config is None else partial(service_file.load, config)
        stack.enter_context(reported(_CompilingLog()))
        service = Service(settings, folder, commands, None if display is None else display.update, read_settings)
        stack.callback(service.close)
        gc.collect()
        gc.freeze()  # what is loaded stays, so later collections need not examine it
        gc.enable()
        signals.waiting = True
        service.run(signals)


class _CompilingLog:
    """Logs at most once per second how many functions were compiled, which takes a minute the first time."""

    def __init__(self) -> None:
        self._logged_at = -math.inf

    def __call__(self, count: int) -> None:
        from engine_bridge.service.monitoring.logs import REPEAT_SECONDS, fields

        now = clock.now()
        if now - self._logged_at >= REPEAT_SECONDS:
            self._logged_at = now
            logging.getLogger(__name__).info(COMPILING, extra=fields(functions=count))


@contextmanager
def _studio(settings: "ServiceFile", folder: Path, port: int, config: Path | None) -> Iterator[None]:
    """Run the page of the studio in a process of its own, which joins the service and does not delay it."""
    from engine_bridge.service.security.credentials import TOKEN_VARIABLE
    from engine_bridge.service.security.endpoints import endpoints_of

    if settings.network.port == 0:
        raise ServiceError(
            "--studio",
            found="the port 0, for any free ports",
            expected="a port, with the control socket on the next one",
            fix="Choose a port.",
        )
    endpoint = next((each for each in endpoints_of(settings.network, folder) if each.mechanism != "CURVE"), None)
    if endpoint is None:
        raise ServiceError(
            "--studio",
            found="a service that accepts CURVE keys only",
            expected="an address for programs on this machine",
            fix='Set host = "127.0.0.1" in [network] and the other address in [network.curve].',
        )
    address = endpoint.stream.removeprefix("tcp://").replace("0.0.0.0", "127.0.0.1").replace("[::]", "[::1]")  # noqa: S104
    token = {TOKEN_VARIABLE: endpoint.token.decode()} if endpoint.token else {}
    command = [
        sys.executable,
        "-P",
        "-m",
        "puppetline",
        "studio",
        "--service",
        address,
        "--port",
        str(port),
        "--no-browser",
    ]
    if settings.kiosk is not None:
        command += ["--kiosk", str(config)]
    with kept_running(command, os.environ | token):
        yield


def _service_file(config: Path | None, settings: dict[str, Any]) -> "tuple[ServiceFile, Path]":
    """Return the settings of a service file or of options, and the folder that their paths are relative to."""
    from engine_bridge.service.loading import service_file

    settings["loop"] = settings["loop"] or None  # a flag is given or not
    given = {name: value for name, value in settings.items() if value is not None and value != ()}
    if config is not None:
        params = [each for each in click.get_current_context().command.params if each.name in given]
        options = ["/".join((*each.opts, *each.secondary_opts)) for each in params]
        if options:
            raise click.UsageError(
                f"--config cannot be combined with {', '.join(options)}: write this into the service file."
            )
        return service_file.load(config), config.parent
    if "puppets" not in given:
        raise click.UsageError("Give --puppet or --config.")
    if "origins" in given and "websocket" not in given:
        raise click.UsageError("--origin requires --websocket.")

    def chosen(*names: str) -> dict[str, Any]:
        values = {name: given[name] for name in names if name in given}
        return {name: str(value) if isinstance(value, Path) else value for name, value in values.items()}

    rest = {
        "network": chosen("host", "port", "token_file"),
        "osc": [_osc_receiver(each, given.get("osc_rate")) for each in settings["targets"]],
        **chosen("takes", "announce"),
    }
    if "websocket" in given:
        rest["websocket"] = {"port": given["websocket"], "origins": list(settings["origins"]), **chosen("host")}
    if "metrics" in given:
        rest["metrics"] = {"port": given["metrics"]}
    sources = tuple(_looped(uri) if "loop" in given else uri for uri in given.get("sources", ("osc:7110",)))
    stage, character = chosen("people", "calibrate", "sound"), chosen("idle", "morphs")
    return service_file.from_flags(sources, given["puppets"], stage, character, rest), Path()


def _looped(uri: str) -> str:
    from capture.sources.registry import LOOP_SUFFIX, is_recorded

    if not is_recorded(uri) or uri.endswith(("?loop", "&loop")):
        return uri
    return uri + ("&loop" if "?" in uri else LOOP_SUFFIX)


def _osc_receiver(text: str, rate: float | None) -> dict[str, Any]:
    host, _, port = text.rpartition(":")
    if not port.isdecimal():
        raise click.UsageError(f"--osc requires HOST:PORT, not {text!r}.")
    return {"host": host.strip("[]") or "127.0.0.1", "port": int(port), **({} if rate is None else {"rate": rate})}
