"""The processes of a measurement of the live service: the service, senders and listeners.

A sender, a listener or another peer (``python -m MODULE ROLE SETTINGS``) prints a line of JSON when it is ready, and
another one with its result when it has finished or its standard input is closed.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import psutil
import zmq

from benchmarks.datagrams import bodies
from engine_bridge.service.protocol.header import PAYLOAD_OFFSET, TOPIC_BYTES, Header, subscription
from engine_bridge.service.states import STATES

TIMEOUT_SECONDS = 300.0
"""How long to wait for the service, in seconds."""

PERFORMING = STATES.index("performing")

MAX_MESSAGES_PER_TURN = 16
"""Number of messages that a listener receives from one socket before the next socket has its turn."""


class Service:
    """The real command with a service file.

    Parameters
    ----------
    folder : Path
        Folder for the service file, the log, takes and state.
    settings : str
        Content of the service file.
    environment : dict, optional
        Additional environment variables.

    Attributes
    ----------
    process : subprocess.Popen
    started, ready : int
        `time.monotonic_ns` when it was started, and when it served.
    stream, control : str
        Its endpoints.
    """

    def __init__(self, folder: Path, settings: str, environment: dict[str, str] | None = None) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "service.toml").write_text(settings, encoding="utf-8")
        self._log = folder / "service.log"
        command = [sys.executable, "-m", "puppetline", "serve", "--config", str(folder / "service.toml")]
        # bytecode is written, as in an installation
        own = {"XDG_STATE_HOME": str(folder), "PYTHONDONTWRITEBYTECODE": "", **(environment or {})}
        self.started = time.monotonic_ns()
        with self._log.open("ab") as log:
            begin = log.tell()
            self.process = subprocess.Popen([*command, "--log-format", "json"], stderr=log, env=os.environ | own)
        endpoints = self._wait_for("serving", begin)
        self.ready = time.monotonic_ns()
        self.stream, self.control = endpoints["stream"][0], endpoints["control"][0]
        self._usage = psutil.Process(self.process.pid)

    @property
    def log(self) -> str:
        """The log, including earlier runs."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def cpu_seconds(self) -> float:
        """Return the processor time of all its threads, in seconds."""
        times = self._usage.cpu_times()
        return times.user + times.system

    def memory(self) -> int:
        """Return its resident memory in bytes."""
        return self._usage.memory_info().rss

    def end(self, number: int = signal.SIGTERM) -> int:
        """Stop the service and return its exit code."""
        self.process.send_signal(number)
        return self.process.wait(TIMEOUT_SECONDS)

    def _wait_for(self, event: str, begin: int) -> Any:
        """Return the fields of an event in the log."""
        deadline = time.monotonic() + TIMEOUT_SECONDS
        while time.monotonic() < deadline and self.process.poll() is None:
            with self._log.open("rb") as log:
                log.seek(begin)
                lines = [line for line in log if line.startswith(b"{") and line.endswith(b"}\n")]
            found = [json.loads(line) for line in lines]
            for line in found:
                if line["event"] == event:
                    return line["fields"]
            time.sleep(0.005)
        raise SystemExit(f"the service does not start:\n{self.log}")


def settings(
    puppets: dict[str, Path], port: int, *, max_clients: int = 64, stream: int = 0, calibrate: str = "at_once"
) -> str:
    """Return the content of a service file.

    Parameters
    ----------
    puppets : dict
        Names of characters to their puppet files.
    port : int
        Port of the source.
    max_clients : int
    stream : int
        Port of the stream; 0 for any.
    calibrate : str
    """
    lines = ["announce = false", 'takes = "takes"', "[network]", f"port = {stream}", f"max_clients = {max_clients}"]
    lines += ["[[stage]]", f'source = "osc:{port}?units=mm&mirrored=0"', f'calibrate = "{calibrate}"']
    for name, puppet in puppets.items():
        lines += ["[[stage.character]]", f'name = "{name}"', f"puppet = {json.dumps(str(puppet.resolve()))}"]
    return "\n".join(lines) + "\n"


@contextmanager
def serving(folder: Path, text: str, environment: dict[str, str] | None = None) -> Iterator[Service]:
    """Run a service until the block ends."""
    service = Service(folder, text, environment)
    try:
        yield service
    finally:
        if service.process.poll() is None:
            service.process.send_signal(signal.SIGCONT)
            service.end()


def free_udp_port() -> int:
    """Return a free UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def free_tcp_ports() -> int:
    """Return a free TCP port whose successor is also free."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = int(first.getsockname()[1])
            try:
                second.bind(("127.0.0.1", port + 1))
            except (OSError, OverflowError):
                continue
            return port


class Peer:
    """A sender, a listener or another peer, which starts immediately.

    Parameters
    ----------
    role : str
        A role of the module.
    module : str
    settings : JSON
        Keyword arguments of the role.
    """

    def __init__(self, role: str, module: str = "benchmarks.live_peers", **settings: Any) -> None:
        command = [sys.executable, "-m", module, role, json.dumps(settings)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._said().readline()

    def result(self) -> Any:
        """Wait until the peer has finished, and return its result."""
        line = self._said().readline()
        self.end()
        return json.loads(line)

    def end(self) -> Any:
        """Stop the peer, and return its result."""
        found, _ = self._process.communicate()
        return json.loads(found) if found else None

    def _said(self) -> IO[bytes]:
        assert self._process.stdout is not None
        return self._process.stdout


def sender(port: int, schedule: Sequence[tuple[float, int]], users: int = 1) -> Peer:
    """Start a sender of skeletons in the format of OSCeleton.

    Parameters
    ----------
    port : int
    schedule : sequence of (float, int)
        Pairs of frames per second and number of frames.
    users : int
        Number of performers, each with one bundle per frame.

    Returns
    -------
    Peer
        Its result is the list of `time.monotonic_ns` when frames were sent.
    """
    return Peer("send", port=port, schedule=[list(each) for each in schedule], users=users)


def listener(
    endpoint: str, topics: Sequence[str], sockets: int = 1, *, reads: bool = True, times: bool = False
) -> Peer:
    """Start a client with SUB sockets.

    Parameters
    ----------
    endpoint : str
    topics : sequence of str
        Subscriptions of each socket.
    sockets : int
    reads : bool
        False for a client that never reads.
    times : bool
        Whether to keep the times of each message.

    Returns
    -------
    Peer
        Its result is a list with one dict per socket: by topic the number of `messages`, the `first` and `last`
        sequence numbers and how many were `lost` between them; and with `times` a list of [state, received, arrived],
        in nanoseconds of `time.monotonic_ns`.
    """
    return Peer("listen", endpoint=endpoint, topics=list(topics), sockets=sockets, reads=reads, times=times)


def _send(ended: threading.Event, port: int, schedule: list[tuple[float, int]], users: int) -> list[int]:
    frames = bodies(users)
    say("ready")
    sent: list[int] = []
    due = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        for rate, count in schedule:
            for _ in range(count):
                due += 1 / rate
                time.sleep(max(0.0, due - time.monotonic()))
                if ended.is_set():
                    return sent
                sent.append(time.monotonic_ns())
                for datagram in frames[len(sent) % len(frames)]:
                    sending.sendto(datagram, ("127.0.0.1", port))
    return sent


def _listen(
    ended: threading.Event, endpoint: str, topics: list[str], sockets: int, reads: bool, times: bool
) -> list[dict[str, Any]]:
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    poller = zmq.Poller()
    found: dict[zmq.Socket[bytes], dict[str, Any]] = {}
    for _ in range(sockets):
        opened = context.socket(zmq.SUB)
        opened.linger = 0
        opened.reconnect_ivl, opened.reconnect_ivl_max = 20, 200
        if not reads:
            opened.rcvhwm = 10  # more messages wait in the service
        for topic in topics:
            opened.subscribe(subscription(topic))
        opened.connect(endpoint)
        poller.register(opened, zmq.POLLIN)
        found[opened] = {"times": []} if times else {}
    say("ready")
    while not ended.is_set():
        if not reads:
            ended.wait(0.2)
            continue
        for opened, _ in poller.poll(200):
            _take(opened, found[opened])
    context.destroy(linger=0)
    return list(found.values())


def _take(opened: "zmq.Socket[bytes]", found: dict[str, Any]) -> None:
    """Record the messages that a socket has received."""
    for _ in range(MAX_MESSAGES_PER_TURN):
        try:
            message = opened.recv(zmq.NOBLOCK)
        except zmq.Again:
            return
        arrived = time.monotonic_ns()
        header = Header.unpack(message[TOPIC_BYTES:PAYLOAD_OFFSET])
        topic = message[:TOPIC_BYTES].rstrip(b"\0").decode()
        record = found.setdefault(topic, {"messages": 0, "first": header.sequence, "last": header.sequence, "lost": 0})
        if record["messages"]:
            record["lost"] += header.sequence - record["last"] - 1
        record["messages"] += 1
        record["last"] = header.sequence
        if "times" in found:
            found["times"].append([header.state, header.received, arrived])


def say(value: Any) -> None:
    """Print a line of JSON for the process that started this one."""
    print(json.dumps(value), flush=True)


def take_part(roles: Mapping[str, Callable[..., Any]]) -> None:
    """Run the role that the command line names until standard input is closed, and print its result."""
    ended = threading.Event()

    def wait() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    say(roles[sys.argv[1]](ended, **json.loads(sys.argv[2])))


if __name__ == "__main__":
    take_part({"send": _send, "listen": _listen})
