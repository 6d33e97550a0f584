"""What works on this machine and what does not: `puppetline doctor`. It takes a few seconds and changes nothing."""

import os
import platform
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from engine_bridge.live import sensors
from engine_bridge.live.finding import Finding

LIBRARIES: dict[str, str] = {
    "click": "click",
    "libigl": "igl",
    "msgpack": "msgpack",
    "numba": "numba",
    "numpy": "numpy",
    "pillow": "PIL",
    "platformdirs": "platformdirs",
    "prometheus-client": "prometheus_client",
    "psutil": "psutil",
    "pydantic": "pydantic",
    "pyzmq": "zmq",
    "rich": "rich",
    "scipy": "scipy",
    "tomlkit": "tomlkit",
    "zeroconf": "zeroconf",
}
"""Distributions that Puppetline needs, and the modules they bring."""

PORTS: tuple[tuple[str, int, str], ...] = (
    ("tcp", 7400, "stream"),
    ("tcp", 7401, "control"),
    ("udp", 7110, "OSC senders"),
    ("udp", 39539, "VMC senders"),
)
"""Ports that are used where nothing else is said."""

LITTLE_ROOM = 2e9
"""Bytes; less than this on a disk is soon filled by takes."""

_LISTENING = 0.3  # seconds for others that announce themselves


def examine(takes: Path = Path("takes")) -> list[Finding]:
    """Look at everything.

    Parameters
    ----------
    takes : Path
        Folder that takes are recorded in.
    """
    return [
        _python(),
        *_libraries(),
        _processor(),
        *_ports(),
        *_own_folders(),
        _folder("takes", takes),
        _clock(),
        *sensors.examine(),
        _systemd(),
        _network(),
    ]


def text(findings: Sequence[Finding]) -> str:
    """Return findings as lines to read."""
    width = max(len(finding.name) for finding in findings)
    marks = {True: "ok", False: "!!", None: "--"}
    lines = []
    for finding in findings:
        lines.append(f"{marks[finding.ok]}  {finding.name:{width}}  {finding.detail}")
        if finding.fix:
            lines.append(f"    {'':{width}}  → {finding.fix}")
    return "\n".join(lines)


def _python() -> Finding:
    return Finding("Python", sys.version_info >= (3, 11), f"{platform.python_version()}, {platform.platform()}")


def _libraries() -> Iterator[Finding]:
    for distribution, module in LIBRARIES.items():
        try:
            import_module(module)
            detail = version(distribution)
        except (ImportError, PackageNotFoundError, OSError) as error:  # OSError: a shared object that does not fit
            yield Finding(distribution, False, f"{error}", "Install Puppetline again: pip install --force-reinstall .")
        else:
            yield _curve(detail) if module == "zmq" else Finding(distribution, True, detail)


def _curve(pyzmq: str) -> Finding:
    import zmq

    curve = zmq.has("curve")
    return Finding(
        "pyzmq",
        curve,
        f"{pyzmq}, libzmq {zmq.zmq_version()}, CURVE {'there' if curve else 'missing'}",
        "" if curve else "Install pyzmq from its wheel, which brings CURVE; without it, only PLAIN works.",
    )


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
                if kind == "tcp" and os.name == "posix":
                    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the service does
                listener.bind(("127.0.0.1", port))
            yield Finding(name, True, f"free ({use})")
        except OSError as error:
            yield Finding(
                name,
                False,
                f"{error.strerror or error}{_owner(kind, port)} ({use})",
                "Fine if that is Puppetline itself; otherwise end it, or choose another port.",
            )


def _owner(kind: str, port: int) -> str:
    """Say which program has a port, as far as we may know."""
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
        from engine_bridge.live.performers import state_file
        from engine_bridge.rig import cache_folder
    except (ImportError, OSError) as error:
        yield Finding("cache and state", None, f"not looked at: {error}")
        return
    folder = cache_folder()
    sizes = [entry.stat().st_size for entry in folder.glob("*") if entry.is_file()]
    yield _folder("cache", folder, f"{len(sizes)} files, {sum(sizes) / 1e6:.0f} MB, ")
    yield _folder("state", state_file().parent)


def _folder(name: str, folder: Path, contents: str = "") -> Finding:
    """Find out whether a folder, or the one that it would be made in, can be written to."""
    place = folder.absolute()
    while not place.is_dir() and place != place.parent:
        place = place.parent
    try:
        with tempfile.TemporaryFile(dir=place):
            room = shutil.disk_usage(place).free
    except OSError as error:
        return Finding(
            name,
            False,
            f"{folder}: cannot be written to ({error.strerror})",
            f"Give this user permission to write to {place}, or choose another folder.",
        )
    scarce = room < LITTLE_ROOM
    made = "" if folder.is_dir() else "will be made, "
    return Finding(
        name,
        not scarce,
        f"{folder}: {made}{contents}{room / 1e9:.1f} GB free",
        "Make room on that disk." if scarce else "",
    )


def _clock() -> Finding:
    resolution = time.get_clock_info("monotonic").resolution
    fine = resolution <= 1e-3
    return Finding(
        "clock",
        fine,
        f"monotonic to {resolution * 1e9:.0f} ns, {time.strftime('%Y-%m-%d %H:%M:%S %Z')}",
        "" if fine else "Latencies will read coarse: this system's clock is.",
    )


def _systemd() -> Finding:
    if not Path("/run/systemd/system").is_dir():
        return Finding("systemd", None, "not the init system here")
    ours = "started by it" if os.environ.get("NOTIFY_SOCKET") else "there"
    return Finding("systemd", True, ours)


def _network() -> Finding:
    try:
        from engine_bridge.live.discovery import find

        services = find(_LISTENING)
    except (ImportError, OSError) as error:
        return Finding(
            "multicast DNS",
            False,
            f"not to be had: {error}",
            "Services are not found by themselves here; give their address.",
        )
    running = ", ".join(f"{found.name} at {' '.join(found.addresses)}:{found.port}" for found in services)
    return Finding("multicast DNS", True, running or "works; nobody announces a Puppetline now")
