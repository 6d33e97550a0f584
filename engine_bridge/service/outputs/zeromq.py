"""The output over ZeroMQ, the stream: clients subscribe, and only what they subscribe to is computed.

Nothing here waits: a client that does not read loses messages, and does not slow down the others (docs/protocol.md).
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import zmq

from engine_bridge.service.monitoring.status import OutputStatus, Status
from engine_bridge.service.outputs.output import Opening, Output, OutputTable
from engine_bridge.service.outputs.subscriptions import Answers, Subscriptions
from engine_bridge.service.protocol.frame import Frame, StreamedCharacter
from engine_bridge.service.protocol.header import (
    FRAME_KINDS,
    WORDS,
    Header,
    Kind,
    is_topic,
    join,
    topic,
    topic_field,
    write_json,
)
from engine_bridge.service.protocol.payloads import encode, header
from engine_bridge.service.security.endpoints import Endpoint, NetworkSettings

QUEUED_FRAMES = 2
"""Number of frames of all kinds queued for a slow client; later ones are dropped for that client."""

QUEUED_OTHERS = 8
"""Number of further messages, such as scenes, queued for a client."""

SEND_BUFFER_BYTES = 128 * 1024
"""Size of the system's send buffer per client; what waits there is old when it arrives."""

REQUESTS_PER_TURN = 256
"""Number of subscriptions read before frames are sent again."""


class NetworkTable(NetworkSettings, OutputTable):
    """[network]: where the stream and the control socket listen, and which clients may connect."""

    def open(self, opening: Opening) -> Output:
        """Open the stream; see `ZeroMqOutput`."""
        output = ZeroMqOutput(opening.context, opening.endpoints, opening.characters)
        for socket in output.sockets:
            opening.guard.watch(socket, output.forget)
        return output


@dataclass
class _Stream:
    """A socket's side of things; `kinds` are those wanted of a character, as long as subscriptions stay the same."""

    subscriptions: Subscriptions = field(default_factory=Subscriptions)
    answers: Answers = field(default_factory=Answers)
    kinds: dict[str, list[Kind]] = field(default_factory=dict)

    def kinds_of(self, name: str) -> list[Kind]:
        if name not in self.kinds:
            self.kinds[name] = [kind for kind in FRAME_KINDS if self.subscriptions.wants(topic(name, kind))]
        return self.kinds[name]


class ZeroMqOutput(Output):
    """Sends characters to the clients that subscribe to them.

    Parameters
    ----------
    context : zmq.Context
    endpoints : sequence of Endpoint
        One socket is bound per endpoint.
    characters : sequence of StreamedCharacter
        See `announce`.
    clock : callable
        Seconds that never decrease.

    Raises
    ------
    zmq.ZMQError
        An endpoint that cannot be bound.
    """

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        endpoints: Sequence[Endpoint],
        characters: Sequence[StreamedCharacter],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._messages = self._bytes = 0
        self._clock = clock
        self._characters: dict[str, StreamedCharacter] = {}
        self._kept: dict[bytes, bytes] = {}
        self._performers: dict[str, tuple[str, int | None]] = {}
        self._summaries: list[dict[str, Any]] | None = None
        self._streams: dict[zmq.Socket[bytes], _Stream] = {}
        waiting = QUEUED_FRAMES * len(FRAME_KINDS) * len(characters) + QUEUED_OTHERS
        try:
            for endpoint in endpoints:
                self._open(context.socket(zmq.XPUB), endpoint, waiting)
        except zmq.ZMQError:
            self.close()
            raise
        self.announce(characters)

    def _open(self, socket: zmq.Socket[bytes], endpoint: Endpoint, waiting: int) -> None:
        self._streams[socket] = _Stream()
        for option, value in (
            (zmq.XPUB_VERBOSER, 1),
            (zmq.SNDHWM, waiting),
            (zmq.SNDBUF, SEND_BUFFER_BYTES),
            (zmq.LINGER, 0),
        ):
            socket.setsockopt(option, value)
        endpoint.prepare(socket)
        socket.bind(endpoint.stream)

    @property
    def sockets(self) -> list[zmq.Socket[bytes]]:
        """One socket per endpoint, in their order."""
        return list(self._streams)

    @property
    def endpoints(self) -> list[str]:
        """Addresses that clients connect to, with their actual ports."""
        return [bytes(socket.getsockopt(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode() for socket in self._streams]

    @property
    def ignored(self) -> int:
        """Number of subscriptions so far that no topic can match."""
        return sum(stream.subscriptions.ignored for stream in self._streams.values())

    @property
    def statistics(self) -> OutputStatus:
        """Messages and bytes so far; libzmq does not tell what it drops for slow clients."""
        return OutputStatus("zeromq", " ".join(self.endpoints), self._messages, self._bytes, None, 0)

    def announce(self, characters: Sequence[StreamedCharacter]) -> None:
        """Replace the characters; scenes with another revision go to the clients that have subscribed to them."""
        before, self._characters = self._characters, {each.name: each for each in characters}
        for name in before.keys() - self._characters.keys():
            self._kept.pop(topic(name, Kind.PERFORMER), None)
            self._performers.pop(name, None)
        now = self._clock()
        for name, character in self._characters.items():
            scene = topic(name, Kind.SCENE)
            if name not in before or before[name].revision != character.revision:
                for stream in self._streams.values():
                    if stream.subscriptions.wants(scene):
                        stream.answers.ask(scene, now)
        summaries = [_summary(each) for each in characters]
        if summaries != self._summaries:
            self._summaries = summaries
            self._publish_json("service/characters", summaries)
        self.send_due()

    def offer(self, frame: Frame) -> None:
        """Send a frame in all the kinds that clients subscribe to, and the performer if it has changed."""
        name, performer = frame.character.name, (frame.state, frame.user)
        now = time.monotonic_ns()
        if self._performers.get(name) != performer:
            self._performers[name] = performer
            value = {"character": name, "state": frame.state, "user": frame.user, "time": frame.time}
            payload, place = write_json(value), topic(name, Kind.PERFORMER)
            self._keep(place, join(place, header(Kind.PERFORMER, len(payload), frame, now), payload))
        encoded: dict[Kind, bytes | None] = {}
        for socket, stream in self._streams.items():
            for kind in stream.kinds_of(name):
                if kind not in encoded:
                    encoded[kind] = encode(kind, frame, now)
                message = encoded[kind]
                if message is not None:
                    self._send(socket, message)

    def report(self, status: Status) -> None:
        """Send the status under ``service/status``."""
        self._publish_json("service/status", status.as_json())

    def _publish_json(self, name: str, value: Any) -> None:
        """Send a value that concerns the whole service, and keep it for clients that subscribe later."""
        place, payload, kind = topic_field(name), write_json(value), WORDS[name.removeprefix("service/")]
        self._keep(place, join(place, Header(kind, len(payload), published=time.monotonic_ns()), payload))

    def _keep(self, place: bytes, message: bytes) -> None:
        self._kept[place] = message
        for socket, stream in self._streams.items():
            if stream.subscriptions.wants(place):
                self._send(socket, message)

    def handle(self, socket: zmq.Socket[bytes]) -> None:
        """Read subscriptions, up to `REQUESTS_PER_TURN`, and answer those that ask for something."""
        stream = self._streams[socket]
        for _ in range(REQUESTS_PER_TURN):
            try:
                request = socket.recv(zmq.NOBLOCK, copy=False)
            except zmq.Again:
                break
            self._take(stream, request.bytes, _connection(request))
        self.send_due()

    def _take(self, stream: _Stream, request: bytes, connection: int | None) -> None:
        prefix = request[1:]
        if request[:1] == b"\x01" and connection is not None:
            private = self._private_scene(prefix)
            if private is None:
                stream.subscriptions.add(prefix, connection, self._places())
            asked = [private] if private else [place for place in self._answerable() if place.startswith(prefix)]
            for place in asked:
                stream.answers.ask(place, self._clock())
        elif request[:1] == b"\x00":
            stream.subscriptions.remove(prefix, connection)
        stream.kinds.clear()

    def _private_scene(self, prefix: bytes) -> bytes | None:
        """Return the topic field of a scene that one client requests under a topic of its own."""
        text = prefix.decode("latin-1").removesuffix("\0")
        name, scene, own = (*text.split("/", 2), "", "")[:3]
        return topic_field(text) if scene == "scene" and own and name in self._characters and is_topic(text) else None

    def _places(self) -> Iterator[bytes]:
        """List the topic fields of everything that is streamed."""
        for name in self._characters:
            yield from (topic(name, kind) for kind in (Kind.SCENE, Kind.PERFORMER, *FRAME_KINDS))
        yield topic_field("service/status")
        yield topic_field("service/characters")

    def _answerable(self) -> Iterator[bytes]:
        yield from (topic(name, Kind.SCENE) for name in self._characters)
        yield from self._kept

    def _answer(self, place: bytes) -> bytes | None:
        """Return the message of a topic; None if its character has been removed."""
        if place in self._kept:
            return self._kept[place]
        character = self._characters.get(place.decode("ascii").partition("/")[0])
        if character is None:
            return None
        scene = Header(Kind.SCENE, len(character.scene), character.revision, published=time.monotonic_ns())
        return join(place, scene, character.scene)

    def forget(self, socket: zmq.Socket[bytes], connection: int) -> None:
        """Forget a client that has disconnected: the next one may have the same number."""
        if socket in self._streams:
            self._streams[socket].subscriptions.forget(connection)

    def due(self) -> float:
        """Return when the next answer is due, in seconds of the clock; infinity for never."""
        return min((stream.answers.due() for stream in self._streams.values()), default=float("inf"))

    def send_due(self) -> None:
        """Answer the subscriptions whose time has come."""
        for socket, stream in self._streams.items():
            while (place := stream.answers.take(self._clock())) is not None:
                message = self._answer(place)
                if message is not None:
                    self._send(socket, message)
                    stream.answers.given(place, len(message), self._clock())

    def close(self) -> None:
        """Close all sockets; closing again does nothing."""
        for socket in self._streams:
            socket.close(0)
        self._streams.clear()

    def _send(self, socket: zmq.Socket[bytes], message: bytes) -> None:
        socket.send(message, zmq.NOBLOCK)
        self._messages += 1
        self._bytes += len(message)


def _summary(character: StreamedCharacter) -> dict[str, Any]:
    kinds = [kind.word for kind in FRAME_KINDS if kind is not Kind.MORPHS or character.basis is not None]
    return {
        "name": character.name,
        "revision": character.revision,
        "vertices": len(character.rest),
        "kinds": kinds,
    }


def _connection(request: zmq.Frame) -> int | None:
    """Return the number of the connection that a subscription came from; None if the connection has ended."""
    try:
        return int(request.get(zmq.SRCFD))
    except zmq.ZMQError:
        return None
