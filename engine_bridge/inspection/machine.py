"""All checks of this machine. They take a few seconds and change nothing.

A check fails if something does not work that Puppetline requires or the user has asked for: a required library, the
loopback network, a source or folder that was named, an optional library that is installed but broken, a depth sensor
that is plugged in. Anything else that is missing is optional, and `Finding.fix` says how to get it.
"""

import errno
import os
import platform
import re
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from engine_bridge.inspection import sensors
from engine_bridge.inspection.finding import Finding
from puppetline import clock
from puppetline.errors import PuppetlineError

MODULES = {"dracopy": "DracoPy", "libigl": "igl", "pillow": "PIL", "python-osc": "pythonosc", "pyzmq": "zmq"}
"""Modules of the required distributions whose modules have other names."""

PORTS: tuple[tuple[str, int, str], ...] = (
    ("tcp", 7400, "stream"),
    ("tcp", 7401, "control"),
    ("udp", 7110, "OSC senders"),
    ("udp", 39539, "VMC senders"),
)
"""Default ports: protocol, number and use."""

LOW_DISK_BYTES = 2e9
"""Free space of a disk, in bytes, below which takes may fill it soon."""

FIRST_DATA_SECONDS = 3.0
"""How long the check of a source waits for its first data, in seconds."""

DISCOVERY_SECONDS = 0.3
"""How long to wait for announcements of services, in seconds."""


def examine(takes: Path | None = None, sources: Sequence[str] = ()) -> list[Finding]:
    """Run all checks.

    Parameters
    ----------
    takes : Path, optional
        Folder to record takes in, which must be usable. Without it, the default folder is checked, which need not be.
    sources : sequence of str
        URIs of sources that must work, see `capture.sources.registry`.
    """
    return [
        Finding("Python", sys.version_info >= (3, 11), f"{platform.python_version()}, {platform.platform()}"),
        *_libraries(),
        _processor(),
        *_ports(),
        *_own_folders(),
        _folder("takes", takes or Path("takes"), asked=takes is not None),
        _clock(),
        *sensors.examine(),
        *map(_source, dict.fromkeys(sources)),
        _systemd(),
        _network(),
    ]


def text(findings: Sequence[Finding]) -> str:
    """Return findings as text."""
    width = max(len(finding.name) for finding in findings)
    marks = {True: "ok", False: "!!", None: "--"}
    lines = []
    for finding in findings:
        lines.append(f"{marks[finding.ok]}  {finding.name:{width}}  {finding.detail}")
        if finding.fix:
            lines.append(f"    {'':{width}}  → {finding.fix}")
    return "\n".join(lines)


def required() -> list[str]:
    """Return the distributions that Puppetline requires on every system."""
    return [re.split("[^a-z-]", each)[0] for each in requires("puppetline") or () if ";" not in each]


def _libraries() -> Iterator[Finding]:
    for distribution in required():
        module = MODULES.get(distribution, distribution.replace("-", "_"))
        try:
            import_module(module)
            detail = version(distribution)
        except (ImportError, PackageNotFoundError, OSError) as error:  # OSError: an incompatible shared object
            yield Finding(distribution, False, f"{error}", "Install Puppetline again: pip install --force-reinstall .")
        else:
            yield _pyzmq(detail) if module == "zmq" else Finding(distribution, True, detail)


def _pyzmq(installed: str) -> Finding:
    import zmq

    curve = zmq.has("curve")
    security = "with CURVE" if curve else "without CURVE: tokens work, keys do not"
    fix = "" if curve else "Install pyzmq from its wheel, which contains CURVE."
    return Finding("pyzmq", True, f"{installed}, libzmq {zmq.zmq_version()}, {security}", fix)


def _processor() -> Finding:
    try:
        llvm = import_module("llvmlite.binding")
        features = llvm.get_host_cpu_features()
        vectors = [name for name in ("sse4.2", "avx2", "fma", "avx512f", "neon") if features.get(name)]
        name = llvm.get_host_cpu_name()
    except (ImportError, RuntimeError):
        name, vectors = platform.machine(), []
    threads = {key: value for key, value in os.environ.items() if key.endswith("_NUM_THREADS")}
    set_to = "".join(f", {key}={value}" for key, value in sorted(threads.items()))
    return Finding("processor", True, f"{name}, {os.cpu_count()} threads, {' '.join(vectors) or 'no vectors'}{set_to}")


def _ports() -> Iterator[Finding]:
    for kind, port, use in PORTS:
        name = f"port {port}/{kind}"
        try:
            with socket.socket(type=socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM) as listener:
                if kind == "tcp" and sys.platform != "win32":
                    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the service does
                listener.bind(("127.0.0.1", port))
            yield Finding(name, True, f"free ({use})")
        except OSError as error:
            ok = None if error.errno == errno.EADDRINUSE else False
            fix = "If that is not Puppetline itself, close it or choose another port."
            yield Finding(name, ok, f"{error.strerror or error}{_owner(kind, port)} ({use})", fix)


def _owner(kind: str, port: int) -> str:
    """Return which program uses a port, if the system reports it to this user."""
    import psutil

    try:
        for connection in psutil.net_connections(kind):
            if connection.laddr and connection.laddr.port == port and connection.pid:
                return f" by {psutil.Process(connection.pid).name()}, process {connection.pid}"
    except psutil.Error:
        pass
    return ""


def _own_folders() -> Iterator[Finding]:
    try:
        from engine_bridge.performance.prepared_character import cache_folder
        from engine_bridge.service.stages.calibration_store import state_file
    except (ImportError, OSError) as error:
        yield Finding("cache and state", None, f"not checked: {error}")
        return
    folder = cache_folder()
    sizes = [entry.stat().st_size for entry in folder.glob("*") if entry.is_file()]
    yield _folder("cache", folder, f"{len(sizes)} files, {sum(sizes) / 1e6:.0f} MB, ")
    yield _folder("state", state_file().parent)


def _folder(name: str, folder: Path, contents: str = "", *, asked: bool = False) -> Finding:
    """Check whether a folder, or its nearest existing parent, can be written to; one `asked` for must be."""
    place = folder.absolute()
    while not place.is_dir() and place != place.parent:
        place = place.parent
    try:
        with tempfile.TemporaryFile(dir=place):
            room = shutil.disk_usage(place).free
    except OSError as error:
        fix = f"Give this user permission to write to {place}, or choose another folder."
        return Finding(name, False if asked else None, f"{folder}: cannot be written to ({error.strerror})", fix)
    made = "" if folder.is_dir() else "will be created, "
    fix = "Free space on that disk." if room < LOW_DISK_BYTES else ""
    return Finding(name, True, f"{folder}: {made}{contents}{room / 1e9:.1f} GB free", fix)


def _clock() -> Finding:
    resolution = time.get_clock_info("monotonic").resolution
    coarse = "" if resolution <= 1e-3 else ", too coarse to measure latencies"
    now = time.strftime("%Y-%m-%d %H:%M:%S %Z")
    return Finding("clock", True, f"monotonic to {resolution * 1e9:.0f} ns{coarse}, {now}")


def _source(uri: str) -> Finding:
    """Open a source and wait for its first data."""
    from capture.source import wait
    from capture.sources.registry import open_source

    try:
        with closing(open_source(uri)) as source:
            give_up = clock.now() + FIRST_DATA_SECONDS
            while not source.counts.received and clock.now() < give_up:
                wait(source, give_up)
                source.receive()
            works = bool(source.counts.received)
    except PuppetlineError as error:
        culprit = "" if uri in error.where else f"{error.where}: "  # a library or a file
        return Finding(uri, False, culprit + error.found, error.fix)
    return Finding(uri, True, "works" if works else f"can be opened; no data within {FIRST_DATA_SECONDS:g} s")


def _systemd() -> Finding:
    if not Path("/run/systemd/system").is_dir():
        return Finding("systemd", None, "not the init system here")
    return Finding("systemd", True, "started by it" if os.environ.get("NOTIFY_SOCKET") else "available")


def _network() -> Finding:
    try:
        from engine_bridge.service.discovery import find

        services = find(DISCOVERY_SECONDS)
    except (ImportError, OSError) as error:
        return Finding(
            "multicast DNS",
            None,
            f"not available: {error}",
            "Give clients the address of the service; they cannot discover it here.",
        )
    running = ", ".join(f"{found.name} at {' '.join(found.addresses)}:{found.port}" for found in services)
    return Finding("multicast DNS", True, running or "works; no service announced now")
