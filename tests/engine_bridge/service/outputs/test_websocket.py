import asyncio
import json
import select
import socket
import threading
import time
from contextlib import suppress

import aiohttp
import numpy as np
import pytest

from engine_bridge.service.control.dispatcher import Dispatcher
from engine_bridge.service.control.requests import Nothing
from engine_bridge.service.outputs import websocket_server
from engine_bridge.service.outputs.output import Opening
from engine_bridge.service.outputs.websocket import WebSocketTable
from engine_bridge.service.protocol.header import FRAME_KINDS, Kind
from engine_bridge.service.protocol.payloads import decode, encode
from engine_bridge.service.security.endpoints import Endpoint
from puppetline.errors import ServiceError

from ....clock import GivenLoop
from ....waiting import wait_until
from .frames import frame_of

SECONDS = 30
"""After which what a test waits for has not come."""

NOTHING = object()
"""A first message that is not sent."""

TOKEN = "a-token-of-24-characters"

LIVE = [kind for kind in FRAME_KINDS if kind not in (Kind.MORPHS, Kind.BONES, Kind.CHANNELS)]


def tracked(character, sequence=0, **more):
    """Return a frame with joints and a root that rises."""
    joints, confidence = np.full((20, 3), 1.5), np.ones(20, dtype=np.float32)
    root = np.array([0.0, 0.1 * sequence, 0.0])
    return frame_of(character, sequence, root=root, joints=joints, confidence=confidence, **more)


class Office:
    """An output, and the loop that serves it in a thread; what `do` returns is computed in that thread."""

    def __init__(self, dog, token=None, **table):
        (self.network,) = [Endpoint("NULL" if token is None else "PLAIN", "", "", token=(token or "").encode())]
        self.dispatcher = Dispatcher({"ping": (Nothing, lambda _: "pong"), "long": (Nothing, lambda _: "x" * 60_000)})
        self.taken = 0
        opening = Opening([dog], None, [self.network], None, self._answer)
        self.output = WebSocketTable(port=0, **table).open(opening)
        (self.address,) = self.output.endpoints
        self.port = int(self.address.partition("127.0.0.1:")[2].partition("/")[0])
        self._calls = []
        self._open = True
        self._loop = threading.Thread(target=self._run)
        self._loop.start()

    def _answer(self, body, reply):
        self.taken += 1
        self.dispatcher.take(body, reply, "json")

    def _run(self):
        while self._open:
            (fd,) = self.output.sockets
            if select.select([fd], [], [], 0.005)[0]:
                self.output.handle(fd)
            self.output.send_due()
            while self._calls:
                call, done = self._calls.pop(0)
                done.append(call())

    def do(self, call):
        done = []
        self._calls.append((call, done))
        wait_until(lambda: done)
        return done[0]

    def offer(self, *frames):
        self.do(lambda: [self.output.offer(frame) for frame in frames])

    def kinds(self):
        return self.do(lambda: {kind for stream in self.output._streams.values() for kind in stream.kinds_of("dog")})

    @property
    def counts(self):
        return self.output.statistics

    def close(self):
        self._open = False
        self._loop.join()
        self.output.close()
        self.output.close()


@pytest.fixture
def open_office(dog, until_end):
    return lambda **more: until_end(Office(dog, **more))


@pytest.fixture
def timed(given_clock, monkeypatch):
    """Give the clock also to the loop that serves web pages."""
    monkeypatch.setattr(asyncio, "new_event_loop", GivenLoop)
    return given_clock


@pytest.fixture
def office(open_office):
    return open_office()


class Web:
    """A client that is used without waiting in each line: `Web.run` runs a coroutine with a connection."""

    def __init__(self, office, first=None, headers=None):
        self._loop = asyncio.SelectorEventLoop()
        self._session = self._run(self._opened())
        try:
            self.socket = self._run(self._session.ws_connect(office.address, max_msg_size=0, headers=headers))
        except aiohttp.ClientError:
            self.close()
            raise
        if first is not NOTHING:
            self.send({} if first is None else first)

    async def _opened(self):
        return aiohttp.ClientSession()

    def _run(self, coroutine):
        return self._loop.run_until_complete(asyncio.wait_for(coroutine, SECONDS))

    def send(self, value):
        self._run(self.socket.send_str(value if isinstance(value, str) else json.dumps(value)))

    def send_bytes(self, value):
        self._run(self.socket.send_bytes(value))

    def subscribe(self, *topics):
        for each in topics:
            self.send({"subscribe": each})

    def message(self):
        """Return what comes next: bytes, text, or the code with which the server has closed the connection."""
        message = self._run(self.socket.receive())
        return self.socket.close_code if message.type in ENDS else message.data

    def pending(self, seconds=0.2):
        """Return what comes within some time."""
        found = []
        with suppress(TimeoutError):
            while True:
                message = self._loop.run_until_complete(asyncio.wait_for(self.socket.receive(), seconds))
                if message.type in ENDS:
                    break
                found.append(message.data)
        return found

    def ask(self, value):
        self.send(value)
        while not isinstance(message := self.message(), str):
            assert isinstance(message, bytes), message
        return json.loads(message)

    def close(self):
        if not self._loop.is_closed():
            self._run(self._session.close())
            self._loop.close()


ENDS = (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.CLOSING, aiohttp.WSMsgType.ERROR)


@pytest.fixture
def connect(until_end):
    return lambda office, first=None, **more: until_end(Web(office, first, **more))


def test_messages_are_those_of_every_output(office, connect, dog):
    web = connect(office)
    web.subscribe(*(f"dog/{kind.word}" for kind in (*LIVE, Kind.PERFORMER)))
    wait_until(lambda: office.kinds() == set(LIVE))
    frame = tracked(dog, 3, state="performing", user=2)
    office.offer(frame)
    performer, *messages = [web.message() for _ in range(1 + len(LIVE))]
    assert messages == [
        encode(kind, frame, decode(each).header.published) for kind, each in zip(LIVE, messages, strict=True)
    ]
    assert decode(performer).body == {"character": "dog", "state": "performing", "user": 2, "time": frame.time}


def test_scene_and_characters_are_answered_at_once_and_again_when_requested_again(office, connect, dog):
    web = connect(office)
    web.subscribe("dog/scene/mine", "service/characters")
    scene, characters = decode(web.message()), decode(web.message())
    assert scene.topic == "dog/scene/mine"
    np.testing.assert_array_equal(scene.body.arrays["positions"], dog.rest.astype(np.float32))
    assert [each["name"] for each in characters.body] == ["dog"]
    web.subscribe("dog/scene/mine")
    assert decode(web.message()).topic == "dog/scene/mine"


def test_only_what_is_subscribed_to_is_computed_and_nothing_after_the_end_of_it(office, connect, dog):
    computed = {"controls", "vertices_and_normals"}
    web = connect(office)
    web.subscribe("dog/controls", "dog/vertices")
    wait_until(lambda: office.kinds() == {Kind.CONTROLS, Kind.VERTICES})
    web.send({"unsubscribe": "dog/vertices"})
    wait_until(lambda: office.kinds() == {Kind.CONTROLS})
    frame = tracked(dog)
    office.offer(frame)
    assert decode(web.message()).topic == "dog/controls"
    assert computed & set(vars(frame)) == {"controls"}
    web.close()
    wait_until(lambda: office.counts.clients == 0 and office.kinds() == set())
    frame = tracked(dog)
    office.offer(frame)
    assert not computed & set(vars(frame))


def test_requests_of_the_control_socket_are_answered_in_their_order(office, connect):
    web = connect(office)
    assert web.ask({"do": "ping", "id": 7}) == {"id": 7, "ok": True, "result": "pong"}
    for number in range(200):
        web.send({"do": "ping", "id": number})
    assert [json.loads(web.message())["id"] for _ in range(200)] == list(range(200))
    assert web.ask({"do": "pong", "id": "x"})["error"]["fix"] == "Did you mean 'ping'?"


@pytest.mark.parametrize(
    "text",
    [
        *("", "mirror the dog", "[]", "[" * 60_000),
        *('{"subscribe": 5}', '{"subscribe": ""}', '{"subscribe": "dog/\\u0000"}', '{"subscribe": "%s"}' % ("a" * 64)),
    ],
)
def test_a_text_that_is_no_request_gets_an_error_and_the_client_stays(office, connect, text):
    web = connect(office)
    assert web.ask(text)["ok"] is False
    assert web.ask({"do": "ping"})["result"] == "pong"


def test_a_slow_client_receives_the_newest_frames_and_costs_the_others_nothing(office, connect, dog):
    slow = raw_client(office)
    quick = connect(office)
    for each in ("dog/vertices", "dog/joints"):
        slow.send({"subscribe": each})
    quick.subscribe("dog/controls")
    wait_until(lambda: office.kinds() == {Kind.VERTICES, Kind.JOINTS, Kind.CONTROLS})
    size = len(tracked(dog).vertices_and_normals.tobytes())
    count = 200 + 8_000_000 // size
    for sequence in range(count):
        office.offer(tracked(dog, sequence))
        assert decode(quick.message()).header.sequence == sequence
    assert office.counts.skipped > 100
    received = [decode(slow.message()) for _ in range(5)]
    assert received[0].header.sequence == 0
    by_topic = {}
    while by_topic != {"dog/vertices": count - 1, "dog/joints": count - 1}:
        message = decode(slow.message())
        assert message.header.sequence > by_topic.get(message.topic, -1)
        by_topic[message.topic] = message.header.sequence
    assert office.counts.sent < 3 * count - 100
    slow.close()


class raw_client:  # noqa: N801 - reads like a function
    """A client written by hand that reads only when it is told to, with a small receive buffer."""

    def __init__(self, office):
        self.socket = socket.socket()
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.socket.settimeout(SECONDS)
        self.socket.connect(("127.0.0.1", office.port))
        self.socket.sendall(
            f"GET /stream HTTP/1.1\r\nHost: 127.0.0.1:{office.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        self.file = self.socket.makefile("rb")
        while self.file.readline().strip():
            pass
        self.send({})

    def send(self, value):
        self.frame(1, json.dumps(value).encode())

    def frame(self, opcode, body):
        head = bytes([0x80 | opcode])
        size = bytes([0x80 | len(body)]) if len(body) < 126 else b"\xfe" + len(body).to_bytes(2, "big")
        self.socket.sendall(head + size + bytes(4) + body)

    def message(self):
        first, size = self.file.read(2)
        assert first == 0x82
        if size > 125:
            size = int.from_bytes(self.file.read(2 if size == 126 else 8), "big")
        return self.file.read(size)

    def close(self):
        self.file.close()
        self.socket.close()


def test_a_client_that_never_reads_costs_no_more_memory_than_its_topics(office, connect, dog, monkeypatch):
    monkeypatch.setattr(websocket_server, "MAX_WAITING_TOPICS", 128)
    stalled = raw_client(office)
    for number in range(3 * websocket_server.MAX_WAITING_TOPICS):
        stalled.send({"subscribe": f"dog/scene/{number}"})
        if number % 32 == 0:
            stalled.send({"do": "long"})
    for _ in range(200):
        stalled.send({"do": "long"})
    connect(office).subscribe("dog/controls")
    wait_until(lambda: office.taken >= 200)
    (client,) = [each for each, stream in office.output._streams.items() if not stream.kinds_of("dog")]
    wait_until(lambda: office.do(office.output.due) > time.monotonic() + 100)
    assert len(client._messages) <= websocket_server.MAX_WAITING_TOPICS
    assert len(client._replies) <= websocket_server.MAX_WAITING_REPLIES
    scenes = {id(parts[1]) for parts in client._messages.values() if len(parts) > 1}
    assert len(scenes) <= 1  # one copy of the scene, however many wait
    stalled.close()


def test_a_client_that_does_not_answer_pings_is_disconnected(timed, office):
    client = raw_client(office)
    wait_until(lambda: office.counts.clients == 1)
    wait_until(lambda: timed.advance(1.0) or office.counts.clients == 0)
    client.close()


@pytest.mark.parametrize(
    ("header", "value", "reason"),
    [
        ("Origin", "http://evil.example", "wrong origin"),
        ("Origin", "", "wrong origin"),
        ("Host", "127.0.0.1.evil.example", "wrong host"),
    ],
)
def test_another_host_or_origin_is_refused_with_a_reason_in_the_log(
    open_office, connect, header, value, reason, caplog
):
    office = open_office(origins=["http://localhost:8000"])
    with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
        connect(office, headers={header: value})
    assert refused.value.status == 403
    assert office.counts.refused == 1
    (record,) = caplog.records
    assert (record.fields["reason"], record.fields["address"]) == (reason, "127.0.0.1")
    assert header == "Host" or record.fields.get("origin", "") == value


def test_its_own_origin_and_those_of_the_service_file_are_accepted(open_office, connect):
    office = open_office(origins=["http://localhost:8000", "https://stage.example"])
    for headers in (
        {"Origin": f"http://127.0.0.1:{office.port}"},
        {"Origin": f"http://localhost:{office.port}", "Host": f"localhost:{office.port}"},
        {"Origin": "http://localhost:8000"},
        {"Origin": "https://stage.example", "Host": "stage.example"},
        {},
    ):
        assert connect(office, headers=headers).ask({"do": "ping"})["ok"]
    assert office.counts.refused == 0


@pytest.mark.parametrize(
    "first",
    [
        *({"token": wrong} for wrong in ("another-token-of-24-bytes", None, 5, TOKEN + "x")),
        {"do": "ping"},
        [],
        "text",
        "",
    ],
)
def test_only_a_client_with_the_token_is_served_and_others_are_closed_with_4401(open_office, connect, first, caplog):
    office = open_office(token=TOKEN)
    web = connect(office, first)
    assert web.pending(SECONDS) == []
    assert web.socket.close_code == 4401
    assert office.counts.refused == 1
    (record,) = caplog.records
    assert record.fields["reason"] == "wrong token"
    assert TOKEN not in str(vars(record))
    assert office.do(lambda: dict(office.output._streams)) == {}
    assert office.taken == 0
    assert connect(office, {"token": TOKEN}).ask({"do": "ping"})["result"] == "pong"


def test_other_machines_require_a_token(dog):
    for host in ("0.0.0.0", "*"):
        with pytest.raises(ServiceError, match=r"\[websocket\], host: .* no token; expected a token"):
            Office(dog, host=host)


def test_a_port_that_is_taken_is_refused_in_a_sentence(office, dog):
    with pytest.raises(
        ServiceError, match=rf"\[websocket\]: found .* 127\.0\.0\.1, port {office.port} \(Address already"
    ):
        WebSocketTable(port=office.port).open(Opening([dog], None, [office.network], None, None))


def test_a_client_beyond_the_limit_is_closed_and_may_come_when_there_is_room(open_office, connect):
    office = open_office(max_clients=1)
    first = connect(office)
    assert first.ask({"do": "ping"})["ok"]
    assert connect(office).message() == 1013
    assert first.ask({"do": "ping"})["ok"]
    first.close()
    wait_until(lambda: office.counts.clients == 0)
    assert connect(office).ask({"do": "ping"})["ok"]


def test_connections_that_do_not_authenticate_are_closed_and_keep_nobody_out(timed, office, connect, monkeypatch):
    monkeypatch.setattr(websocket_server, "HEARTBEAT_SECONDS", 1e9)
    monkeypatch.setattr(websocket_server, "MAX_HANDSHAKES", 8)
    member = connect(office)
    assert member.ask({"do": "ping"})["ok"]
    idle = [socket.create_connection(("127.0.0.1", office.port)) for _ in range(30)]
    for each in idle[:4]:
        each.sendall(b"GET /stream HTTP/1.1\r\nHost: 127")
    wait_until(lambda: timed.advance(1.0) or office.counts.refused == 30)
    for each in idle:
        each.settimeout(SECONDS)
        with suppress(ConnectionResetError):
            assert each.recv(100) == b""
        each.close()
    assert member.ask({"do": "ping"})["ok"]
    assert connect(office).ask({"do": "ping"})["ok"]


def test_binary_and_oversized_messages_end_the_connection_only(office, connect):
    member, intruder, other = connect(office), connect(office), connect(office)
    intruder.send_bytes(b"\1dog/controls\0")
    assert intruder.message() == aiohttp.WSCloseCode.UNSUPPORTED_DATA
    other.send("x" * (websocket_server.MAX_TEXT_BYTES + 1))
    # the operating system may reset a connection that is closed before all is read, and the reason with it
    assert other.message() in (aiohttp.WSCloseCode.MESSAGE_TOO_BIG, aiohttp.WSCloseCode.ABNORMAL_CLOSURE)
    assert member.ask({"do": "ping"})["ok"]


def test_other_paths_and_plain_requests_are_answered_briefly(office):
    for path, status in (("/", 404), ("/stream/../../etc/passwd", 404), ("/stream", 400)):
        with socket.create_connection(("127.0.0.1", office.port), SECONDS) as client:
            client.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{office.port}\r\n\r\n".encode())
            answer = b"".join(iter(lambda: client.recv(4096), b""))
            assert answer.startswith(f"HTTP/1.1 {status}".encode())


def test_random_frames_leave_the_service_unharmed(office, connect):
    member, random = connect(office), np.random.default_rng(5)
    for turn in range(40):
        client = raw_client(office)
        with suppress(OSError):
            for _ in range(25):
                body = random.bytes(random.integers(0, 300))
                if random.random() < 0.8:  # a text, which keeps the connection open
                    client.frame(1, body.decode("latin-1").encode()[:125])
                else:
                    client.socket.sendall(body)
        client.close()
        assert member.ask({"do": "ping", "id": turn})["id"] == turn
    wait_until(lambda: office.counts.clients == 1)
    assert office.do(lambda: len(office.output._streams)) == 1


def test_closing_tells_the_clients_and_frees_the_port(open_office, connect):
    office = open_office()
    web = connect(office)
    assert web.ask({"do": "ping"})["ok"]
    office.close()
    assert web.message() == aiohttp.WSCloseCode.GOING_AWAY
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", office.port))
