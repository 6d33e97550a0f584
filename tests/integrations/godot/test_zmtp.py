"""The addon's ZMTP connection with libzmq, with fragmented data, and with other programs on the port."""

import hashlib
import itertools
import random
import socket
from contextlib import suppress

import pytest
import zmq

from ..peers import AFTER_THE_HANDSHAKE, BEFORE_THE_HANDSHAKE, GREETING, MANY, READY, command, large

TOKEN = "a token for tests"


def seen(message):
    return {"size": len(message), "sha256": hashlib.sha256(message).hexdigest()}


def messages(results):
    return [result for result in results if "sha256" in result]


@pytest.fixture
def connect(start_godot):
    """Have Godot connect to a port of this machine."""

    def start(port, *topics, host="127.0.0.1", token="", largest=MANY, **more):
        return start_godot("connect.gd", host, port, "SUB", token, largest, *topics, **more)

    return start


def fails(script, state="FAILED", allow=()):
    """Wait for the end of a connection; return why it ended."""
    reason = script.until(lambda told: told.get("state") == state)["reason"]
    script.end(allow)
    return reason


@pytest.fixture
def context():
    with zmq.Context() as context:
        yield context


@pytest.fixture
def publisher(context):
    """A publisher of libzmq, and its port; options are set before it is bound."""

    def make(kind=zmq.XPUB, **options):
        socket = context.socket(kind)
        socket.linger = 0
        for name, value in options.items():
            setattr(socket, name, value)
        return socket, socket.bind_to_random_port("tcp://127.0.0.1")

    yield make
    context.destroy()


@pytest.fixture
def peer(answering):
    """Start a server that answers with a function and then only listens; return the port."""

    def start(answer):
        def whole(line):
            answer(line)
            line.shutdown(socket.SHUT_WR)
            line.settimeout(60)
            while line.recv(1 << 16):
                pass

        return answering(whole).port

    return start


def shake_hands(line):
    """Perform a publisher's part of the handshake; return the remaining received bytes."""
    line.sendall(GREETING + READY)
    come = b""
    while len(come) < 64 + 27:
        come += line.recv(1024)
    return come[64 + 27 :]


def subscriptions(publisher, count):
    return [publisher.recv() for _ in range(count)]


def test_topics_are_subscribed_to_and_messages_of_any_size_come_whole(connect, publisher):
    pub, port = publisher()
    script = connect(port, "dog/controls", "dog/vertices")
    assert subscriptions(pub, 2) == [b"\1dog/controls\0", b"\1dog/vertices\0"]
    sizes = 13, 255, 256, 65_535, 65_536, 3_000_000
    sent = [b"dog/controls\0", *(b"dog/vertices\0".ljust(size, random.randbytes(1)) for size in sizes)]
    for message in (*sent, b"dog/vertices16\0", b"cat/controls\0", b"dog/controls\0last"):
        pub.send(message)
    script.until(lambda told: told == seen(b"dog/controls\0last"))
    assert messages(script.end()) == [*map(seen, sent), seen(b"dog/controls\0last")]


def test_a_ping_gets_its_own_context_back(connect, peer):
    pongs = []

    def answer(line):
        shake_hands(line)
        for context in (b"", b"c", b"0123456789abcdef", b"longer than it may be"):
            line.sendall(command(b"\x04PING\0\x10" + context))
            pongs.append((command(b"\x04PONG" + context[:16]), line.recv(1024)))

    fails(connect(peer(answer)))
    assert len(pongs) == 4
    assert [wanted for wanted, _ in pongs] == [got for _, got in pongs]


def test_the_right_token_opens_and_a_wrong_one_is_refused_also_byte_by_byte(connect, locked_figure, token_file, line):
    script = connect(line(locked_figure.port).port, "service/characters", token=token_file.read_text())
    script.until(lambda told: told.get("size", 0) > 128)
    script.end()
    for wrong in ("another one", "", "x" * 256):
        fails(connect(locked_figure.port, token=wrong), "REFUSED")


def test_a_service_that_wants_keys_says_so(connect, publisher):
    if not zmq.has("curve"):
        pytest.skip("libzmq has no CURVE here")
    _, secret = zmq.curve_keypair()
    _, port = publisher(curve_server=True, curve_secretkey=secret)
    assert "CURVE" in fails(connect(port, token=TOKEN), "REFUSED")


def test_a_token_is_not_told_to_who_does_not_ask_for_it(connect, peer):
    come = []

    def answer(line):
        come.append(shake_hands(line))
        line.sendall(b"\0\0")

    script = connect(peer(answer), token=TOKEN)
    script.until(lambda told: told.get("size") == 0)
    fails(script)
    assert come == [b""]


def test_names_are_looked_up_and_the_one_with_four_numbers_is_taken(connect, publisher):
    pub, port = publisher()
    script = connect(port, "t", host="localhost")
    assert subscriptions(pub, 1) == [b"\1t\0"]
    script.end()
    assert "no.such.host.invalid" in fails(connect(port, host="no.such.host.invalid"))


def test_a_port_where_nobody_is(connect, free_port):
    for port in (free_port(), 0, 65536):
        assert str(port) in fails(connect(port))


@pytest.mark.parametrize("what", AFTER_THE_HANDSHAKE)
def test_a_frame_that_violates_zmtp_ends_the_connection(connect, peer, what):
    """What had come before is not lost. The peer does not close the line by itself."""

    def answer(line):
        shake_hands(line)
        line.sendall(b"\0\1!" + AFTER_THE_HANDSHAKE[what])
        line.recv(1)

    script = connect(peer(answer))
    fails(script)
    assert messages(script.results) == [seen(b"!")]


def test_commands_that_are_not_known_or_late_are_ignored(connect, peer):
    ignored = b"\xf0" + b"N" * 240, b"\1?data", b"\5READY", b"\7WELCOME", b"\5ERROR\x03400", b"\4PING\0"

    def answer(line):
        shake_hands(line)
        line.sendall(b"".join(map(command, ignored)) + b"\0\1!")

    script = connect(peer(answer))
    fails(script)
    assert messages(script.results) == [seen(b"!")]


@pytest.mark.parametrize("what", BEFORE_THE_HANDSHAKE)
def test_a_peer_that_is_no_service_is_recognised(connect, peer, what):
    fails(connect(peer(lambda line: line.sendall(BEFORE_THE_HANDSHAKE[what]) or line.recv(10))))


def test_an_error_is_a_refusal(connect, peer):
    fails(connect(peer(lambda line: line.sendall(GREETING + command(b"\5ERROR\x0bgo away now")))), "REFUSED")


@pytest.mark.parametrize("sent", [b"", GREETING], ids=["nothing", "a greeting"])
def test_a_silent_peer_is_given_up(connect, peer, given_clock, sent):
    def answer(line):
        line.sendall(sent)
        given_clock.turn(5.1)
        while line.recv(100):
            pass

    fails(connect(peer(answer), clock=given_clock))


def test_a_message_without_end_takes_no_more_memory_than_it_may(connect, peer):
    def answer(line):
        shake_hands(line)
        line.sendall(large(1 << 40))
        line.recv(1)

    fails(connect(peer(answer), largest=1_000_000))

    def endless(line):
        shake_hands(line)
        line.sendall(large(4_000_000))
        with suppress(OSError):
            for _ in range(4):
                line.sendall(bytes(999_999))

    script = connect(peer(endless), largest=4_000_000)
    fails(script)
    assert messages(script.results) == []
    assert script.results[-1]["memory"] < 100e6


def test_tiny_messages_in_their_thousands_are_all_taken(connect, peer):
    count = 60_000

    def answer(line):
        shake_hands(line)
        line.sendall(b"\0\0" * count + b"\0\1!")

    script = connect(peer(answer))
    script.until(lambda told: told == seen(b"!"))
    fails(script)
    assert len(messages(script.results)) == count + 1


def test_a_peer_that_never_reads_is_disconnected(connect, peer):
    """The peer sends pings and does not read the answers."""

    def answer(line):
        shake_hands(line)
        with suppress(OSError):
            for _ in itertools.repeat(None, 4000):
                line.sendall(command(b"\4PING\0\1" + b"c" * 16) * 1000)

    assert "does not read" in fails(connect(peer(answer)))
