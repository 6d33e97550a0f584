"""The commands of the live service; everything heavy is imported by the command that needs it."""

import gc
import json
import os
import sys
from contextlib import ExitStack
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli.command_line import FILE, Finite, progress

if TYPE_CHECKING:
    from capture.sensors.sight import Sight
    from engine_bridge.service.service_file import ServiceFile

PORT = click.IntRange(0, 65534)

_STATUS_PERIOD = 0.2  # seconds between two status lines


@click.command()
@click.option("--config", type=FILE, metavar="SERVICE.toml", help="A service file, instead of the options below.")
@click.option("--puppet", "puppets", multiple=True, type=FILE, help="A puppet file; can be repeated.")
@click.option(
    "--source",
    "sources",
    multiple=True,
    metavar="URI",
    help="Where skeletons come from, for all puppets or one for each; see docs/live.md.  [default: osc:7110]",
)
@click.option("--loop", is_flag=True, help="Play recordings over and over, as ?loop behind each of them does.")
@click.option(
    "--people", type=click.Choice(["each", "nearest", "queue"]), help="Who plays, of several people.  [default: each]"
)
@click.option(
    "--calibrate",
    type=click.Choice(["still", "at_once", "command"]),
    help="When a performer's pose becomes the character's rest pose.  [default: still]",
)
@click.option("--idle", type=FILE, metavar="LOG", help="What the character does while nobody plays it.")
@click.option(
    "--morphs", type=FILE, metavar="GLB", help="What puppetline bake has made of the puppet, for morph weights."
)
@click.option("--host", help="The address to listen at.  [default: 127.0.0.1]")
@click.option("--port", type=PORT, help="The stream's; the control socket has the next one.  [default: 7400]")
@click.option("--token-file", type=FILE, help="A token that clients must know: puppetline token FILE makes one.")
@click.option("--osc", "targets", multiple=True, metavar="HOST:PORT", help="Send OSC there as well; can be repeated.")
@click.option("--osc-rate", type=Finite(1, 1000), help="Frames a second for each of them.  [default: 30]")
@click.option("--takes", type=FILE, metavar="FOLDER", help="Where takes are recorded.  [default: takes]")
@click.option("--metrics", type=click.IntRange(1, 65535), metavar="PORT", help="Answer Prometheus there, on loopback.")
@click.option(
    "--announce/--no-announce", default=None, help="Announce the service in the network by mDNS.  [default: yes]"
)
@click.option("--status", is_flag=True, help="Show a live table.")
@click.option("--log-format", default="text", show_default=True, type=click.Choice(["text", "json"]))
@click.option(
    "--log-level", default="info", show_default=True, type=click.Choice(["debug", "info", "warning", "error"])
)
def serve(config: Path | None, status: bool, log_format: Any, log_level: str, **options: Any) -> None:
    """Stream characters that performers move, live, until it is stopped."""
    settings, folder = _settings(config, options)
    _run(settings, folder, status, log_format, log_level)


def stream(sources: list[str], puppets: list[Path]) -> None:
    """Serve puppets as they are, each with a source of its own."""
    from engine_bridge.service import service_file

    _run(service_file.from_flags(tuple(sources), tuple(puppets), {}, {}, {}), Path())


def _run(
    settings: "ServiceFile", folder: Path, status: bool = False, log_format: Any = "text", log_level: str = "info"
) -> None:
    gc.disable()  # while all is loaded: next to nothing of it is garbage
    from engine_bridge.service.signals import Signals

    with ExitStack() as stack:
        signals = stack.enter_context(Signals())
        from engine_bridge.service.commands import commands
        from engine_bridge.service.monitoring import logs, native_output
        from engine_bridge.service.service import Service

        stack.enter_context(native_output.logged())
        logs.setup(log_format, log_level)
        stack.enter_context(logs.beside())
        display = None
        if status:
            from engine_bridge.service.monitoring.status_table import StatusDisplay

            display = StatusDisplay()
            stack.callback(display.close)
        service = Service(settings, folder, commands, None if display is None else display.update)
        stack.callback(service.close)
        gc.collect()
        gc.freeze()  # what is loaded stays: no collection has to look at it again
        gc.enable()
        signals.waiting = True
        service.run(signals)


def _settings(config: Path | None, options: dict[str, Any]) -> "tuple[ServiceFile, Path]":
    """Return the settings of a file or of options, and what their paths are relative to."""
    from engine_bridge.service import service_file

    loop = options.pop("loop")
    given = {name: value for name, value in options.items() if value is not None and value != ()}
    if config is not None:
        if given or loop:
            raise click.UsageError("--config goes without any option that the file has a key for.")
        return service_file.load(config), config.parent
    if not options["puppets"]:
        raise click.UsageError("Give --puppet, or --config.")
    network = {name: given[name] for name in ("host", "port", "token_file") if name in given}
    rest: dict[str, Any] = {
        "network": network,
        "osc": [_target(each, given.get("osc_rate")) for each in options["targets"]],
    }
    if "takes" in given:
        rest["takes"] = str(given["takes"])
    if "announce" in given:
        rest["announce"] = given["announce"]
    if "metrics" in given:
        rest["metrics"] = {"port": given["metrics"]}
    stage: dict[str, Any] = {name: given[name] for name in ("people", "calibrate") if name in given}
    character: dict[str, Any] = {name: str(given[name]) for name in ("idle", "morphs") if name in given}
    sources = tuple(_looped(uri) if loop else uri for uri in options["sources"] or ("osc:7110",))
    return service_file.from_flags(sources, options["puppets"], stage, character, rest), Path()


def _looped(uri: str) -> str:
    from capture.sources.registry import LOOP_SUFFIX, RECORDED_PREFIXES

    if not uri.startswith(RECORDED_PREFIXES) or uri.endswith(("?loop", "&loop")):
        return uri
    return uri + ("&loop" if "?" in uri else LOOP_SUFFIX)


def _target(text: str, rate: float | None) -> dict[str, Any]:
    host, _, port = text.rpartition(":")
    if not port.isdecimal():
        raise click.UsageError(f"--osc wants HOST:PORT, and not {text!r}.")
    return {"host": host.strip("[]") or "127.0.0.1", "port": int(port), **({} if rate is None else {"rate": rate})}


@click.command()
@click.option("--source", required=True, metavar="URI", help="As for puppetline serve.")
@click.option("-o", "--output", required=True, type=FILE, help="The take to write.")
@click.option("--seconds", type=Finite(0, min_open=True), help="How long.  [default: until Ctrl-C]")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def record(source: str, output: Path, seconds: float | None, force: bool, as_json: bool) -> None:
    """Record what a live source gives, for puppetline convert and replay:."""
    from contextlib import closing
    from dataclasses import asdict

    from capture.sources.registry import open_source
    from engine_bridge.cli.record import record as run
    from engine_bridge.service.monitoring import native_output

    def report(frames: int, elapsed: float) -> None:
        if sys.stderr.isatty():
            click.echo(f"\r{frames:,} frames, {elapsed:.0f} s", err=True, nl=False)

    with native_output.logged(), closing(open_source(source)) as opened:
        summary = run(opened, output, seconds, report, force)
    if sys.stderr.isatty():
        click.echo(err=True)
    if summary.why:
        click.echo(f"puppetline: {summary.why}", err=True)
    if as_json:
        click.echo(json.dumps(asdict(summary), indent=2))
    elif output.exists():
        users = ", ".join(map(str, summary.users)) or "nobody"
        click.echo(f"{summary.take}: {summary.frames:,} frames, {summary.seconds:.1f} s, performers: {users}")
    if summary.why:
        raise click.exceptions.Exit(1)


@click.command()
@click.option("--source", required=True, metavar="URI", help="As for puppetline serve.")
@click.option("-o", "--output", type=FILE, help="The .png to write.")
@click.option("--live", is_flag=True, help="Keep a status line in this terminal.")
@click.option(
    "--seconds",
    type=Finite(0, min_open=True),
    help="How long.  [default: 3 from the first thing that comes; with --live until Ctrl-C]",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def look(source: str, output: Path | None, live: bool, seconds: float | None, as_json: bool) -> None:
    """Show what a source sees, and say why nothing moves; the exit code is 1 where nobody is seen."""
    from capture.sensors.sight import reasons
    from engine_bridge.pictures.look import draw
    from puppetline.files import check_writable, written_whole

    if output is None and not live:
        raise click.UsageError("Give -o, --live, or both.")
    if live and not sys.stdout.isatty():
        raise click.UsageError("--live requires a terminal. Use -o look.png to draw an image.")
    if output is not None:
        check_writable(output, ".png")
    if sys.stderr.isatty():
        click.echo(f"looking at {source} …", err=True)
    sight, reader = _seen_live(source, seconds) if live else (_seen(source, seconds), True)
    if output is not None:
        with written_whole(output) as partial:
            draw(sight, reasons(sight)).save(partial, format="PNG")
    if reader:
        _tell(sight, output, as_json)
    if not (reader and sight.performers):
        raise click.exceptions.Exit(1)


def _tell(sight: "Sight", output: Path | None, as_json: bool) -> None:
    """Print what was seen, and why nothing moves."""
    from capture.sensors.sight import reasons, summary, told

    why = reasons(sight)
    if as_json:
        click.echo(json.dumps(summary(sight, why), indent=2))
        return
    click.echo(f"{'' if output is None else f'{output}: '}{sight.source}, {sight.seconds:.1f} s")
    for _, performer in sorted(sight.performers.items()):
        click.echo(f"  {told(performer)}")
    if sight.level is not None:
        click.echo(f"  the sensor: {sight.level}")
    for reason in why:
        click.echo(f"  {reason.what}" + (f"\n    → {reason.fix}" if reason.fix else ""))


def _seen(source: str, seconds: float | None) -> "Sight":
    """Return what is seen of a source in so many seconds."""
    from contextlib import closing

    from capture.sensors.sight import watch
    from capture.sources.registry import open_source
    from engine_bridge.service.monitoring import native_output

    with native_output.logged(), closing(open_source(source)) as opened:
        return watch(opened, 3.0 if seconds is None else seconds)


def _seen_live(source: str, seconds: float | None) -> "tuple[Sight, bool]":
    """Keep a status line on the terminal; return what was last seen, and whether the terminal is still there."""
    import math
    import time
    from dataclasses import replace

    from rich.live import Live
    from rich.text import Text

    from capture.reconnecting import ReopeningSource
    from capture.sensors.sight import RECENT, Watch, status_line
    from capture.sources.registry import open_source
    from engine_bridge.service.monitoring import native_output
    from engine_bridge.service.signals import Signals

    with ExitStack() as stack:
        signals = stack.enter_context(Signals())
        stack.enter_context(native_output.logged())
        opened = ReopeningSource(source, lambda: open_source(source))
        stack.callback(opened.close)
        signals.waiting = True
        looking, end = Watch(opened, RECENT), time.monotonic() + (math.inf if seconds is None else seconds)
        try:
            with Live(auto_refresh=False, transient=True) as line:
                while not (signals.stop or signals.take_reload() or looking.over or time.monotonic() >= end):
                    due = min(time.monotonic() + _STATUS_PERIOD, end)
                    while not (signals.stop or looking.over) and time.monotonic() < due:
                        looking.take_in(due)
                    line.update(Text(status_line(looking.sight())), refresh=True)
            connected = sys.stdout.isatty()  # a closed terminal, which sent SIGHUP, is none any more
        except OSError:  # it was closed while the line was written
            connected = False
        if not connected:  # what is still to be written would make the end of the process fail
            _discard_output()
        sight = replace(looking.sight(), retried=False)
    return sight, connected


def _discard_output() -> None:
    """Let what this process prints from now on go nowhere."""
    with open(os.devnull, "w") as nowhere:  # noqa: PTH123
        for stream in (sys.stdout, sys.stderr):
            os.dup2(nowhere.fileno(), stream.fileno())


@click.command()
@click.argument("logs", nargs=-1, required=True, type=FILE)
@click.option("-o", "--output", required=True, type=FILE, help="The .toml to write, for --source fused:FILE.toml.")
@click.option(
    "--source",
    "sources",
    multiple=True,
    metavar="URI",
    help="The sensor that made each recording, in their order.  [default: play the recordings]",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def align(logs: tuple[Path, ...], output: Path, sources: tuple[str, ...], as_json: bool) -> None:
    """Find where sensors stand from recordings LOGS of the same performance, one by each sensor."""
    from dataclasses import asdict

    from engine_bridge.cli.align import align as run

    if len(logs) < 2:
        raise click.UsageError("Give two recordings or more.")
    summaries = run(logs, sources, output)
    if as_json:
        click.echo(json.dumps([asdict(each) for each in summaries], indent=2))
        return
    click.echo(f"{output}: {len(logs)} sensors; {logs[0]} gives the frame")
    for each in summaries:
        x, y, z = each.position
        tilt, turn, roll = each.rotation
        click.echo(
            f"  {each.log}: at ({x:.2f}, {y:.2f}, {z:.2f}) m, tilt {tilt:.1f}°, turn {turn:.1f}°, roll {roll:.1f}°, "
            f"clock {1000 * each.clock:+.1f} ms"
        )
        click.echo(
            f"    joints {each.residual_cm:.1f} cm apart (mean) in {each.seconds:.1f} s; "
            f"left and right differ in {100 * each.swapped:.0f} % of the frames"
        )
        for note in each.notes:
            click.echo(f"    note: {note}")


@click.command()
@click.argument("address", default="127.0.0.1:7400")
@click.option("--character", "characters", multiple=True, help="Only this one; can be repeated.")
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    help="controls, morphs, vertices, vertices16, joints, handles, performer; can be repeated.  [default: controls]",
)
@click.option("--seconds", type=Finite(0, min_open=True), help="How long.  [default: until Ctrl-C]")
@click.option("--token-file", type=FILE, help="The token that the service wants.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def listen(
    address: str,
    characters: tuple[str, ...],
    kinds: tuple[str, ...],
    seconds: float | None,
    token_file: Path | None,
    as_json: bool,
) -> None:
    """Say what a client of the service at ADDRESS receives: rates, latency, gaps."""
    from dataclasses import asdict

    from engine_bridge.client import listening
    from engine_bridge.service.security.credentials import read_token

    token = read_token(token_file)
    report = listening.listen(
        address, seconds=seconds, token=token, characters=characters, kinds=kinds or ("controls",)
    )
    click.echo(json.dumps(asdict(report), indent=2) if as_json else listening.describe(report))


@click.command()
@click.argument("puppet", type=FILE)
@click.option("-o", "--output", required=True, type=FILE, help="The .glb to write.")
@click.option(
    "--log", "logs", multiple=True, type=FILE, help="Recorded motion to fit to; can be repeated.  [default: made up]"
)
@click.option("--targets", type=click.IntRange(2), metavar="K", help="At most K morph targets, whatever the error.")
@click.option(
    "--tolerance",
    type=Finite(0, 1, min_open=True),
    help="Largest error of a vertex, as a fraction of the character's diagonal.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def bake(
    puppet: Path, output: Path, logs: tuple[Path, ...], targets: int | None, tolerance: float | None, as_json: bool
) -> None:
    """Make a .glb of PUPPET with morph targets that a live performance can be played on."""
    from engine_bridge.export.bake import bake as run

    with progress() as report:
        summary = run(puppet, output, logs, targets=targets, tolerance=tolerance, progress=report)
    if as_json:
        click.echo(json.dumps(summary.as_dict(), indent=2))
        return
    size = f"{summary.targets} morph targets, {summary.bytes / 1e6:.1f} MB"
    click.echo(f"{summary.output}: {size}, from {summary.frames:,} frames of motion")
    click.echo(
        f"  largest error  {summary.error:.2g} of the diagonal, root mean square {summary.rms:.2g} "
        f"(tolerance {summary.tolerance:g})"
    )
    for note in (*summary.repairs, *summary.notes):
        click.echo(f"  note: {note}")


@click.command("shader-mesh")
@click.argument("puppet", type=FILE)
@click.option("-o", "--output", required=True, type=FILE, help="The .glb to write.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def shader_mesh(puppet: Path, output: Path, as_json: bool) -> None:
    """Make a .glb of PUPPET with ladder coordinates, whose vertices an engine's shader moves by live controls."""
    from engine_bridge.export.shader_mesh import write_ladder

    summary = write_ladder(puppet, output)
    if as_json:
        click.echo(json.dumps(summary.as_dict(), indent=2))
        return
    surfaces = f"{summary.surfaces} surface{'s' if summary.surfaces > 1 else ''}"
    size = f"{summary.vertices:,} vertices in {surfaces}, {summary.bytes / 1e6:.1f} MB"
    click.echo(f"{summary.output}: {size}, ladder coordinates of {summary.fields} fields")
    for note in summary.notes:
        click.echo(f"  note: {note}")


LADDER = copy(shader_mesh)
"""The name that the command had before; it goes on working and is not listed."""
LADDER.name, LADDER.hidden = "ladder", True


@click.command()
@click.option(
    "--source", "sources", multiple=True, metavar="URI", help="A source that must work here; can be repeated."
)
@click.option("--takes", type=FILE, metavar="FOLDER", help="A folder that takes must fit into.  [default: takes]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def doctor(sources: tuple[str, ...], takes: Path | None, as_json: bool) -> None:
    """Report what works on this machine: libraries, ports, folders, sensors, network.

    The exit code is 1 if something does not work that Puppetline requires or that you have asked for.
    """
    from dataclasses import asdict

    from engine_bridge.cli.doctor import checks as doctors

    findings = doctors.examine(takes, sources)
    click.echo(json.dumps([asdict(each) for each in findings], indent=2) if as_json else doctors.text(findings))
    if any(finding.ok is False for finding in findings):
        raise click.exceptions.Exit(1)


@click.command()
@click.argument("file", type=FILE)
def token(file: Path) -> None:
    """Write a new token to FILE, for serve and for its clients."""
    from engine_bridge.service.security.credentials import make_token

    make_token(file)
    click.echo(f"{file}: give it to puppetline serve --token-file, and to the clients.")


@click.command()
@click.argument("file", type=FILE)
def keys(file: Path) -> None:
    """Write new CURVE keys to FILE, NAME.key_secret, and NAME.key."""
    from engine_bridge.service.security.credentials import make_curve_keys

    make_curve_keys(file)
    click.echo(f"{file}: keep it; {file.with_suffix('.key')}: hand it out.")


COMMANDS = (serve, record, look, align, listen, bake, shader_mesh, LADDER, doctor, token, keys)
