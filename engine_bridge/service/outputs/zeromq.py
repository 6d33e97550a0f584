"""Frames out over ZeroMQ: whoever subscribes is served, and what nobody wants is not even computed.

Nothing here waits: a client that does not read loses messages and costs no one else anything (docs/protocol.md).
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import zmq

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

FRAMES_WAITING = 2
"""Whole frames of all kinds that may wait for a client that is slow; what comes then is dropped for it."""

OTHERS_WAITING = 8
"""And beside them so many scenes and the like."""

SEND_BUFFER = 128 * 1024
"""Bytes that the system holds for a client; what waits there is old when it arrives."""

AT_A_TIME = 256
"""Subscriptions that are read before frames have their turn again."""


class Door(Protocol):
    """Where clients come in."""

    @property
    def stream(self) -> str:
        """Endpoint: ``tcp://127.0.0.1:7400``."""

    def prepare(self, socket: zmq.Socket[bytes]) -> None:
        """Set what limits who may come in and with what, before the socket is bound."""


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


class Publisher:
    """Sends characters to whoever wants them.

    Parameters
    ----------
    context : zmq.Context
    doors : sequence of Door
    characters : sequence of StreamedCharacter
        Who will be streamed; see `announce`.
    clock : callable
        Seconds that never go back.

    Attributes
    ----------
    messages, bytes : int
        Sent so far, each once however many clients it went to.

    Raises
    ------
    zmq.ZMQError
        An endpoint that cannot be bound.
    """

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        doors: Sequence[Door],
        characters: Sequence[StreamedCharacter],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.messages = self.bytes = 0
        self._clock = clock
        self._characters: dict[str, StreamedCharacter] = {}
        self._kept: dict[bytes, bytes] = {}
        self._performers: dict[str, tuple[str, int | None]] = {}
        self._streams: dict[zmq.Socket[bytes], _Stream] = {}
        waiting = FRAMES_WAITING * len(FRAME_KINDS) * len(characters) + OTHERS_WAITING
        try:
            for door in doors:
                self._open(context.socket(zmq.XPUB), door, waiting)
        except zmq.ZMQError:
            self.close()
            raise
        self.announce(characters)

    def _open(self, socket: zmq.Socket[bytes], door: Door, waiting: int) -> None:
        self._streams[socket] = _Stream()
        for option, value in (
            (zmq.XPUB_VERBOSER, 1),
            (zmq.SNDHWM, waiting),
            (zmq.SNDBUF, SEND_BUFFER),
            (zmq.LINGER, 0),
        ):
            socket.setsockopt(option, value)
        door.prepare(socket)
        socket.bind(door.stream)

    @property
    def sockets(self) -> list[zmq.Socket[bytes]]:
        """What to poll for reading: one socket a door, in their order."""
        return list(self._streams)

    @property
    def endpoints(self) -> list[str]:
        """Where clients connect to, in the order of the doors."""
        return [bytes(socket.getsockopt(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode() for socket in self._streams]

    @property
    def ignored(self) -> int:
        """Subscriptions so far that no topic can match."""
        return sum(stream.subscriptions.ignored for stream in self._streams.values())

    def announce(self, characters: Sequence[StreamedCharacter]) -> None:
        """Take over who is streamed from now on; scenes that are new go to whoever has subscribed to them.

        Parameters
        ----------
        characters : sequence of StreamedCharacter
            One whose scene has changed has another revision than before.
        """
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
        self.publish_json("service/characters", [_summary(each) for each in characters])
        self.send_due()

    def redescribe(self, character: StreamedCharacter) -> None:
        """Tell something else of a character, whose scene is the same, to whoever asks from now on."""
        self._characters[character.name] = character

    def publish(self, frame: Frame) -> None:
        """Send a frame in all the kinds that somebody wants, and who performs where that has changed."""
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

    def publish_json(self, name: str, value: Any) -> None:
        """Send what concerns the whole service, and keep it for whoever subscribes later.

        Parameters
        ----------
        name : str
            ``service/status`` or ``service/characters``.
        value : JSON
        """
        place, payload, kind = topic_field(name), write_json(value), WORDS[name.removeprefix("service/")]
        self._keep(place, join(place, Header(kind, len(payload), published=time.monotonic_ns()), payload))

    def _keep(self, place: bytes, message: bytes) -> None:
        self._kept[place] = message
        for socket, stream in self._streams.items():
            if stream.subscriptions.wants(place):
                self._send(socket, message)

    def handle(self, socket: zmq.Socket[bytes]) -> None:
        """Take subscriptions that have come in, so many at a time, and answer those that ask for something."""
        stream = self._streams[socket]
        for _ in range(AT_A_TIME):
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
        """Return the topic field of a scene that one client asks for under a topic of its own."""
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
        """Return what is to be sent under a topic; None where it is about a character that has gone."""
        if place in self._kept:
            return self._kept[place]
        character = self._characters.get(place.decode("ascii").partition("/")[0])
        if character is None:
            return None
        scene = Header(Kind.SCENE, len(character.scene), character.revision, published=time.monotonic_ns())
        return join(place, scene, character.scene)

    def forget(self, socket: zmq.Socket[bytes], connection: int) -> None:
        """Take note that a client has gone: the next one may have the same number."""
        if socket in self._streams:
            self._streams[socket].subscriptions.forget(connection)

    def due(self) -> float:
        """Return when `send_due` wants to be called: seconds of the clock, infinity for never."""
        return min((stream.answers.due() for stream in self._streams.values()), default=float("inf"))

    def send_due(self) -> None:
        """Answer those who have subscribed, as far as it is their turn."""
        for socket, stream in self._streams.items():
            while (place := stream.answers.take(self._clock())) is not None:
                message = self._answer(place)
                if message is not None:
                    self._send(socket, message)
                    stream.answers.given(place, len(message), self._clock())

    def close(self) -> None:
        """Close all doors; closing again does nothing."""
        for socket in self._streams:
            socket.close(0)
        self._streams.clear()

    def _send(self, socket: zmq.Socket[bytes], message: bytes) -> None:
        socket.send(message, zmq.NOBLOCK)
        self.messages += 1
        self.bytes += len(message)


def _summary(character: StreamedCharacter) -> dict[str, Any]:
    kinds = [kind.word for kind in FRAME_KINDS if kind is not Kind.MORPHS or character.basis is not None]
    return {
        "name": character.name,
        "revision": character.revision,
        "vertices": len(character.rest),
        "kinds": kinds,
    }


def _connection(request: zmq.Frame) -> int | None:
    """Return the number of the connection that a subscription came by; None where the connection has ended."""
    try:
        return int(request.get(zmq.SRCFD))
    except zmq.ZMQError:
        return None
