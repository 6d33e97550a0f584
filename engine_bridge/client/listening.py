"""Measures what a client of a service receives: rates, latency and gaps, for `puppetline listen`.

The client uses nothing but the protocol of docs/protocol.md.
"""

import math
import secrets
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import zmq
from zmq.utils.monitor import recv_monitor_message

from engine_bridge.client.connection import ADDRESS, check_name, subscriber, with_scheme
from engine_bridge.service.protocol.header import FRAME_KINDS, NAME, Kind, WireError, subscription
from engine_bridge.service.protocol.payloads import Morphs, Received, decode
from engine_bridge.service.states import STATES
from puppetline import clock
from puppetline.errors import ServiceError

SPARSE_TOPICS = ("/joints", "/performer", "/channels")
"""Ends of the topics whose sequence numbers have gaps although nothing is lost."""

POLL_SECONDS = 0.25
"""Maximum time that the client waits for a message before it looks at the clock, in seconds."""

MAX_LATENCIES = 100_000
"""Maximum number of latencies per topic for percentiles; the newest are kept."""

MAX_CHARACTERS = 256
"""Maximum number of characters followed when none are named."""

REFUSALS = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
"""Events of a connection that the service refuses. They differ by what this client has read before the connection was
closed."""

NOTICE_SECONDS = 3.0
"""Time without a message after which the client says what is missing, in seconds."""

FIRST_SECONDS = 5.0
"""Time in which the first message must arrive, in seconds, if the duration of the measurement is given."""

LOOPBACK = ("tcp://127.", "tcp://localhost:", "tcp://[::1]:")


@dataclass(frozen=True)
class TopicReport:
    """What a client has received on one topic.

    Attributes
    ----------
    topic : str
    messages, bytes : int
    rate : float or None
        Messages per second between the first and the last; None for fewer than two.
    missing : int or None
        Number of frames that are missing in the sequence; None for `SPARSE_TOPICS`.
    restarts : int
        How often the sequence restarted.
    latency_ms : dict or None
        ``p50``, ``p95``, ``p99`` and ``max`` of the time from a skeleton's arrival at the service to the message's
        arrival here; None if the service is on another machine, which has another clock.
    state : str
        State of the performer in the last message.
    user : int
        User number in the last message.
    residual : float or None
        Residual of the morph weights in the last message.
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
        Duration of the measurement, from the first message on.
    bytes : int
        Size of all messages.
    refused : int
        Number of messages that were not understood.
    scenes : dict
        Numbers and size of each character's scene, by the character's name.
    heard : list of TopicReport
    """

    address: str
    seconds: float
    bytes: int
    refused: int
    scenes: dict[str, dict[str, Any]]
    heard: list[TopicReport]


def listen(
    address: str = ADDRESS,
    *,
    seconds: float | None = None,
    token: str | None = None,
    characters: Sequence[str] = (),
    kinds: Sequence[str] = ("controls",),
    notice: Callable[[str], None] = lambda _text: None,
) -> ListenReport:
    """Follow characters, and measure what arrives.

    Parameters
    ----------
    address : str
        ``tcp://HOST:PORT`` or ``HOST:PORT`` of the stream.
    seconds : float, optional
        Duration of the measurement, from the first message on; until Ctrl-C by default.
    token : str, optional
        Token of the service, if it requires one.
    characters : sequence of str
        Names of the characters to follow; all by default.
    kinds : sequence of str
        Words of `FRAME_KINDS`, and ``performer``.
    notice : callable
        Called once with a text if the service refuses the client, or if nothing has been received for
        `NOTICE_SECONDS`; the client goes on.

    Raises
    ------
    ServiceError
        The address, a kind or a name is invalid, or nothing was received.
    """
    for name in characters:
        check_name("--character", name)
    address = with_scheme(address)
    listener = _Listener(address, tuple(kinds))
    context = zmq.Context[zmq.Socket[bytes]]()
    try:
        socket = subscriber(context, address, token)
        silence = _Silence(address, socket, notice)
        listener.follow(socket, characters)
        end = math.inf if seconds is None else clock.now() + FIRST_SECONDS
        with suppress(KeyboardInterrupt):
            while (now := clock.now()) < end:
                if clock.block(min(end, now + POLL_SECONDS), partial(_poll, socket)):
                    listener.take(socket, socket.recv(), clock.now_ns())
                    end = math.inf if seconds is None else listener.begun + seconds
                silence.look(listener)
    finally:
        context.destroy(linger=0)
    if not listener.has_heard:
        raise silence.error()
    return listener.report()


def _poll(socket: "zmq.Socket[bytes]", seconds: float) -> int:
    return socket.poll(math.ceil(1000 * seconds))


class _Silence:
    """Why no message has been received, which is told once: after a refusal, or after `NOTICE_SECONDS`."""

    def __init__(self, address: str, socket: "zmq.Socket[bytes]", notice: Callable[[str], None]) -> None:
        self._address, self._refusals, self._notice = address, socket.get_monitor_socket(REFUSALS), notice
        self._begun = clock.now()
        self._is_told = self._is_refused = False

    def look(self, listener: "_Listener") -> None:
        """Look whether anything has been received or refused."""
        while self._refusals.poll(0):
            recv_monitor_message(self._refusals)
            self._is_refused = True
        if not self._is_told and (self._is_refused or clock.now() > self._begun + NOTICE_SECONDS):
            self._is_told = True
            if not listener.has_heard:
                self._notice(str(self.error()))

    def error(self) -> ServiceError:
        """Return the error after the time so far."""
        if self._is_refused:
            return ServiceError(
                self._address,
                found="a service that refuses this client",
                expected="a client with the service's token",
                fix="Name the file with the token: --token-file FILE.",
            )
        return ServiceError(
            self._address,
            found=f"no message within {clock.now() - self._begun:.0f} s",
            expected="a running service",
            fix="Start one with puppetline serve, or check the address.",
        )


@dataclass
class _Tally:
    """Counts the messages of a topic."""

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
    latencies: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_LATENCIES))

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
    """Subscribes to characters, and counts their messages.

    Attributes
    ----------
    begun : float
        `puppetline.clock.now` when the first message arrived; before that, when this was made.
    """

    def __init__(self, address: str, kinds: tuple[str, ...]) -> None:
        self._address, self._kinds = address, kinds
        self._own = secrets.token_hex(8)
        self.begun = clock.now()
        self._bytes = self._refused = 0
        self._followed: set[str] = set()
        self._all = False
        self._scenes: dict[str, dict[str, Any]] = {}
        self._tallies: dict[str, _Tally] = {}

    @property
    def has_heard(self) -> bool:
        """Whether any message has been received."""
        return self._bytes > 0 or self._refused > 0

    def follow(self, socket: "zmq.Socket[bytes]", characters: Sequence[str]) -> None:
        """Subscribe to characters; to all, and to those added later, if none are named."""
        self._all = not characters
        socket.subscribe(subscription("service/characters"))
        for name in characters:
            self._subscribe(socket, name)

    def _subscribe(self, socket: "zmq.Socket[bytes]", name: str) -> None:
        """Request a character's scene for this client alone, and subscribe to its frames."""
        for kind in (f"scene/{self._own}", *self._kinds):
            socket.subscribe(subscription(f"{name}/{kind}"))
        self._followed.add(name)

    def take(self, socket: "zmq.Socket[bytes]", content: bytes, now: int) -> None:
        """Count a message that arrived at `now`, in nanoseconds."""
        self.begun = self.begun if self.has_heard else clock.now()
        try:
            message = decode(content)
        except WireError:
            self._refused += 1
            return
        self._bytes += len(content)
        name = message.topic.partition("/")[0]
        match message.header.kind:
            case Kind.CHARACTERS if isinstance(message.body, list):
                names = [each.get("name") for each in message.body[:MAX_CHARACTERS] if isinstance(each, dict)]
                for new in [new for new in names if isinstance(new, str) and NAME.fullmatch(new)]:
                    if self._all and new not in self._followed and len(self._followed) < MAX_CHARACTERS:
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
        """Request the scene again if frames belong to another revision."""
        known = self._scenes.get(name)
        if known is not None and known["revision"] != revision:
            del self._scenes[name]
            own = subscription(f"{name}/scene/{self._own}")
            socket.unsubscribe(own)
            socket.subscribe(own)

    def report(self) -> ListenReport:
        """Return what has been received so far."""
        return ListenReport(
            address=self._address,
            seconds=clock.now() - self.begun,
            bytes=self._bytes,
            refused=self._refused,
            scenes=dict(self._scenes),
            heard=[self._topic(topic, tally) for topic, tally in sorted(self._tallies.items())],
        )

    def _topic(self, topic: str, tally: _Tally) -> TopicReport:
        span = (tally.last - tally.first) / 1e9
        latency = None
        if self._address.startswith(LOOPBACK):
            p50, p95, p99, most = np.percentile(tally.latencies, [50, 95, 99, 100]).tolist()
            latency = {"p50": p50, "p95": p95, "p99": p99, "max": most}
        return TopicReport(
            topic=topic,
            messages=tally.messages,
            bytes=tally.bytes,
            rate=(tally.messages - 1) / span if span > 0 else None,
            missing=None if topic.endswith(SPARSE_TOPICS) else tally.missing,
            restarts=tally.restarts,
            latency_ms=latency,
            state=STATES[tally.state],
            user=tally.user,
            residual=tally.residual,
        )


def describe(report: ListenReport) -> str:
    """Return a report as text: one line per scene, then one per topic."""
    lines = [
        f"{report.address}: {report.seconds:.1f} s, {report.bytes / 1e6:.2f} MB"
        + (f", {report.refused:,} not understood" if report.refused else "")
    ]
    lines += [
        f"{name}: revision {scene['revision']}, {scene['vertices']:,} vertices, {scene['triangles']:,} triangles, "
        f"scene of {scene['bytes'] / 1e6:.2f} MB"
        for name, scene in sorted(report.scenes.items())
    ]
    lines += [_line(topic) for topic in report.heard]
    if not report.heard:
        lines.append("no frames: nothing moves these characters at present, or none have this name or kind")
    return "\n".join(lines)


def _line(topic: TopicReport) -> str:
    rate = "–" if topic.rate is None else f"{topic.rate:.1f}"
    text = f"{topic.topic}: {topic.state}, {topic.messages:,} frames, {rate} per second"
    if topic.missing is not None:
        text += f", {topic.missing:,} missing"
    if topic.restarts:
        text += f", {topic.restarts:,} restarts"
    if topic.latency_ms is not None:
        p50, p99, most = (topic.latency_ms[name] for name in ("p50", "p99", "max"))
        text += f", latency {p50:.2f} ms (p99 {p99:.2f}, max {most:.2f})"
    if topic.residual is not None:
        text += f", residual {topic.residual:.2g} of the diagonal"
    return text
