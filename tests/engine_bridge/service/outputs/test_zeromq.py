"""A whole service and its clients over ZeroMQ."""

import itertools
import socket
import struct
from contextlib import closing, suppress
from hashlib import sha256

import numpy as np
import pytest
import zmq

from engine_bridge.service.outputs import zeromq
from engine_bridge.service.outputs.subscriptions import MAX_SUBSCRIPTIONS
from engine_bridge.service.outputs.zeromq import REQUESTS_PER_TURN
from engine_bridge.service.protocol.header import Kind, subscription
from engine_bridge.service.protocol.payloads import decode
from puppetline.errors import ServiceError

from ...refusals import refused


def computed(frame):
    """The payloads of a frame that have been computed."""
    return {"controls", "vertices_and_normals", "morphs"} & {*vars(frame), *vars(frame.pose)}


@pytest.fixture
def service(play_file):
    """Play a service with a character that nobody moves; `out` is its stream."""
    made = play_file()
    made.out = made.service._outputs[0]
    return made


READY = b"\x05READY\x0bSocket-Type\0\0\0\x03SUB"
HANDSHAKE = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32) + bytes([4, len(READY)]) + READY


@pytest.fixture
def raw(service):
    """A subscriber that is written by hand, and does not wait, after its handshake."""
    host, _, port = service.service.stream[0].removeprefix("tcp://").rpartition(":")
    with closing(socket.create_connection((host, int(port)))) as client:
        client.sendall(HANDSHAKE)
        client.setblocking(False)
        said = bytearray()

        def is_ready():
            with suppress(BlockingIOError):
                said.extend(client.recv(1000))
            return b"READY" in said

        service.wait(is_ready)
        yield client


def framed(*bodies):
    """Return ZMTP's frames of messages."""
    return b"".join(b"\2" + struct.pack(">Q", len(body)) + body for body in bodies)


def topics(messages):
    return [message.topic for message in messages]


def test_a_scene_under_a_topic_of_its_own_goes_to_one_client_alone_whenever_it_asks(service):
    other = service.client("dog/scene", "dog/scene/other")
    service.heard(other)
    service.run(0.1)  # an answer takes its time
    assert topics(service.heard(other)) == ["dog/scene/other"]
    service.run(0.1)
    mine = service.client("dog/scene/mine")
    [scene] = service.heard(mine)
    assert scene.topic == "dog/scene/mine"
    assert scene.body.facts["character"] == "dog"
    service.run(1.1)
    for ask in (mine.socket.unsubscribe, mine.socket.subscribe):
        ask(subscription("dog/scene/mine"))
    service.heard(mine)
    assert not other.pending()


def test_the_performer_is_sent_on_each_change_and_to_late_subscribers(play, blob_puppet):
    service = play("--puppet", blob_puppet, "--source", "demo:walk?loop", "--calibrate", "at_once")
    early = service.client("blob/performer")
    service.run(3.0)
    shown = [next(same) for _, same in itertools.groupby(service.frames, lambda frame: (frame.state, frame.user))]
    assert len(shown) > 1
    told = service.heard(early, lambda message: message.header.sequence == shown[-1].sequence)
    for message, frame in zip(told, shown, strict=True):
        assert message.body == {"character": "blob", "state": frame.state, "user": frame.user, "time": frame.time}
        assert message.header.sequence == frame.sequence
    [late] = service.heard(service.client("blob/performer"))
    assert late.body == told[-1].body


def test_the_service_says_whom_it_streams_and_how_it_is(service):
    [listed] = service.heard(service.client("service/characters"))
    service.run(0.1)
    scene = service.client("dog/scene/mine")
    service.wait(lambda: scene.socket.poll(0))
    payload = scene.socket.recv()[128:]
    start = 4 + int.from_bytes(payload[:4], "little")
    dog = service.player("dog").character
    assert listed.body == [
        {
            "name": "dog",
            "revision": dog.revision,
            "digest": sha256(payload[:start] + sha256(payload[start:]).digest()).hexdigest(),
            "vertices": len(dog.rest),
            "kinds": ["controls", "vertices", "vertices16", "joints", "handles", "channels"],
        }
    ]
    service.run(2.0)
    [status] = service.heard(service.client("service/status"))
    assert status.body == service.shown[-1].as_json()


def test_a_payload_without_a_subscriber_is_never_computed(service):
    assert not computed(service.next_frame())
    client, leaving = service.client("dog/controls", "dog/vertices"), service.client("dog/vertices16")
    assert service.kinds() == {Kind.CONTROLS, Kind.VERTICES, Kind.VERTICES16}
    client.socket.unsubscribe(subscription("dog/vertices"))
    leaving.socket.close(0)
    service.wait(lambda: service.kinds() == {Kind.CONTROLS})
    assert computed(service.next_frame()) == {"controls"}
    client.socket.close(0)
    service.wait(lambda: service.kinds() == set())
    before = service.out.statistics.sent
    assert not computed(service.next_frame())
    assert service.out.statistics.sent == before


def test_a_topic_is_answered_once_a_second_and_nobody_is_forgotten(service):
    service.heard(service.client("service/characters"))
    later = [service.client("service/characters") for _ in range(3)]
    service.run(0.9)
    assert not any(client.pending() for client in later)
    service.run(0.2)
    for client in later:
        service.heard(client)


def test_a_client_that_does_not_read_costs_nobody_a_message_and_then_gets_the_newest(play_file, monkeypatch):
    monkeypatch.setattr(zeromq, "QUEUED_OTHERS", 8)  # as ever, for `play` has more
    service = play_file()
    asleep, [address] = service.client(), service.service.stream
    asleep.socket.rcvhwm, asleep.socket.rcvbuf = 1, 4096
    asleep.socket.disconnect(address)
    asleep.socket.connect(address)
    asleep.socket.subscribe(subscription("dog/vertices"))
    service.wait(lambda: service.kinds() == {Kind.VERTICES})
    client = service.client("dog/vertices")
    for _ in range(1000):  # 35 MB, which is more than anything on the way can hold
        frame = service.next_frame()
        [message] = service.heard(client)
        assert message.header.sequence == frame.sequence
    got = [0]
    while got[-1] <= frame.sequence:
        if asleep.socket.poll(10):
            got.append(decode(asleep.socket.recv()).header.sequence)
        else:  # until there is room for one on the way
            service.next_frame()
    while got[-1] < service.frames[-1].sequence:  # others had room, too
        got.append(decode(asleep.socket.recv()).header.sequence)
    old = [number for number in got[1:] if number <= frame.sequence]
    assert len(old) < 100
    assert (np.diff(old) == 1).all()  # what was on its way; the rest was dropped, not queued
    assert got[-1] == service.frames[-1].sequence


def test_garbage_subscriptions_are_survived_in_bounded_memory(service, raw):
    junk = [b"", b"\1" + b"\xff" * 200, b"\1" + b"x" * 500, b"\0never", b"\2user message", b"\1dog/scene/" + b"y" * 60]
    left, counts = memoryview(framed(*junk, *(b"\1n%d/controls" % number for number in range(30_000)))), []
    [stream] = service.out._streams.values()

    def all_taken():
        nonlocal left
        with suppress(BlockingIOError):
            left = left[raw.send(left[:65536]) :]
        counts.append(stream.subscriptions.ignored)
        return counts[-1] >= 30_000 - MAX_SUBSCRIPTIONS

    service.wait(all_taken)
    assert max(np.diff(counts)) <= REQUESTS_PER_TURN
    assert len(stream.subscriptions._held) <= MAX_SUBSCRIPTIONS
    assert topics(service.heard(service.client("dog/scene"))) == ["dog/scene"]


def test_a_client_cannot_end_another_clients_subscription(service, raw):
    client = service.client("dog/controls")
    raw.send(framed(b"\0" + subscription("dog/controls"), b"\1" + subscription("dog/handles")))
    service.wait(lambda: Kind.HANDLES in service.kinds())
    service.next_frame()
    assert topics(service.heard(client)) == ["dog/controls"]


def test_a_port_that_is_taken_is_said_and_nothing_stays_open(play, blob_puppet, context, free_port):
    other, port = context.socket(zmq.PUB), free_port()
    for taken in (port, port + 1):  # of the stream, of the control socket
        other.bind(f"tcp://127.0.0.1:{taken}")
        start = ("--puppet", blob_puppet, "--source", "osc:0", "--port", port)
        assert refused(ServiceError, play, *start).where == "[network]"
        other.unbind(f"tcp://127.0.0.1:{taken}")
    play(*start)
