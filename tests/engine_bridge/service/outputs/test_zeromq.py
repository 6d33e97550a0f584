import contextlib
import socket
import struct
import time
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
import zmq

from engine_bridge.service.outputs.subscriptions import MAX_SUBSCRIPTIONS
from engine_bridge.service.outputs.zeromq import REQUESTS_PER_TURN, ZeroMqOutput
from engine_bridge.service.protocol.header import FRAME_KINDS, Kind, subscription
from engine_bridge.service.protocol.payloads import decode
from engine_bridge.service.protocol.scene import StreamedCharacter

from .frames import Open, frame_of

SECONDS = 20
"""After which what a test waits for has not come."""

COMPUTED = {"controls", "vertices_and_normals", "morphs"}


@pytest.fixture(scope="module")
def cat(blob_rig):
    return StreamedCharacter("cat", blob_rig, 1)


@pytest.fixture
def open_publisher(context, until_end):
    def open_one(*characters, doors=None):
        return until_end(ZeroMqOutput(context, doors or [Open()], characters))

    return open_one


@pytest.fixture
def publisher(open_publisher, dog, cat):
    return open_publisher(dog, cat)


@pytest.fixture
def subscribe(context):
    def make(publisher, *topics, door=0):
        client = context.socket(zmq.SUB)
        client.rcvhwm = 0
        client.connect(publisher.endpoints[door])
        for text in topics:
            client.subscribe(subscription(text) if isinstance(text, str) else text)
        return client

    return make


READY = b"\x05READY\x0bSocket-Type\0\0\0\x03SUB"
HANDSHAKE = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32) + bytes([4, len(READY)]) + READY


def framed(*bodies):
    """Return ZMTP's frames of messages."""
    return b"".join(b"\2" + struct.pack(">Q", len(body)) + body for body in bodies)


@pytest.fixture
def raw():
    """Connect a subscriber that is written by hand, and return its socket."""
    with contextlib.ExitStack() as stack:

        def connect(publisher):
            port = int(publisher.endpoints[0].rpartition(":")[2])
            client = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            client.sendall(HANDSHAKE)
            client.recv(64, socket.MSG_WAITALL)
            return client

        yield connect


def serve(publisher, until):
    """Run the publisher as the service does until something is true."""
    end = time.monotonic() + SECONDS
    while not until():
        assert time.monotonic() < end, "it has not come"
        for each in publisher.sockets:
            if each.poll(2):
                publisher.handle(each)
        publisher.send_due()


def heard(publisher, client):
    """Run the publisher until the client has a message."""
    serve(publisher, lambda: client.poll(0))
    return decode(client.recv())


def received_digest(publisher, client):
    """Run the publisher until the client has a scene, and compute its digest as docs/protocol.md says."""
    serve(publisher, lambda: client.poll(0))
    payload = client.recv()[128:]
    arrays_start = 4 + int.from_bytes(payload[:4], "little")
    return sha256(payload[:arrays_start] + sha256(payload[arrays_start:]).digest()).hexdigest()


def wanted(publisher, name, *kinds, door=0):
    """Run the publisher until just these kinds of a character's frames are wanted at a door."""
    stream = list(publisher._streams.values())[door]
    serve(publisher, lambda: set(stream.kinds_of(name)) == set(kinds))


def test_a_scene_under_a_topic_of_its_own_goes_to_one_client_alone(publisher, subscribe):
    other = subscribe(publisher, "dog/scene", "dog/scene/other")
    first, second = heard(publisher, other), heard(publisher, other)
    assert {first.topic, second.topic} == {"dog/scene", "dog/scene/other"}
    received = heard(publisher, subscribe(publisher, "dog/scene/mine"))
    assert received.topic == "dog/scene/mine"
    assert received.body.facts["character"] == "dog"
    assert not other.poll(100)


def test_the_same_scene_can_be_asked_for_again(publisher, subscribe):
    client = subscribe(publisher, "dog/scene/mine")
    heard(publisher, client)
    client.unsubscribe(subscription("dog/scene/mine"))
    client.subscribe(subscription("dog/scene/mine"))
    assert heard(publisher, client).topic == "dog/scene/mine"


def test_the_performer_is_sent_on_each_change_and_to_late_subscribers(publisher, subscribe, dog):
    early = subscribe(publisher, "dog/performer")
    serve(publisher, lambda: publisher._streams[publisher.sockets[0]].subscriptions._held)
    for sequence, (state, user) in enumerate([("waiting", None), ("waiting", None), ("calibrating", 3)]):
        publisher.offer(frame_of(dog, sequence, state=state, user=user))
    told = [heard(publisher, early) for _ in range(2)]
    assert [(each.body["state"], each.body["user"]) for each in told] == [("waiting", None), ("calibrating", 3)]
    assert [each.header.sequence for each in told] == [0, 2]
    late = heard(publisher, subscribe(publisher, "dog/performer"))
    assert late.body == {"character": "dog", "state": "calibrating", "user": 3, "time": 2 / 30}


def test_the_service_says_whom_it_streams_and_how_it_is(publisher, subscribe, dog, status, silent):
    client = subscribe(publisher, "service/characters")
    assert heard(publisher, client).body == [
        {
            "name": name,
            "revision": 1,
            "digest": received_digest(publisher, subscribe(publisher, f"{name}/scene/mine")),
            "vertices": len(dog.rest),
            "kinds": ["controls", "vertices", "vertices16", "joints", "handles", "channels"],
        }
        for name in ("dog", "cat")
    ]
    publisher.report(status)
    publisher.report(silent)
    assert heard(publisher, subscribe(publisher, "service/status")).body == silent.as_json()


def test_a_payload_without_a_subscriber_is_never_computed(publisher, subscribe, dog):
    frame = frame_of(dog)
    publisher.offer(frame)
    assert not COMPUTED & set(vars(frame))
    client, leaving = subscribe(publisher, "dog/controls", "dog/vertices"), subscribe(publisher, "dog/vertices16")
    wanted(publisher, "dog", Kind.CONTROLS, Kind.VERTICES, Kind.VERTICES16)
    client.unsubscribe(subscription("dog/vertices"))
    leaving.close(0)
    wanted(publisher, "dog", Kind.CONTROLS)
    frame = frame_of(dog)
    publisher.offer(frame)
    assert COMPUTED & set(vars(frame)) == {"controls"}
    client.close(0)
    wanted(publisher, "dog")
    frame = frame_of(dog)
    before = publisher.statistics.sent
    publisher.offer(frame)
    assert not COMPUTED & set(vars(frame))
    assert publisher.statistics.sent == before


def test_a_subscription_without_the_zero_stands_for_everything_that_begins_so(publisher, subscribe, dog, cat):
    everything = subscribe(publisher, b"")
    topics = {heard(publisher, everything).topic for _ in range(3)}
    assert topics == {"dog/scene", "cat/scene", "service/characters"}
    wanted(publisher, "dog", *FRAME_KINDS)
    publisher.offer(frame_of(dog))
    assert [heard(publisher, everything).topic for _ in range(5)] == [
        f"dog/{kind}" for kind in ("performer", "controls", "vertices", "vertices16", "handles")
    ]


def test_two_doors_serve_their_own_clients_and_compute_once(open_publisher, subscribe, dog, monkeypatch):
    publisher = open_publisher(dog, doors=[Open(), Open()])
    first, second = subscribe(publisher, "dog/vertices"), subscribe(publisher, "dog/vertices", "dog/joints", door=1)
    wanted(publisher, "dog", Kind.VERTICES)
    wanted(publisher, "dog", Kind.VERTICES, Kind.JOINTS, door=1)
    made = []
    evaluate = type(dog.binding).vertices_and_normals
    monkeypatch.setattr(type(dog.binding), "vertices_and_normals", lambda *args: made.append(1) or evaluate(*args))
    publisher.offer(frame_of(dog, joints=np.zeros((20, 3)), confidence=np.ones(20, dtype=np.float32)))
    assert heard(publisher, first).topic == "dog/vertices"
    assert [heard(publisher, second).topic for _ in range(2)] == ["dog/vertices", "dog/joints"]
    assert made == [1]
    assert not first.poll(50)


def test_a_topic_is_answered_once_a_second_and_nobody_is_forgotten(open_publisher, subscribe, dog, given_clock):
    publisher = open_publisher(dog)
    first = subscribe(publisher, "service/characters")
    heard(publisher, first)
    later = [subscribe(publisher, "service/characters") for _ in range(3)]
    serve(publisher, lambda: publisher.due() < float("inf"))
    assert publisher.due() == pytest.approx(given_clock.now() + 1)
    stream = publisher._streams[publisher.sockets[0]]
    serve(publisher, lambda: stream.subscriptions._held[subscription("service/characters")] == 4)
    assert not any(client.poll(20) for client in later)
    given_clock.advance(1)
    for client in later:
        assert heard(publisher, client).topic == "service/characters"
    assert publisher.due() == float("inf")


def test_after_a_reload_new_scenes_go_to_whoever_subscribed_to_them(publisher, subscribe, dog, cat, clock):
    client = subscribe(publisher, "dog/scene", "cat/scene", "cow/scene")
    assert {heard(publisher, client).topic for _ in range(2)} == {"dog/scene", "cat/scene"}
    clock.advance(1)  # a topic is answered once a second
    cow = replace(cat, name="cow")
    publisher.announce([replace(dog, revision=2), cow])
    got = [heard(publisher, client) for _ in range(2)]
    assert [(each.topic, each.header.revision) for each in got] == [("dog/scene", 2), ("cow/scene", 1)]
    assert got[0].body.facts["revision"] == 2
    listed = heard(publisher, subscribe(publisher, "service/characters")).body
    assert [(each["name"], each["revision"]) for each in listed] == [("dog", 2), ("cow", 1)]


def test_messages_about_a_removed_character_are_forgotten(publisher, subscribe, dog, cat):
    publisher.offer(frame_of(cat))
    publisher.announce([dog])
    client = subscribe(publisher, "cat/performer", "cat/scene", "dog/scene")
    assert heard(publisher, client).topic == "dog/scene"
    assert not client.poll(100)


def test_a_client_that_never_reads_costs_nobody_else_a_message(publisher, subscribe, raw, dog):
    asleep = raw(publisher)
    asleep.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    asleep.sendall(framed(b"\1" + subscription("dog/vertices")))
    client = subscribe(publisher, "dog/vertices")
    stream = publisher._streams[publisher.sockets[0]]
    serve(publisher, lambda: stream.subscriptions._held[subscription("dog/vertices")] == 2)
    got = []
    for sequence in range(1000):  # 35 MB, which is more than anything on the way can hold
        publisher.offer(frame_of(dog, sequence))
        assert client.poll(1000 * SECONDS)
        got.append(decode(client.recv()).header.sequence)
    assert got == list(range(1000))


def test_a_client_that_wakes_up_finds_few_old_frames_and_then_the_newest(publisher, subscribe, context, dog):
    client = subscribe(publisher)
    client.close(0)
    client = context.socket(zmq.SUB)
    client.rcvhwm, client.rcvbuf = 1, 4096
    client.connect(publisher.endpoints[0])
    client.subscribe(subscription("dog/vertices"))
    wanted(publisher, "dog", Kind.VERTICES)
    for sequence in range(500):
        publisher.offer(frame_of(dog, sequence))
    got = []
    while client.poll(200):
        got.append(decode(client.recv()).header.sequence)
    assert got == list(range(len(got)))  # what was on its way, in order; the rest was dropped, not queued
    assert len(got) < 100
    sequence = 499
    while not client.poll(10):  # until there is room for one on the way
        sequence += 1
        publisher.offer(frame_of(dog, sequence))
    assert 500 <= decode(client.recv()).header.sequence <= sequence


def ignored(publisher):
    return sum(stream.subscriptions.ignored for stream in publisher._streams.values())


def test_garbage_subscriptions_are_survived_in_bounded_memory(publisher, subscribe, raw, dog):
    client = raw(publisher)
    junk = [b"", b"\1" + b"\xff" * 200, b"\1" + b"x" * 500, b"\0never", b"\2user message", b"\1dog/scene/" + b"y" * 60]
    client.setblocking(False)
    waiting = memoryview(framed(*junk, *(b"\1n%d/controls" % number for number in range(30_000))))
    while waiting:
        with contextlib.suppress(BlockingIOError):
            waiting = waiting[client.send(waiting[:65536]) :]
        publisher.handle(publisher.sockets[0])
    stream = publisher._streams[publisher.sockets[0]]
    serve(publisher, lambda: ignored(publisher) >= 30_000 - MAX_SUBSCRIPTIONS)
    assert len(stream.subscriptions._held) <= MAX_SUBSCRIPTIONS
    assert heard(publisher, subscribe(publisher, "dog/scene")).topic == "dog/scene"


def test_a_turn_takes_only_so_many_subscriptions(publisher, raw):
    client = raw(publisher)
    client.sendall(framed(b"\1a b") * (3 * REQUESTS_PER_TURN))
    first = publisher.sockets[0]
    while (before := ignored(publisher)) < 3 * REQUESTS_PER_TURN:
        assert first.poll(1000 * SECONDS)
        publisher.handle(first)
        assert ignored(publisher) <= before + REQUESTS_PER_TURN


def test_a_client_cannot_end_another_clients_subscription(publisher, subscribe, raw, dog):
    client = subscribe(publisher, "dog/controls")
    wanted(publisher, "dog", Kind.CONTROLS)
    rude = raw(publisher)
    rude.sendall(framed(b"\0" + subscription("dog/controls"), b"\1" + subscription("dog/handles")))
    wanted(publisher, "dog", Kind.CONTROLS, Kind.HANDLES)
    publisher.offer(frame_of(dog))
    assert heard(publisher, client).topic == "dog/controls"


def test_a_port_that_is_taken_is_said_and_nothing_stays_open(open_publisher, context, dog):
    taken = open_publisher(dog).endpoints[0]
    with pytest.raises(zmq.ZMQError) as error:
        ZeroMqOutput(context, [Open(), Open(taken)], [dog])
    assert error.value.errno == zmq.EADDRINUSE
