"""What a client receives: rates, latency and gaps, for `puppetline listen`.

It is a client like any other, written from docs/protocol.md.
"""

import secrets
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import zmq

from engine_bridge.service.protocol.header import FRAME_KINDS, NAME, Kind, WireError, subscription
from engine_bridge.service.protocol.payloads import Morphs, Received, decode
from engine_bridge.service.security.endpoints import keep_alive
from engine_bridge.service.states import STATES
from puppetline.errors import ServiceError

ADDRESS = "tcp://127.0.0.1:7400"

KINDS = tuple(kind.word for kind in (*FRAME_KINDS, Kind.PERFORMER))
"""What can be listened to."""

NOT_EVERY_FRAME = ("/joints", "/performer")
"""Topics on which numbers are left out though nothing is lost."""

UPDATE_EVERY = 1.0
"""Seconds between two calls of `on_update`."""

MOST_KEPT = 100_000
"""Latencies of a topic that percentiles are taken of: the newest."""

MOST_FOLLOWED = 256
"""Characters."""

LARGEST = 1 << 30
"""Bytes of a message, above which whatever sends it is no service."""

LOOPBACK = ("tcp://127.", "tcp://localhost:", "tcp://[::1]:")


@dataclass(frozen=True)
class Heard:
    """What came on one topic.

    Attributes
    ----------
    topic : str
    messages, bytes : int
    rate : float or None
        Messages a second, from the first to the last; None for fewer than two.
    missing : int or None
        Frames whose numbers were left out; None for `NOT_EVERY_FRAME`.
    restarts : int
        How often numbers began anew.
    latency_ms : dict or None
        ``p50``, ``p95``, ``p99`` and ``max`` from what moved the character coming in at the service to this client
        having the message; None on another machine, whose clock is another.
    state : str
        Of the performer, in the last message.
    user : int
    residual : float or None
        Of morphs, in the last message.
    """

    topic: str
    messages: int
    bytes: int
    rate: float | None
    missing: int | None
    restarts: int
    latency_ms: dict[str, float] | None
    state: str
    user: int
    residual: float | None


@dataclass(frozen=True)
class ListenReport:
    """What a client has received.

    Attributes
    ----------
    address : str
    seconds : float
        For which it listened.
    bytes : int
        Of all messages.
    refused : int
        Messages that were not understood.
    scenes : dict
        By character: what its scene says in numbers, and how large it is.
    heard : list of Heard
    """

    address: str
    seconds: float
    bytes: int
    refused: int
    scenes: dict[str, dict[str, Any]]
    heard: list[Heard]


def listen(
    address: str = ADDRESS,
    *,
    seconds: float | None = None,
    token: str | None = None,
    characters: Sequence[str] = (),
    kinds: Sequence[str] = ("controls",),
    on_update: Callable[[ListenReport], None] | None = None,
) -> ListenReport:
    """Follow characters, and measure what comes.

    Parameters
    ----------
    address : str
        ``tcp://HOST:PORT`` or ``HOST:PORT`` of the stream.
    seconds : float, optional
        For ever, or until Ctrl-C, if left out.
    token : str, optional
        What the service wants from clients on other machines.
    characters : sequence of str
        All of them if empty.
    kinds : sequence of str
        Some of `KINDS`.
    on_update : callable, optional
        Told once a second what has come so far.

    Raises
    ------
    ServiceError
        An address that is none, a kind that there is not, a name that no character can have, or nothing at all that
        came in all the time.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise ServiceError("--kind", found=repr(kind), expected=f"one of {', '.join(KINDS)}", fix="Choose another.")
    for name in characters:
        if not NAME.fullmatch(name):
            fix = "Leave it out to see them all."
            raise ServiceError("--character", found=repr(name), expected="a character's name", fix=fix)
    address = address if "://" in address else f"tcp://{address}"
    listener = _Listener(address, tuple(kinds))
    context = zmq.Context[zmq.Socket[bytes]]()
    try:
        socket = _connected(context, address, token)
        listener.follow(socket, characters)
        _hear(socket, listener, seconds, on_update)
    except KeyboardInterrupt:
        pass
    finally:
        context.destroy(linger=0)
    report = listener.report()
    if not report.bytes and not report.refused:
        raise ServiceError(
            address,
            found=f"nothing that came within {report.seconds:.0f} s",
            expected="a running service that lets this client in",
            fix="Start it with puppetline serve; check the address, and the token if it wants one.",
        )
    return report


def _connected(context: "zmq.Context[zmq.Socket[bytes]]", address: str, token: str | None) -> "zmq.Socket[bytes]":
    socket = context.socket(zmq.SUB)
    socket.setsockopt(zmq.MAXMSGSIZE, LARGEST)
    socket.setsockopt(zmq.RECONNECT_IVL, 100)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, 1000)
    keep_alive(socket)
    if token is not None:
        socket.setsockopt_string(zmq.PLAIN_USERNAME, "puppetline")
        socket.setsockopt_string(zmq.PLAIN_PASSWORD, token)
    try:
        socket.connect(address)
    except zmq.ZMQError as error:
        raise ServiceError(
            address, found=f"no address ({error.strerror})", expected=f"one like {ADDRESS}", fix="Correct it."
        ) from error
    return socket


def _hear(
    socket: "zmq.Socket[bytes]",
    listener: "_Listener",
    seconds: float | None,
    on_update: Callable[[ListenReport], None] | None,
) -> None:
    begun = time.monotonic()
    end = float("inf") if seconds is None else begun + seconds
    update = begun + UPDATE_EVERY
    while (now := time.monotonic()) < end:
        if now >= update and on_update is not None:
            on_update(listener.report())
            update += UPDATE_EVERY
        if socket.poll(max(0, round(1000 * min(end - now, UPDATE_EVERY / 4)))):
            listener.take(socket, socket.recv(), time.monotonic_ns())


@dataclass
class _Tally:
    """A topic's messages so far."""

    messages: int = 0
    bytes: int = 0
    first: int = 0
    last: int = 0
    sequence: int | None = None
    missing: int = 0
    restarts: int = 0
    state: int = 0
    user: int = 0
    residual: float | None = None
    latencies: deque[float] = field(default_factory=lambda: deque(maxlen=MOST_KEPT))

    def add(self, message: Received, size: int, now: int) -> None:
        header = message.header
        self.first = self.first if self.messages else now
        self.messages, self.bytes, self.last = self.messages + 1, self.bytes + size, now
        if self.sequence is not None:
            step = header.sequence - self.sequence
            self.missing += max(step - 1, 0)
            self.restarts += step <= 0
        self.sequence, self.state, self.user = header.sequence, header.state, header.user
        self.latencies.append((now - header.received) / 1e6)
        if isinstance(message.body, Morphs):
            self.residual = message.body.residual


class _Listener:
    """Takes messages and keeps count."""

    def __init__(self, address: str, kinds: tuple[str, ...]) -> None:
        self._address, self._kinds = address, kinds
        self._own = secrets.token_hex(8)
        self._begun = time.monotonic()
        self._bytes = self._refused = 0
        self._followed: set[str] = set()
        self._all = False
        self._scenes: dict[str, dict[str, Any]] = {}
        self._tallies: dict[str, _Tally] = {}

    def follow(self, socket: "zmq.Socket[bytes]", characters: Sequence[str]) -> None:
        """Subscribe to characters, to all that there are and come if none are named."""
        self._all = not characters
        socket.subscribe(subscription("service/characters"))
        for name in characters:
            self._subscribe(socket, name)

    def _subscribe(self, socket: "zmq.Socket[bytes]", name: str) -> None:
        """Ask for a character's scene, for this client alone, and for its frames."""
        for kind in (f"scene/{self._own}", *self._kinds):
            socket.subscribe(subscription(f"{name}/{kind}"))
        self._followed.add(name)

    def take(self, socket: "zmq.Socket[bytes]", content: bytes, now: int) -> None:
        """Take a message that has come at `now`, nanoseconds."""
        try:
            message = decode(content)
        except WireError:
            self._refused += 1
            return
        self._bytes += len(content)
        name = message.topic.partition("/")[0]
        match message.header.kind:
            case Kind.CHARACTERS if isinstance(message.body, list):
                names = [each.get("name") for each in message.body[:MOST_FOLLOWED] if isinstance(each, dict)]
                for new in [new for new in names if isinstance(new, str) and NAME.fullmatch(new)]:
                    if self._all and new not in self._followed and len(self._followed) < MOST_FOLLOWED:
                        self._subscribe(socket, new)
            case Kind.SCENE:
                facts = message.body.facts
                wanted = ("vertices", "triangles", "fields", "isolines", "morphs", "diagonal")
                self._scenes[name] = {
                    "revision": message.header.revision,
                    **{key: facts.get(key) for key in wanted},
                    "bytes": len(content),
                }
            case kind if kind in FRAME_KINDS or kind == Kind.PERFORMER:
                self._tallies.setdefault(message.topic, _Tally()).add(message, len(content), now)
                self._refresh(socket, name, message.header.revision)

    def _refresh(self, socket: "zmq.Socket[bytes]", name: str, revision: int) -> None:
        """Ask for the scene again where frames are of another one."""
        known = self._scenes.get(name)
        if known is not None and known["revision"] != revision:
            del self._scenes[name]
            own = subscription(f"{name}/scene/{self._own}")
            socket.unsubscribe(own)
            socket.subscribe(own)

    def report(self) -> ListenReport:
        """Return what has come so far."""
        return ListenReport(
            address=self._address,
            seconds=time.monotonic() - self._begun,
            bytes=self._bytes,
            refused=self._refused,
            scenes=dict(self._scenes),
            heard=[self._heard(topic, tally) for topic, tally in sorted(self._tallies.items())],
        )

    def _heard(self, topic: str, tally: _Tally) -> Heard:
        span = (tally.last - tally.first) / 1e9
        latency = None
        if self._address.startswith(LOOPBACK):
            p50, p95, p99, most = np.percentile(tally.latencies, [50, 95, 99, 100]).tolist()
            latency = {"p50": p50, "p95": p95, "p99": p99, "max": most}
        return Heard(
            topic=topic,
            messages=tally.messages,
            bytes=tally.bytes,
            rate=(tally.messages - 1) / span if span > 0 else None,
            missing=None if topic.endswith(NOT_EVERY_FRAME) else tally.missing,
            restarts=tally.restarts,
            latency_ms=latency,
            state=STATES[tally.state],
            user=tally.user,
            residual=tally.residual,
        )


def describe(report: ListenReport) -> str:
    """Lay a report out as text: a line for each character's scene, then one for each topic."""
    lines = [
        f"{report.address}: {report.seconds:.1f} s, {report.bytes / 1e6:.2f} MB"
        + (f", {report.refused:,} not understood" if report.refused else "")
    ]
    lines += [
        f"{name}: revision {scene['revision']}, {scene['vertices']:,} vertices, {scene['triangles']:,} triangles, "
        f"scene of {scene['bytes'] / 1e6:.2f} MB"
        for name, scene in sorted(report.scenes.items())
    ]
    lines += [_line(heard) for heard in report.heard]
    if not report.heard:
        lines.append("no frames: nothing moves these characters at the moment, or there are none of this name or kind")
    return "\n".join(lines)


def _line(heard: Heard) -> str:
    rate = "–" if heard.rate is None else f"{heard.rate:.1f}"
    text = f"{heard.topic}: {heard.state}, {heard.messages:,} frames, {rate} a second"
    if heard.missing is not None:
        text += f", {heard.missing:,} missing"
    if heard.restarts:
        text += f", {heard.restarts:,} new starts"
    if heard.latency_ms is not None:
        p50, p99, most = (heard.latency_ms[name] for name in ("p50", "p99", "max"))
        text += f", latency {p50:.2f} ms (p99 {p99:.2f}, max {most:.2f})"
    if heard.residual is not None:
        text += f", residual {heard.residual:.2g} of the diagonal"
    return text
