import logging
import socket as sockets
import threading
import time
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial

import pytest
import zmq
import zmq.auth
from hypothesis import given, settings
from hypothesis import strategies as st
from zmq.utils.monitor import recv_monitor_message

from engine_bridge.service.control.control_socket import Control, request
from engine_bridge.service.control.dispatcher import Dispatcher
from engine_bridge.service.control.requests import Nothing
from engine_bridge.service.security import endpoints as endpoints_module
from engine_bridge.service.security import guard as guard_module
from engine_bridge.service.security.credentials import make_curve_keys
from engine_bridge.service.security.endpoints import CurveTable, NetworkSettings, endpoints_of
from engine_bridge.service.security.guard import SETTLED_SECONDS, ZAP_ADDRESS, Guard, _Connections
from puppetline.errors import ServiceError

TOKEN = "Zp3-sYd_0123456789"
DECIDED = zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_DISCONNECTED
TIMEOUT_MS = 20_000
"""Milliseconds after which something that must happen has not."""


ask = partial(request, timeout=TIMEOUT_MS / 1000)


@pytest.fixture(autouse=True)
def _no_token(monkeypatch):
    monkeypatch.delenv("PUPPETLINE_TOKEN", raising=False)


class House:
    """A service with a stream that never ends, a control socket and a guard, in a thread of its own."""

    def __init__(self, network):
        self.endpoints = endpoints_of(network)
        self.context = zmq.Context()
        self.guard = Guard(self.context, self.endpoints, network.max_clients)
        commands = {"ping": (Nothing, lambda _: "pong"), "clients": (Nothing, lambda _: asdict(self.guard.clients))}
        self.control = Control(self.context, self.endpoints, Dispatcher(commands))
        self.streams = [self.context.socket(zmq.XPUB) for _ in self.endpoints]
        for endpoint, stream in zip(self.endpoints, self.streams, strict=True):
            stream.linger = 0
            endpoint.prepare(stream)
            stream.bind(endpoint.stream)
        for each in [*self.streams, *self.control.sockets]:
            self.guard.watch(each)
        self._open = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        poller = zmq.Poller()
        for each in [*self.guard.sockets, *self.streams, *self.control.sockets]:
            poller.register(each, zmq.POLLIN)
        while self._open:
            ready = dict(poller.poll(5))
            self.guard.handle()
            for each in self.control.sockets:
                self.control.handle(each)
            for stream in self.streams:
                if stream in ready:
                    stream.recv()
                stream.send(b"still here", zmq.NOBLOCK)

    def close(self):
        self._open = False
        self._thread.join()
        self.guard.close()
        self.control.close()
        for stream in self.streams:
            stream.close()
        self.context.term()

    def clients(self):
        """Return the guard's figures, as its own thread has them."""
        return ask(self.control.endpoints[0], "clients", token=self.endpoints[0].token.decode() or None)

    def address(self, mechanism):
        """Return the stream's and the control socket's address of a endpoint."""
        index = [endpoint.mechanism for endpoint in self.endpoints].index(mechanism)
        return self.streams[index].last_endpoint.decode(), self.control.endpoints[index]


@pytest.fixture
def keys(tmp_path):
    """The keys of the service, of a client that it knows, and of a stranger, by name: public and secret."""
    (tmp_path / "clients").mkdir(mode=0o700)
    for name in ("service", "stranger", "clients/laptop"):
        make_curve_keys(tmp_path / f"{name}.key_secret")
    return {
        name: zmq.auth.load_certificate(tmp_path / f"{path}.key_secret")
        for name, path in (("service", "service"), ("stranger", "stranger"), ("laptop", "clients/laptop"))
    }


@pytest.fixture
def network(tmp_path, keys, monkeypatch):
    """Return settings with one of the three mechanisms, or two."""

    def settings_with(*mechanisms, **more):
        if "PLAIN" in mechanisms:
            monkeypatch.setenv("PUPPETLINE_TOKEN", TOKEN)
        curve = CurveTable(port=0, key_file=tmp_path / "service.key_secret", clients_folder=tmp_path / "clients")
        return NetworkSettings(port=0, curve=curve if "CURVE" in mechanisms else None, **more)

    return settings_with


@pytest.fixture
def house(network, until_end):
    """Open a service with some of the mechanisms."""
    return lambda *mechanisms, **more: until_end(House(network(*mechanisms, **more)))


@pytest.fixture
def visit(context, keys):
    """Connect a subscriber; say whether it was let in, and give the subscriber."""
    here = []

    def come(address, mechanism="NULL", token=TOKEN, key="laptop", service="service"):
        client = context.socket(zmq.SUB)
        here.append(client)  # or it would leave when the test forgets it
        client.subscribe(b"")
        if mechanism == "PLAIN":
            client.plain_username, client.plain_password = (
                b"anybody",
                token if isinstance(token, bytes) else token.encode(),
            )
        elif mechanism == "CURVE":
            client.curve_publickey, client.curve_secretkey = keys[key]
            client.curve_serverkey = keys[service][0]
        monitor = client.get_monitor_socket(DECIDED)
        client.connect(address)
        assert monitor.poll(TIMEOUT_MS), "neither let in nor refused"
        let_in = recv_monitor_message(monitor)["event"] == zmq.EVENT_HANDSHAKE_SUCCEEDED
        client.disable_monitor()
        monitor.close()
        return let_in, client

    return come


@pytest.fixture
def assert_served(visit):
    """Fail unless a good client comes in by a endpoint and hears the stream."""

    def check(house, mechanism):
        let_in, client = visit(house.address(mechanism)[0], mechanism)
        assert let_in
        assert client.poll(TIMEOUT_MS)
        assert client.recv() == b"still here"
        client.close(0)

    return check


@pytest.mark.parametrize(
    ("endpoint", "visitor"),
    [
        ("PLAIN", {"mechanism": "PLAIN", "token": b"another-token-of-that-length"}),
        ("PLAIN", {"mechanism": "NULL"}),
        ("PLAIN", {"mechanism": "CURVE"}),
        ("CURVE", {"mechanism": "CURVE", "key": "stranger"}),
        ("CURVE", {"mechanism": "CURVE", "key": "service"}),
        ("CURVE", {"mechanism": "CURVE", "service": "stranger"}),
        ("CURVE", {"mechanism": "PLAIN"}),
        ("CURVE", {"mechanism": "NULL"}),
        ("NULL", {"mechanism": "PLAIN"}),
        ("NULL", {"mechanism": "CURVE"}),
    ],
    ids=str,
)
def test_a_client_without_credentials_is_refused_and_the_next_is_served(house, visit, assert_served, endpoint, visitor):
    opened = house(endpoint)
    let_in, client = visit(opened.address(endpoint)[0], **visitor)
    assert not let_in
    assert_served(opened, endpoint)
    assert not client.poll(0)


def test_the_control_socket_has_the_same_lock(house):
    control = house("PLAIN").address("PLAIN")[1]
    for token in ("another-token-of-that-length", None):
        with pytest.raises(ServiceError, match="a service that refuses this client") as told:
            ask(control, "ping", token=token)
        assert TOKEN not in str(told.value)
    assert ask(control, "ping", token=TOKEN) == "pong"


GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01%b\x00" + bytes(31)


def greeting(mechanism):
    return GREETING % mechanism.encode().ljust(20, b"\0")


@pytest.mark.parametrize("endpoint", ["NULL", "PLAIN", "CURVE"])
@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1:7400\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(64),
        bytes(range(256)) * 300,
        greeting("GSSAPI"),
        greeting("NULL") + b"\x06" + b"\xff" * 8,
        greeting("NULL") + b"\x04\x05\x05HELLO",
        greeting("NULL") + b"\x04\x0e\x05READY\xff\xff\xff\xff\xff\xff\xff\xff",
        greeting("NULL") + b"\x04\x1a\x05READY\x0bSocket-Type\x00\x00\x00\x04PAIR",
        greeting("PLAIN") + b"\x04\x08\x05HELLO\xff\xff",
        greeting("PLAIN") + b"\x04\x08\x08INITIATE",
        greeting("CURVE") + b"\x04\xc8\x05HELLO" + bytes(194),
    ],
    ids=range(11),
)
def test_garbage_ends_in_nothing_and_the_next_is_served(house, assert_served, endpoint, data):
    opened = house(endpoint)
    for address in opened.address(endpoint):
        with sockets.create_connection(("127.0.0.1", int(address.rsplit(":", 1)[1])), TIMEOUT_MS / 1000) as raw:
            raw.sendall(data)
            assert_served(opened, endpoint)
    for address in opened.address(endpoint):  # and a byte at a time
        with sockets.create_connection(("127.0.0.1", int(address.rsplit(":", 1)[1])), TIMEOUT_MS / 1000) as raw:
            raw.setsockopt(sockets.IPPROTO_TCP, sockets.TCP_NODELAY, 1)
            try:
                for byte in data[:80]:
                    raw.sendall(bytes([byte]))
            except ConnectionError:
                pass
            assert_served(opened, endpoint)


@contextmanager
def left_open(address, data, number):
    """Connections on each of which a client has said so much, and then nothing more."""
    port = int(address.rsplit(":", 1)[1])
    opened = [sockets.create_connection(("127.0.0.1", port), TIMEOUT_MS / 1000) for _ in range(number)]
    try:
        for each in opened:
            each.sendall(data)
        yield opened
    finally:
        for each in opened:
            each.close()


@pytest.mark.parametrize(
    ("endpoint", "length"),
    [(endpoint, length) for endpoint in ("NULL", "PLAIN") for length in (0, 10, 63)] + [("PLAIN", 64), ("CURVE", 64)],
)
def test_handshakes_left_half_way_take_nobodys_place(house, assert_served, endpoint, length):
    opened = house(endpoint, max_clients=4)
    address, _ = opened.address(endpoint)
    with left_open(address, greeting(endpoint)[:length], 30):
        assert_served(opened, endpoint)


def test_a_client_that_never_ends_the_handshake_is_disconnected_and_counted(house, monkeypatch, assert_served):
    monkeypatch.setattr(endpoints_module, "HANDSHAKE_SECONDS", 1.0)
    opened = house("PLAIN")
    with left_open(opened.address("PLAIN")[0], greeting("PLAIN"), 3) as waiting:
        for each in waiting:
            while each.recv(4096):
                pass
    assert_served(opened, "PLAIN")
    assert opened.clients()["refused"] == 3


def test_the_65th_client_waits_until_one_has_left(house, visit, monkeypatch):
    monkeypatch.setattr(endpoints_module, "HANDSHAKE_SECONDS", 1.0)  # one that is turned away tries again after it
    opened = house("NULL")
    stream, control = opened.address("NULL")
    clients = []
    for _ in range(64):
        let_in, client = visit(stream)
        assert let_in
        clients.append(client)
    let_in, late = visit(stream)
    assert not let_in
    for client in clients:
        assert client.poll(TIMEOUT_MS)
        assert client.recv() == b"still here"
    assert not late.poll(0)
    assert opened.clients()["connected"] == opened.clients()["limit"] == 64
    assert opened.clients()["refused"] >= 1
    assert ask(control, "ping") == "pong", "the control socket has room of its own"
    clients.pop().close(0)
    assert late.poll(TIMEOUT_MS), "there is room again, and nobody told it to try again"


def test_all_doors_share_the_room(house, visit, monkeypatch):
    monkeypatch.setattr(endpoints_module, "HANDSHAKE_SECONDS", 1.0)
    opened = house("PLAIN", "CURVE", max_clients=2)
    assert visit(opened.address("PLAIN")[0], "PLAIN")[0]
    assert visit(opened.address("CURVE")[0], "CURVE")[0]
    assert not visit(opened.address("PLAIN")[0], "PLAIN")[0]
    assert not visit(opened.address("CURVE")[0], "CURVE")[0]


def test_a_stranger_does_not_learn_whether_there_is_room(house, visit, context):
    opened = house("PLAIN", max_clients=1)
    assert visit(opened.address("PLAIN")[0], "PLAIN")[0]
    stranger = context.socket(zmq.SUB)
    stranger.plain_username, stranger.plain_password = b"x", b"wrong"
    monitor = stranger.get_monitor_socket(zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_AUTH)
    stranger.connect(opened.address("PLAIN")[0])
    assert monitor.poll(TIMEOUT_MS), "who has no room is cut off without a word, who has no token is told"


def test_the_place_of_who_left_is_free_at_once(house, visit):
    opened = house("NULL", max_clients=1)
    for _ in range(20):
        let_in, client = visit(opened.address("NULL")[0])
        assert let_in
        assert opened.clients() == {"connected": 1, "refused": 0, "limit": 1}
        client.close(0)
        while opened.clients()["connected"]:  # until its leaving has been noticed
            time.sleep(0.001)


def test_a_crowd_counts_those_let_in_who_are_still_there():
    connections = _Connections()
    connections.opened = {("monitor", fd): 100.0 for fd in range(5)}
    assert connections.count(100.1) == 0, "nobody was let in"
    connections.admitted.extend([100.2, 100.2])
    assert connections.count(100.3) == 2, "and three shake hands yet"
    connections.opened = {("monitor", 0): 100.0}
    assert connections.count(100.4) == 1, "one that was let in has gone"
    assert connections.count(100.4, undecided=1) == 0, "both have, and another one is at the endpoint"
    assert connections.count(100.0 + 2 * SETTLED_SECONDS) == 1, "who stays is one that was let in"
    assert not connections.admitted
    connections.opened.clear()
    assert connections.count(100.0 + 2 * SETTLED_SECONDS) == 0


def test_refusals_are_logged_without_secrets(house, visit, caplog):
    caplog.set_level(logging.WARNING)
    opened = house("PLAIN")
    for _ in range(5):
        visit(opened.address("PLAIN")[0], "PLAIN", token=b"a-wrong-one-that-is-private")
    mine = [each for each in caplog.records if each.name == guard_module.__name__]
    assert mine[0].getMessage() == "client refused"
    assert mine[0].fields == {"reason": "wrong credentials", "address": "127.0.0.1"}
    assert opened.guard.refused == 5
    assert "private" not in caplog.text
    assert TOKEN not in caplog.text


@pytest.fixture(scope="module")
def asker():
    """A guard of a endpoint with a token, and a function that asks it as libzmq does, whatever the question."""
    context = zmq.Context()
    endpoint = endpoints_module.Endpoint("PLAIN", "", "", token=TOKEN.encode())
    guard = Guard(context, [endpoint], 1_000_000)
    client = context.socket(zmq.DEALER)
    client.connect(ZAP_ADDRESS)

    def ask(*frames):
        client.send_multipart([b"", *frames])
        guard.handle()
        return client.recv_multipart(zmq.NOBLOCK) if client.poll(0) else None

    yield ask
    guard.close()
    context.destroy(0)


GOOD = (b"1.0", b"7", b"stream", b"127.0.0.1", b"", b"PLAIN", b"somebody", TOKEN.encode())
ODD = st.sampled_from([b"", b"2.0", b"control", b"global", b"CURVE", b"plain", TOKEN.encode() + b"\0"])
LIKE_GOOD = st.tuples(*(st.just(frame) | st.just(frame) | ODD for frame in GOOD)).map(list)


@settings(max_examples=300)
@given(st.one_of(LIKE_GOOD, st.integers(0, 8).map(lambda end: [*GOOD[:end]]), st.lists(ODD | st.binary(max_size=300))))
def test_a_question_of_libzmq_is_granted_with_the_token_only(asker, frames):
    reply = asker(*frames)
    if len(frames) < 2:
        assert reply is None
    else:
        is_good = len(frames) == 8 and frames[2] in (b"stream", b"control") and frames[5::2] == list(GOOD[5::2])
        status = b"500" if len(frames) < 6 or frames[0] != b"1.0" else b"200" if is_good else b"400"
        assert reply == [b"", b"1.0", frames[1], status, b"", b"", b""]
    assert asker(*GOOD)[3] == b"200"
