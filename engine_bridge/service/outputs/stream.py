"""Subscriptions and messages, which all wires with subscribers share (docs/protocol.md).

Only messages with a subscriber are computed, and once for all wires.
"""

from abc import abstractmethod
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from engine_bridge.service.monitoring.status import Status
from engine_bridge.service.outputs.output import Output
from engine_bridge.service.outputs.subscriptions import Answers, Subscriptions
from engine_bridge.service.protocol.frame import Frame
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
from engine_bridge.service.protocol.payloads import header, message
from engine_bridge.service.protocol.scene import StreamedCharacter
from puppetline import clock

Peer = TypeVar("Peer", bound=Hashable)
"""What messages are sent to: a ZeroMQ socket with all its clients, or one client."""


@dataclass
class Stream:
    """The subscriptions of a peer and the answers that are due to it.

    `kinds` has the kinds of frames that it subscribes to, by character; it is cleared when subscriptions change.
    """

    subscriptions: Subscriptions = field(default_factory=Subscriptions)
    answers: Answers = field(default_factory=Answers)
    kinds: dict[str, list[Kind]] = field(default_factory=dict)

    def kinds_of(self, name: str) -> list[Kind]:
        """Return the kinds of frames of a character that the peer subscribes to."""
        if name not in self.kinds:
            self.kinds[name] = [kind for kind in FRAME_KINDS if self.subscriptions.wants(topic(name, kind))]
        return self.kinds[name]


class StreamOutput(Output, Generic[Peer]):
    """Sends characters to the peers that subscribe to them."""

    def __init__(self) -> None:
        self._characters: dict[str, StreamedCharacter] = {}
        self._kept: dict[bytes, bytes] = {}
        self._performers: dict[str, tuple[str, int | None]] = {}
        self._summaries: list[dict[str, Any]] | None = None
        self._streams: dict[Peer, Stream] = {}

    @abstractmethod
    def _send(self, peer: Peer, *parts: bytes) -> None:
        """Send a message, which is the parts one after the other, without waiting."""

    def announce(self, characters: Sequence[StreamedCharacter]) -> None:
        """Replace the characters; send scenes with another revision to the clients that subscribe to them."""
        before, self._characters = self._characters, {each.name: each for each in characters}
        for name in before.keys() - self._characters.keys():
            self._kept.pop(topic(name, Kind.PERFORMER), None)
            self._performers.pop(name, None)
        now = clock.now()
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
        """Send a frame in all kinds that peers subscribe to, and the performer if the state or the user has changed."""
        name, performer = frame.character.name, (frame.state, frame.user)
        if self._performers.get(name) != performer:
            self._performers[name] = performer
            value = {"character": name, "state": frame.state, "user": frame.user, "time": frame.time}
            payload, place = write_json(value), topic(name, Kind.PERFORMER)
            self._keep(place, join(place, header(Kind.PERFORMER, len(payload), frame, clock.now_ns()), payload))
        for peer, stream in self._streams.items():
            for kind in stream.kinds_of(name):
                whole = message(kind, frame)
                if whole is not None:
                    self._send(peer, whole)

    def report(self, status: Status) -> None:
        """Send the status under ``service/status``."""
        self._publish_json("service/status", status.as_json())

    def due(self) -> float:
        """Return when the next answer is due, in seconds of `puppetline.clock`; infinity for never."""
        return min((stream.answers.due() for stream in self._streams.values()), default=float("inf"))

    def send_due(self) -> None:
        """Answer the subscriptions whose time has come."""
        for peer, stream in self._streams.items():
            while (place := stream.answers.take(clock.now())) is not None:
                parts = self._answer(place)
                if parts:
                    self._send(peer, *parts)
                    stream.answers.given(place, sum(map(len, parts)), clock.now())

    def _subscribe(self, stream: Stream, prefix: bytes, connection: int) -> None:
        """Add a subscription of a connection, and request what it asks for."""
        private = self._private_scene(prefix)
        if private is None:
            stream.subscriptions.add(prefix, connection, self._places())
        asked = [private] if private else [place for place in self._answerable() if place.startswith(prefix)]
        for place in asked:
            stream.answers.ask(place, clock.now())
        stream.kinds.clear()

    def _unsubscribe(self, stream: Stream, prefix: bytes, connection: int | None) -> None:
        stream.subscriptions.remove(prefix, connection)
        stream.kinds.clear()

    def _publish_json(self, name: str, value: Any) -> None:
        """Send a value about the whole service, and keep it for clients that subscribe later."""
        place, payload, kind = topic_field(name), write_json(value), WORDS[name.removeprefix("service/")]
        self._keep(place, join(place, Header(kind=kind, length=len(payload), published=clock.now_ns()), payload))

    def _keep(self, place: bytes, message: bytes) -> None:
        self._kept[place] = message
        for peer, stream in self._streams.items():
            if stream.subscriptions.wants(place):
                self._send(peer, message)

    def _private_scene(self, prefix: bytes) -> bytes | None:
        """Return the topic field if a subscription requests a scene under a client's own topic, else None."""
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

    def _answer(self, place: bytes) -> tuple[bytes, ...]:
        """Return the parts of a topic's message; none if its character has been removed."""
        if place in self._kept:
            return (self._kept[place],)
        character = self._characters.get(place.decode("ascii").partition("/")[0])
        if character is None:
            return ()
        scene = Header(
            kind=Kind.SCENE, length=len(character.scene), revision=character.revision, published=clock.now_ns()
        )
        return join(place, scene), character.scene


def _summary(character: StreamedCharacter) -> dict[str, Any]:
    missing = {Kind.MORPHS: character.basis is None, Kind.BONES: character.skeleton is None}
    kinds = [kind.word for kind in FRAME_KINDS if not missing.get(kind, False)]
    return {
        "name": character.name,
        "revision": character.revision,
        "digest": character.digest,
        "vertices": len(character.rest),
        "kinds": kinds,
    }
