"""Who is let into a service, by its doors without credentials (NULL), with a token (PLAIN) and with keys (CURVE)."""

import socket as sockets
from contextlib import ExitStack, suppress

import pytest
import zmq
import zmq.auth
from zmq.utils.monitor import recv_monitor_message

from engine_bridge.service.control import control_socket
from engine_bridge.service.control.control_socket import request
from engine_bridge.service.control.requests import encode
from engine_bridge.service.security import endpoints as endpoints_module
from engine_bridge.service.security import guard as guard_module
from engine_bridge.service.security.credentials import make_curve_keys
from engine_bridge.service.security.endpoints import Endpoint
from engine_bridge.service.security.guard import SETTLED_SECONDS, ZAP_ADDRESS, Guard, _Connections
from puppetline.errors import ServiceError

from ...refusals import refused

TOKEN = "Zp3-sYd_0123456789"
REFUSED = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
DECIDED = zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_DISCONNECTED
CURVE = '[network.curve]\nport = 0\nkey_file = "service.key_secret"\nclients_folder = "clients"\n'


@pytest.fixture
def keys(tmp_path):
    """The keys of the service, of a client that it knows, and of a stranger, by name: public and secret."""
    (tmp_path / "clients").mkdir(mode=0o700)
    paths = [tmp_path / f"{path}.key_secret" for path in ("service", "stranger", "clients/laptop")]
    for path in paths:
        make_curve_keys(path)
    return {path.stem: zmq.auth.load_certificate(path) for path in paths}


@pytest.fixture
def house(play_file, keys, monkeypatch):
    """Play a service with some doors; one with keys, on this machine, has another one beside."""

    def start(*doors, limit=64):
        if "PLAIN" in doors:
            monkeypatch.setenv("PUPPETLINE_TOKEN", TOKEN)
        return play_file(f"max_clients = {limit}\n" + CURVE * ("CURVE" in doors))

    return start


def addresses(house, door):
    """Return the stream's and the control socket's address of a door."""
    number = -1 if door == "CURVE" else 0
    return house.service.stream[number], house.service.control.endpoints[number]


@pytest.fixture
def visit(context, keys):
    """Connect a subscriber; return what the handshake came to, if it is one of some events, and the subscriber."""
    here = []

    def come(house, door, mechanism=None, token=TOKEN, key="laptop", service="service", events=DECIDED):
        client = context.socket(zmq.SUB)
        here.append(client)  # or it would leave when the test forgets it
        client.subscribe(b"")
        mechanism = door if mechanism is None else mechanism
        if mechanism == "PLAIN":
            client.plain_username, client.plain_password = b"anybody", token.encode()
        elif mechanism == "CURVE":
            client.curve_publickey, client.curve_secretkey = keys[key]
            client.curve_serverkey = keys[service][0]
        monitor = client.get_monitor_socket(events)
        client.connect(addresses(house, door)[0])
        house.wait(lambda: monitor.poll(0))
        event = recv_monitor_message(monitor)["event"]
        client.disable_monitor()
        monitor.close()
        return event == zmq.EVENT_HANDSHAKE_SUCCEEDED, client

    return come


def hear(house, client):
    """Let time pass until a client hears the stream."""
    while not client.poll(10):
        house.next_frame()


@pytest.fixture
def assert_served(visit):
    """Fail unless a good client comes in by a door and hears the stream."""

    def check(house, door):
        let_in, client = visit(house, door)
        assert let_in
        hear(house, client)
        client.close(0)

    return check


STRANGERS = {
    "PLAIN": [{"token": "another-token-of-that-length"}, {"mechanism": "NULL"}, {"mechanism": "CURVE"}],
    "CURVE": [
        *({"key": "stranger"}, {"key": "service"}, {"service": "stranger"}),
        *({"mechanism": "PLAIN"}, {"mechanism": "NULL"}),
    ],
    "NULL": [{"mechanism": "PLAIN"}, {"mechanism": "CURVE"}],
}


@pytest.mark.parametrize("door", STRANGERS)
def test_a_client_without_credentials_is_refused_and_the_next_is_served(house, visit, assert_served, door):
    opened = house(door)
    for stranger in STRANGERS[door]:
        let_in, client = visit(opened, door, **stranger)
        assert not let_in, stranger
        assert_served(opened, door)
        assert not client.poll(0), stranger


def test_the_control_socket_has_the_same_lock_and_refusals_are_logged_without_secrets(house, caplog):
    opened = house("PLAIN")
    _, control = addresses(opened, "PLAIN")
    for token in ("a-wrong-one-that-is-private", None):
        told = opened.beside(refused, ServiceError, request, control, "ping", token=token)
        assert told.where == control
        assert TOKEN not in str(told)
    assert opened.beside(request, control, "ping", token=TOKEN) == "pong"
    first = next(each for each in caplog.records if each.name == guard_module.__name__)
    assert first.fields == {"reason": "wrong credentials", "address": "127.0.0.1"}
    opened.wait(lambda: opened.service._guard.refused >= 2)
    assert "private" not in caplog.text
    assert TOKEN not in caplog.text


def test_a_request_that_is_late_is_told_that_it_was_refused_before(house, monkeypatch):
    """It is encoded when the client's socket no longer has a connection to send it to."""
    opened = house("PLAIN")
    clients, monitor_of = [], zmq.Socket.get_monitor_socket

    def monitored(socket, events):
        clients.append(socket)
        return monitor_of(socket, events)

    def late(*request):
        while clients[-1].poll(0, zmq.POLLOUT):
            pass
        return encode(*request)

    monkeypatch.setattr(zmq.Socket, "get_monitor_socket", monitored)
    monkeypatch.setattr(control_socket, "encode", late)
    address = addresses(opened, "PLAIN")[1]
    told = opened.beside(refused, ServiceError, request, address, "ping", token="a-wrong-one-that-is-private")
    assert told.found == "a service that refuses this client"


GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01%b\x00" + bytes(31)


def greeting(mechanism):
    return GREETING % mechanism.encode().ljust(20, b"\0")


GARBAGE = [
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1:7400\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(64),
    bytes(range(256)) * 300,
    greeting("GSSAPI"),
    greeting("NULL") + b"\x06" + b"\xff" * 8,
    greeting("NULL") + b"\x04\x0e\x05READY\xff\xff\xff\xff\xff\xff\xff\xff",
    greeting("NULL") + b"\x04\x1a\x05READY\x0bSocket-Type\x00\x00\x00\x04PAIR",
    greeting("PLAIN") + b"\x04\x08\x05HELLO\xff\xff",
    greeting("CURVE") + b"\x04\xc8\x05HELLO" + bytes(194),
]


def connected(address):
    made = sockets.create_connection(("127.0.0.1", int(address.rpartition(":")[2])))
    made.setsockopt(sockets.IPPROTO_TCP, sockets.TCP_NODELAY, 1)
    return made


@pytest.mark.parametrize("doors", [["NULL"], ["PLAIN", "CURVE"]])
def test_garbage_ends_in_nothing_and_the_next_is_served(house, assert_served, doors):
    opened = house(*doors)
    for door in doors:
        for data in GARBAGE:
            with ExitStack() as left_open:
                for address in addresses(opened, door):
                    for pieces in ([data], [bytes([byte]) for byte in data[:80]]):
                        raw = left_open.enter_context(connected(address))
                        with suppress(ConnectionError):
                            for piece in pieces:
                                raw.sendall(piece)
                assert_served(opened, door)


@pytest.mark.parametrize(("door", "lengths"), [("NULL", (0, 63)), ("PLAIN", (10, 64)), ("CURVE", (64,))])
def test_handshakes_left_half_way_take_nobodys_place(house, assert_served, door, lengths):
    opened = house(door, limit=4)
    for length in lengths:
        with ExitStack() as left_open:
            for _ in range(30):
                left_open.enter_context(connected(addresses(opened, door)[0])).sendall(greeting(door)[:length])
            assert_served(opened, door)


def test_a_client_that_never_ends_the_handshake_is_disconnected_and_counted(house, monkeypatch, assert_served):
    monkeypatch.setattr(endpoints_module, "HANDSHAKE_SECONDS", 1.0)
    opened = house("PLAIN")
    with connected(addresses(opened, "PLAIN")[0]) as waiting:
        waiting.sendall(greeting("PLAIN"))
        while waiting.recv(4096):
            pass
    assert_served(opened, "PLAIN")
    opened.wait(lambda: opened.service._guard.refused == 1)


def test_who_has_no_room_waits_until_one_has_left_by_any_door(house, visit, monkeypatch):
    monkeypatch.setattr(endpoints_module, "HANDSHAKE_SECONDS", 1.0)  # one that is turned away tries again after it
    opened, guests = house("PLAIN", "CURVE", limit=2), []
    guard = opened.service._guard
    for door, has_room in (("PLAIN", True), ("CURVE", True), ("CURVE", False), ("PLAIN", False)):
        let_in, client = visit(opened, door)
        assert let_in == has_room
        guests.append(client)
    *members, _, late = guests
    assert guard.clients.connected == guard.clients.limit == 2
    assert guard.clients.refused >= 2
    for client in members:
        hear(opened, client)
    assert not late.poll(0)
    ping = opened.beside(request, addresses(opened, "PLAIN")[1], "ping", token=TOKEN)
    assert ping == "pong", "the control socket has room of its own"
    visit(opened, "PLAIN", token="a-wrong-one-of-a-stranger", events=REFUSED)  # who is told, but not of the room
    members.pop().close(0)
    hear(opened, late)  # there is room again, and nobody told it to try again


def test_the_place_of_who_left_is_free_at_once(house, visit):
    opened = house("NULL", limit=1)
    guard = opened.service._guard
    for _ in range(5):
        let_in, client = visit(opened, "NULL")
        assert let_in
        assert guard.clients.connected == 1
        assert guard.clients.refused == 0
        client.close(0)
        opened.wait(lambda: not guard.clients.connected)  # until its leaving has been noticed


def test_a_question_that_is_not_libzmqs_is_not_answered_or_refused(context):
    guard = Guard(context, [Endpoint("PLAIN", "", "", token=TOKEN.encode())], 1)
    good = [b"1.0", b"7", b"stream", b"127.0.0.1", b"", b"PLAIN", b"somebody", TOKEN.encode()]
    asking = context.socket(zmq.DEALER)
    asking.connect(ZAP_ADDRESS)
    for question, status in (
        ([b"1.0"], None),
        (good[:5], b"500"),
        ([b"2.0", *good[1:]], b"500"),
        ([*good[:2], b"global", *good[3:]], b"400"),
        ([*good[:7], b"plain"], b"400"),
        (good, b"200"),
    ):
        asking.send_multipart([b"", *question])
        guard.handle()
        if status is not None:
            assert asking.recv_multipart() == [b"", b"1.0", b"7", status, b"", b"", b""]
    assert not asking.poll(0)
    guard.close()


def test_a_crowd_counts_those_let_in_who_are_still_there():
    connections = _Connections()
    connections.opened = {("monitor", fd): 100.0 for fd in range(5)}
    connections.admitted.extend([100.2, 100.2])
    assert connections.count(100.3) == 2, "and three shake hands yet"
    connections.opened = {("monitor", 0): 100.0}
    assert connections.count(100.4) == 1, "one that was let in has gone"
    assert connections.count(100.4, undecided=1) == 0, "both have, and another one is at the door"
    assert connections.count(100.0 + 2 * SETTLED_SECONDS) == 1, "who stays is one that was let in"
    assert not connections.admitted
