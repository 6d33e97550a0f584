"""A whole service that serves web pages."""

import asyncio
import json
import socket
from contextlib import ExitStack, closing, suppress
from random import Random
from select import select

import aiohttp
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from engine_bridge.service.control.requests import Nothing
from engine_bridge.service.outputs import websocket_server
from engine_bridge.service.protocol.header import FRAME_KINDS, Kind
from engine_bridge.service.protocol.payloads import decode, encode
from engine_bridge.service.security.credentials import make_token
from puppetline.errors import ServiceError

from ....clock import GivenLoop
from ...refusals import refused

LIVE = [kind for kind in FRAME_KINDS if kind not in (Kind.MORPHS, Kind.BONES, Kind.CHANNELS, Kind.JOINTS)]
"""Kinds of what a character without morph targets and limbs has while nobody moves it."""

UPGRADE = {
    "Host": "127.0.0.1",
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": 13,
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


class Web:
    """A page that reads only when it is told to, with a small receive buffer."""

    def __init__(self, service, first, headers):
        self.service, self.socket, self._kept = service, socket.socket(), []
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.socket.connect(place(service))
        lines = "".join(f"{name}: {value}\r\n" for name, value in (UPGRADE | headers).items())
        self.socket.sendall(f"GET /stream HTTP/1.1\r\n{lines}\r\n".encode())
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += self.socket.recv(1)
        self.status = int(answer.split()[1])
        if self.status == 101:
            self.send(first)

    def _frame(self, opcode, body):
        self.socket.sendall(bytes([opcode, 0xFF]) + len(body).to_bytes(8, "big") + bytes(4) + body)

    def send(self, *values):
        for value in values:
            if isinstance(value, bytes):
                self._frame(0x82, value)
            else:
                self._frame(0x81, (value if isinstance(value, str) else json.dumps(value)).encode())

    def _read(self, size):
        return self.socket.recv(size, socket.MSG_WAITALL)

    def next(self):
        """Return what comes next: bytes, text, or the code with which the service has closed the connection."""
        try:
            first, size = self._read(2)
        except (ValueError, ConnectionError):  # without a code
            return aiohttp.WSCloseCode.ABNORMAL_CLOSURE
        if size > 125:
            size = int.from_bytes(self._read(2 if size == 126 else 8), "big")
        body = self._read(size)
        if first == 0x88:
            with suppress(ConnectionError):
                self.socket.sendall(bytes([0x88, 0x80]) + bytes(4))
            return int.from_bytes(body[:2], "big")
        return body if first == 0x82 else body.decode()

    def message(self):
        """Return what comes next, and turn the service's loop until it comes."""
        if self._kept:
            return self._kept.pop(0)
        self.service.wait(lambda: select([self.socket], [], [], 0)[0])
        return self.next()

    def ask(self, value):
        """Send a request and return its reply; what comes before is kept."""
        self.send(value)
        kept = []
        while isinstance(message := self.message(), bytes):
            kept.append(message)
        self._kept = kept
        return json.loads(message)

    def subscribe(self, *topics):
        """Subscribe to topics, and wait until the service knows."""
        self.send(*({"subscribe": each} for each in topics))
        self.ask({"do": "ping"})

    def close(self):
        self.socket.close()


@pytest.fixture
def serving(given_clock, monkeypatch):
    """Take a service that serves web pages, whose loop is on the given clock, too; end both at the end."""
    monkeypatch.setattr(asyncio, "new_event_loop", GivenLoop)
    opened = []

    def take(service):
        service.web = service.service._outputs[1]
        opened.append(service)
        return service

    yield take
    for service in opened:
        service.close()
        while service.web._server._thread.is_alive():
            given_clock.advance(1.0)


@pytest.fixture
def office(play_file, serving):
    """Play a service for web pages."""
    return lambda more="", port=0: serving(play_file(f"[websocket]\nport = {port}\n{more}"))


@pytest.fixture
def connect():
    """Connect pages, which leave before the service ends."""
    with ExitStack() as pages:
        yield lambda service, first="{}", **headers: pages.enter_context(closing(Web(service, first, headers)))


def place(service):
    """Return the host and the port of web pages."""
    host, _, port = service.web.endpoints[0].removeprefix("ws://").removesuffix("/stream").rpartition(":")
    return host, int(port)


def test_messages_are_those_of_every_output_and_what_is_asked_for_again_is_answered_again(office, connect):
    service = office()
    web, other = connect(service), connect(service)
    web.subscribe(*(f"dog/{kind.word}" for kind in LIVE))
    assert service.kinds(1) == set(LIVE)
    frame = service.next_frame()
    for kind in LIVE:
        message = web.message()
        assert message == encode(kind, frame, decode(message).header.published)
    for _ in range(2):
        other.subscribe("dog/scene/mine")
        service.run(1.0)
        scene = decode(other.message())
        assert scene.topic == "dog/scene/mine"
        assert_array_equal(scene.body.arrays["positions"], frame.character.rest.astype(np.float32))
    web.send({"unsubscribe": "dog/vertices"})
    web.ask({"do": "ping"})
    assert service.kinds(1) == {*LIVE} - {Kind.VERTICES}
    web.close()
    service.wait(lambda: len(service.web._streams) == 1)
    assert service.kinds(1) == set()


def test_requests_of_the_control_socket_are_answered_in_their_order_and_other_texts_get_an_error(office, connect):
    web = connect(office())
    web.send(*({"do": "ping", "id": number} for number in range(200)))
    replies = [json.loads(web.message()) for _ in range(200)]
    assert replies == [{"id": number, "ok": True, "result": "pong"} for number in range(200)]
    no_topics = ({"subscribe": wrong} for wrong in ("", "dog/\0", "a" * 64, 5))
    for text in ("", "mirror the dog", "[]", "[" * 60_000, *no_topics):
        assert web.ask(text)["ok"] is False
    assert web.ask({"do": "pong"})["error"]["fix"] == "Did you mean 'ping'?"


def test_a_slow_client_receives_the_newest_frames_and_costs_the_others_nothing(office, connect):
    service = office()
    slow, quick = connect(service), connect(service)
    slow.send(*({"subscribe": each} for each in ("dog/vertices", "dog/handles")))
    quick.subscribe("dog/controls")
    service.wait(lambda: service.kinds(1) == {Kind.VERTICES, Kind.HANDLES, Kind.CONTROLS})
    sent = 0
    while sent < 15_000_000:  # more than anything on the way can hold
        frame = service.next_frame()
        sent += frame.vertices_and_normals.nbytes
        assert decode(quick.message()).header.sequence == frame.sequence
    last, skipped = frame.sequence, service.web.statistics.skipped
    assert skipped > 100
    newest, came = {}, 0
    while newest != {"dog/vertices": last, "dog/handles": last}:
        message = decode(slow.next())
        assert message.header.sequence > newest.get(message.topic, -1)
        newest[message.topic] = message.header.sequence
        came += 1
    assert came + skipped == 2 * len(service.frames)


def test_a_client_that_never_reads_costs_no_more_memory_than_its_topics(office, connect, monkeypatch):
    monkeypatch.setattr(websocket_server, "MAX_WAITING_TOPICS", 128)
    service, taken = office(), []
    service.service.dispatcher._commands["long"] = (Nothing, lambda _: taken.append(1) or "x" * 60_000)
    connect(service).send(*({"subscribe": f"dog/scene/{number}"} for number in range(400)), *[{"do": "long"}] * 200)
    service.wait(lambda: len(taken) == 200)
    service.run(2.0)
    [client] = service.web._streams
    assert len(client._messages) <= 128
    assert len(client._replies) <= websocket_server.MAX_WAITING_REPLIES
    assert len({id(parts[1]) for parts in client._messages.values() if len(parts) > 1}) <= 1  # one copy of the scene


def test_a_client_that_does_not_answer_pings_is_disconnected(given_clock, office, connect):
    service = office()
    connect(service)
    service.wait(lambda: service.web.statistics.clients == 1)
    service.wait(lambda: given_clock.advance(1.0) or service.web.statistics.clients == 0)


def test_only_hosts_and_origins_of_the_service_and_of_its_file_are_accepted(office, connect, caplog):
    service = office('origins = ["http://localhost:8000", "https://stage.example"]')
    for headers in ({"Origin": "https://stage.example", "Host": "stage.example"}, {}):
        assert connect(service, **headers).ask({"do": "ping"})["ok"]
    assert service.web.statistics.refused == 0
    for headers in ({"Origin": "http://evil.example"}, {"Host": "127.0.0.1.evil.example"}):
        assert connect(service, **headers).status == 403
    assert service.web.statistics.refused == 2
    [record] = caplog.records  # once a second
    page = {"address": "127.0.0.1", "host": "127.0.0.1", "origin": "http://evil.example"}
    assert record.fields == {"reason": "wrong origin"} | page


def test_only_a_client_with_the_token_is_served_and_others_are_closed_with_4401(
    play, serving, connect, blob_puppet, tmp_path, caplog
):
    path = tmp_path / "token"
    make_token(path)
    token = path.read_text().strip()
    service = serving(play("--puppet", blob_puppet, "--source", "osc:0", "--token-file", path, "--websocket", 0))
    wrong = [*({"token": each} for each in ("another-token-of-24-bytes", None, 5, token + "x")), {"do": "ping"}, []]
    for first in (*wrong, "text", ""):
        web = connect(service, first)
        with suppress(ConnectionError):
            web.send({"do": "list"})
        assert web.message() == 4401
    assert service.web.statistics.refused == len(wrong) + 2
    [record] = caplog.records
    assert record.fields["reason"] == "wrong token"
    assert token not in str(vars(record))
    assert not service.web._streams
    assert connect(service, {"token": token}).ask({"do": "ping"})["result"] == "pong"


def test_other_machines_require_a_token_and_a_port_that_is_taken_is_refused(office):
    assert refused(ServiceError, office, 'host = "*"').where == "[websocket], host"
    with socket.create_server(("127.0.0.1", 0)) as other:
        assert refused(ServiceError, office, port=other.getsockname()[1]).where == "[websocket]"


def test_a_client_beyond_the_limit_is_closed_and_may_come_when_there_is_room(office, connect):
    service = office("max_clients = 1")
    first = connect(service)
    assert first.ask({"do": "ping"})["ok"]
    assert connect(service).message() == aiohttp.WSCloseCode.TRY_AGAIN_LATER
    assert first.ask({"do": "ping"})["ok"]
    first.close()
    service.wait(lambda: service.web.statistics.clients == 0)
    assert connect(service).ask({"do": "ping"})["ok"]


def test_connections_that_do_not_authenticate_are_closed_and_keep_nobody_out(given_clock, office, connect, monkeypatch):
    monkeypatch.setattr(websocket_server, "HEARTBEAT_SECONDS", 1e9)
    monkeypatch.setattr(websocket_server, "MAX_HANDSHAKES", 8)
    service = office()
    member = connect(service)
    assert member.ask({"do": "ping"})["ok"]
    with ExitStack() as left_open:
        idle = []
        with given_clock.standing():
            while not service.web.statistics.refused:  # one too many at a time
                idle.append(left_open.enter_context(socket.create_connection(place(service))))
                if len(idle) < 5:
                    idle[-1].sendall(b"GET /stream HTTP/1.1\r\nHost: 127")
                service.service.turn()
        assert len(idle) > websocket_server.MAX_HANDSHAKES
        service.wait(lambda: given_clock.advance(1.0) or service.web.statistics.refused == len(idle))
        for each in idle:
            with suppress(ConnectionResetError):
                assert each.recv(100) == b""
    assert member.ask({"do": "ping"})["ok"]
    assert connect(service).ask({"do": "ping"})["ok"]


def test_messages_and_requests_of_other_programs_end_the_connection_only(given_clock, office, connect):
    service = office()
    member, intruder, other = (connect(service) for _ in range(3))
    intruder.send(b"\1dog/controls\0")
    assert intruder.message() == aiohttp.WSCloseCode.UNSUPPORTED_DATA
    with suppress(ConnectionError):
        other.send("x" * (websocket_server.MAX_TEXT_BYTES + 1))
    # the operating system may reset a connection that is closed before all is read, and the reason with it
    assert other.message() in (aiohttp.WSCloseCode.MESSAGE_TOO_BIG, aiohttp.WSCloseCode.ABNORMAL_CLOSURE)
    for path, status in (("/", 404), ("/stream/../../etc/passwd", 404), ("/stream", 400)):
        with socket.create_connection(place(service)) as client:
            client.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
            assert client.makefile("rb").read().startswith(f"HTTP/1.1 {status}".encode())
    chance = Random(5)
    for turn in range(40):
        with closing(connect(service)) as client, suppress(OSError):
            for _ in range(25):
                body = chance.randbytes(chance.randrange(300))
                if chance.random() < 0.8:  # a text, which keeps the connection open
                    client.send(body.decode("latin-1"))
                else:
                    client.socket.sendall(body)
        assert member.ask({"do": "ping", "id": turn})["id"] == turn
    service.wait(lambda: given_clock.advance(0.1) or len(service.web._streams) == service.web.statistics.clients == 1)


def test_closing_tells_the_clients_and_frees_the_port(office, connect):
    service = office()
    web = connect(service)
    assert web.ask({"do": "ping"})["ok"]
    service.close()
    assert web.next() == aiohttp.WSCloseCode.GOING_AWAY
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(place(service))
