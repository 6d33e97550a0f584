import json
import logging
import re
import shutil
import socket as sockets
import threading
import time
from pathlib import Path

import msgpack
import pytest
import zmq
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from engine_bridge.service.commands import ARGUMENTS
from engine_bridge.service.control import dispatcher as dispatcher_module
from engine_bridge.service.control.control_socket import Control, request
from engine_bridge.service.control.dispatcher import Deferred, Dispatcher
from engine_bridge.service.control.requests import Nothing
from engine_bridge.service.security.endpoints import NetworkSettings, endpoints_of
from engine_bridge.service.security.guard import Guard
from puppetline.errors import PuppetError, ServiceError

TIMEOUT_MS = 20_000
DOCUMENT = Path(__file__).parents[4] / "docs" / "control.md"


NO_DOG = PuppetError("dog.toml", found="a cat", expected="a dog", fix="Call the dog.")


class Office:
    """A control socket and a guard in a thread; commands tell what they were called with."""

    def __init__(self):
        self.context = zmq.Context()
        self.done = []
        self.deferred = []
        (self.endpoint,) = endpoints_of(NetworkSettings(port=0))
        self.guard = Guard(self.context, [self.endpoint], 64)
        commands = {name: (model, self._noted(name)) for name, model in ARGUMENTS.items()}
        self.dispatcher = Dispatcher(
            commands
            | {
                "ping": (Nothing, lambda _: "pong"),
                "reload": (Nothing, self._later),
                "finish": (Nothing, self._finish),
                "fail": (Nothing, self._fail),
                "refuse": (Nothing, self._refuse),
                "strange": (Nothing, lambda _: {"value": float("nan")}),
            }
        )
        self.control = Control(self.context, [self.endpoint], self.dispatcher)
        self.address = self.control.endpoints[0]
        self._finishing = False
        self._open = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _noted(self, name):
        def run(arguments):
            self.done.append((name, arguments.model_dump(exclude_unset=True)))
            return {"done": name}

        return run

    def _later(self, _):
        self.deferred.append(Deferred())
        return self.deferred[-1]

    def _finish(self, _):
        self._finishing = True  # in this turn of the loop, but after this

    def _fail(self, _):
        raise ZeroDivisionError("a mistake of ours, with /a/path")

    def _refuse(self, _):
        raise NO_DOG

    def _run(self):
        poller = zmq.Poller()
        for each in (*self.guard.sockets, *self.control.sockets):
            poller.register(each, zmq.POLLIN)
        while self._open:
            poller.poll(5)
            self.guard.handle()
            for each in self.control.sockets:
                self.control.handle(each)
            if self._finishing:
                for number, each in enumerate(self.deferred):
                    self.dispatcher.finish(each, NO_DOG if number % 2 else {"reloaded": number})
                self.deferred.clear()
                self._finishing = False

    def close(self):
        self._open = False
        self._thread.join()
        self.guard.close()
        self.control.close()
        self.context.term()


@pytest.fixture(scope="module")
def office():
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("PUPPETLINE_TOKEN", raising=False)
        opened = Office()
    yield opened
    opened.close()


@pytest.fixture
def dealer(context, office):
    with context.socket(zmq.DEALER) as client:
        client.connect(office.address)
        yield client


@pytest.fixture
def req(context, office):
    with context.socket(zmq.REQ) as client:
        client.connect(office.address)
        yield client


def heard(client):
    assert client.poll(TIMEOUT_MS)
    return client.recv_multipart()


def assert_well_formed(reply):
    assert reply.keys() == {"id", "ok", "result" if reply["ok"] else "error"}
    if not reply["ok"]:
        assert reply["error"].keys() == {"where", "found", "expected", "fix"}
        assert all(isinstance(text, str) and text for text in reply["error"].values())


@pytest.mark.parametrize("encoding", ["json", "msgpack"])
def test_every_command_gets_its_arguments_and_gives_its_result(office, encoding):
    asked = [
        ("list", {}),
        ("choose_user", {"character": "dog", "user": None}),
        ("set_handle", {"character": "dog", "handle": "left hand", "axes": "xy", "gain": 1.5}),
    ]
    office.done.clear()
    for do, arguments in asked:
        assert request(office.address, do, encoding=encoding, **arguments) == {"done": do}
    assert office.done == asked
    assert request(office.address, "ping", encoding=encoding) == "pong"


def test_req_and_dealer_are_answered_in_their_own_framing_and_encoding(dealer, req):
    values = {"do": "ping", "id": "№ 7"}
    for client, envelope in ((dealer, []), (req, [])):
        client.send(json.dumps(values).encode())
        *before, reply = heard(client)
        assert (before, json.loads(reply)) == (envelope, {"id": "№ 7", "ok": True, "result": "pong"})
        client.send(msgpack.packb(values))
        *before, reply = heard(client)
        assert (before, msgpack.unpackb(reply)) == (envelope, {"id": "№ 7", "ok": True, "result": "pong"})
    dealer.send_multipart([b"", json.dumps(values).encode()])
    empty, reply = heard(dealer)
    assert empty == b""
    assert json.loads(reply)["result"] == "pong"


def test_an_answer_may_come_later_and_nobody_waits_for_it(context, office):
    first, second, third = clients = [context.socket(zmq.REQ) for _ in range(3)]
    for client in clients:
        client.connect(office.address)
    for number, client in enumerate((first, second)):
        client.send_json({"do": "reload", "id": number})
        while len(office.deferred) <= number:  # requests of different clients come in any order
            time.sleep(0.001)
    third.send_json({"do": "ping"})
    assert json.loads(heard(third)[0])["result"] == "pong"
    assert not first.poll(0)
    third.send_json({"do": "finish"})
    heard(third)
    assert json.loads(heard(first)[0]) == {"id": 0, "ok": True, "result": {"reloaded": 0}}
    told = {"where": "dog.toml", "found": "a cat", "expected": "a dog", "fix": "Call the dog."}
    assert json.loads(heard(second)[0]) == {"id": 1, "ok": False, "error": told}
    for client in clients:
        client.close(0)


def test_a_client_that_left_before_its_answer_disturbs_no_other(office):
    with zmq.Context() as own, own.socket(zmq.DEALER) as client:
        client.linger = 0
        client.connect(office.address)
        client.send(b'{"do": "reload"}')
        client.send(b'{"do": "ping"}')
        heard(client)
    assert request(office.address, "finish") is None
    assert request(office.address, "ping") == "pong"
    assert not office.deferred


def test_no_more_answers_wait_than_there_is_room_for(dealer, monkeypatch):
    monkeypatch.setattr(dispatcher_module, "MAX_DEFERRED", 2)
    for number in (0, 1, 2):
        dealer.send_json({"do": "reload", "id": number})
    refused = dealer.recv_json()
    assert_well_formed(refused)
    assert (refused["id"], refused["error"]["found"]) == (2, "too many pending requests")
    dealer.send_json({"do": "finish", "id": 3})
    assert [dealer.recv_json()["id"] for _ in range(3)] == [3, 0, 1]


def test_a_refusal_is_told_to_the_client_in_its_own_words(office):
    with pytest.raises(ServiceError) as told:
        request(office.address, "refuse")
    assert str(told.value) == "dog.toml: found a cat; expected a dog. Call the dog."
    with pytest.raises(ServiceError) as told:
        request(office.address, "calibrate", charakter="dog", encoding="msgpack")
    assert str(told.value) == (
        "the request, charakter: found the unknown key 'charakter'; expected one of character. "
        "Did you mean 'character'?"
    )


@pytest.mark.parametrize("do", ["fail", "strange"])
def test_our_own_mistakes_are_logged_and_not_told(office, caplog, do):
    with pytest.raises(ServiceError, match="an internal error") as told:
        request(office.address, do)
    assert "path" not in str(told.value)
    (record,) = [each for each in caplog.records if each.name == dispatcher_module.__name__]
    assert record.levelno == logging.ERROR
    assert isinstance(record.exc_info[1], ZeroDivisionError if do == "fail" else ValueError)
    assert request(office.address, "ping") == "pong"


@pytest.mark.parametrize("parts", [[b"a", b"b"], [b"", b"", b"x"], [b'{"do": "ping"}'] * 500, [b""], [b"", b""]])
def test_parts_too_many_or_empty_get_one_error(dealer, parts):
    dealer.send_multipart(parts)
    *_, reply = heard(dealer)
    assert json.loads(reply)["ok"] is False
    dealer.send(b'{"do": "ping", "id": 9}')
    assert json.loads(heard(dealer)[-1]) == {"id": 9, "ok": True, "result": "pong"}


bodies = st.one_of(
    st.binary(max_size=300),
    st.text(max_size=100).map(lambda text: text.encode("utf-8", "surrogatepass")),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
        max_leaves=12,
    ).map(lambda value: json.dumps(value).encode()),
    st.fixed_dictionaries(
        {"do": st.sampled_from([*sorted(set(ARGUMENTS) - {"reload"}), "fail", "strange", "refuse"])},
        optional={
            "id": st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=70),
            "character": st.text(max_size=10) | st.integers(),
            "user": st.none() | st.integers() | st.floats(),
            "on": st.booleans() | st.text(max_size=3),
            "name": st.text(max_size=10),
        },
    ).map(lambda value: json.dumps(value).encode()),
    st.binary(max_size=100).map(lambda rest: b"\x82\xa2do\xa4ping\xa2id" + rest),
    st.binary(max_size=100).map(lambda rest: b"\xdf\x00\x00\x00\x02\xa2do" + rest),
)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(bodies, st.booleans())
def test_every_body_gets_one_well_formed_answer_and_the_next_request_works(dealer, req, body, framed):
    client = req if framed else dealer
    client.send(body)
    (reply,) = heard(client)
    binary = body[:1] and (0x80 <= body[0] <= 0x8F or body[0] in (0xDE, 0xDF))
    assert_well_formed((msgpack.unpackb if binary else json.loads)(reply))
    client.send(b'{"do": "ping", "id": 1}')
    assert json.loads(heard(client)[0]) == {"id": 1, "ok": True, "result": "pong"}


@pytest.mark.parametrize("size", [65_537, 131_072])
def test_a_request_that_is_too_large_is_told_so(dealer, size):
    dealer.send(b'{"do": "ping"}'.ljust(size))
    reply = json.loads(heard(dealer)[0])
    assert (reply["ok"], reply["error"]["found"]) == (False, f"{size} bytes")


def test_a_message_that_is_far_too_large_ends_the_connection_and_nothing_else(office, dealer):
    with zmq.Context() as own, own.socket(zmq.DEALER) as client:
        client.linger = 0
        monitor = client.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        client.connect(office.address)
        client.send(b" " * 131_073)
        assert monitor.poll(TIMEOUT_MS)
        client.disable_monitor()
        monitor.close()
    assert request(office.address, "ping") == "pong"


def test_a_client_that_never_reads_harms_nobody(office, context):
    with context.socket(zmq.DEALER) as deaf:
        deaf.rcvhwm = 1
        deaf.linger = 0
        deaf.connect(office.address)
        deaf.send_json({"do": "ping"})
        assert deaf.poll(TIMEOUT_MS)
        question = json.dumps({"do": "calibrate", "id": "i" * 64}).encode()
        for _ in range(20_000):
            try:
                deaf.send(question, zmq.NOBLOCK)
            except zmq.Again:
                break
        assert [request(office.address, "ping") for _ in range(3)] == ["pong"] * 3


def test_asking_where_nobody_is_ends_in_a_sentence():
    with sockets.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and does not listen
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(ServiceError, match=r"no answer within 0\.2 s"):
            request(address, "ping", timeout=0.2)
    for wrong in ("127.0.0.1:7401", "tcp://127.0.0.1", "tcp://:x", ""):
        with pytest.raises(ServiceError, match="no address"):
            request(wrong, "ping")
    with pytest.raises(ServiceError, match="a token of 0 characters"):
        request(address, "ping", token="")


@pytest.mark.parametrize(
    "answer", [b"", b"hello", b"[]", b'{"ok": false}', b'{"ok": true}', b'{"ok": false, "error": 1}']
)
def test_an_answer_of_something_else_is_said(context, answer):
    other = context.socket(zmq.ROUTER)
    other.bind("tcp://127.0.0.1:*")

    def reply():
        sender, _ = other.recv_multipart()
        other.send_multipart([sender, answer])

    thread = threading.Thread(target=reply)
    thread.start()
    with pytest.raises(ServiceError, match="an answer that is not understood"):
        request(other.last_endpoint.decode(), "ping")
    thread.join()
    other.close(0)


def test_a_port_that_is_taken_leaves_nothing_open():
    with zmq.Context() as context, context.socket(zmq.ROUTER) as other:
        other.bind("tcp://127.0.0.1:*")
        port = int(other.last_endpoint.rsplit(b":", 1)[1])
        with pytest.raises(zmq.ZMQError, match="in use"):
            Control(context, endpoints_of(NetworkSettings(port=port - 1)), Dispatcher({}))


def same_shape(left, right):
    """Whether two values of JSON have the same keys and types; lists by their first items."""
    if isinstance(left, dict) and isinstance(right, dict):
        return left.keys() == right.keys() and all(same_shape(left[key], right[key]) for key in left)
    if isinstance(left, list) and isinstance(right, list):
        return bool(left) == bool(right) and all(map(same_shape, left[:1], right[:1]))
    return type(left) is type(right)


def test_the_page_shows_what_the_service_says(play, blob_puppet):
    """docs/control.md: each block is a request or the reply to the one before."""
    dog = Path(shutil.copy(blob_puppet, blob_puppet.with_name("dog.toml")))
    service = play("--puppet", dog, "--source", "demo:bark?loop", "--calibrate", "at_once")
    service.run(1.0)
    assert service.frames[-1].state == "performing"
    blocks = re.findall(r"```json\n(.*?)\n```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) >= 20
    for body, shown in zip(blocks[::2], map(json.loads, blocks[1::2]), strict=True):
        replies = []
        service.service.dispatcher.take(body.encode(), replies.append, "json")
        reply = json.loads(service.until(lambda replies=replies: replies)[0])
        assert_well_formed(reply)
        assert reply == shown if not shown["ok"] else same_shape(reply, shown), (body, reply)
        assert reply["id"] == shown["id"]
        if "record_start" in body:
            service.run(1.0)  # so that the take has motion
