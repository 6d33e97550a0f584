"""Requests: what becomes of each, and how they come to a whole service over ZeroMQ."""

import json
import logging
import re
import shutil
import socket as sockets
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from unittest.mock import Mock

import msgpack
import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_bridge.service.commands import ARGUMENTS
from engine_bridge.service.control import dispatcher as dispatcher_module
from engine_bridge.service.control.control_socket import request
from engine_bridge.service.control.dispatcher import Deferred, Dispatcher
from engine_bridge.service.control.requests import Nothing, encoding_of
from puppetline.errors import PuppetError, ServiceError

from ...refusals import refused

DOCUMENT = Path(__file__).parents[4] / "docs" / "control.md"
NO_DOG = PuppetError("dog.toml", found="a cat", expected="a dog", fix="Call the dog.")


class Desk:
    """A dispatcher whose commands return their arguments, now or later, or fail."""

    def __init__(self):
        self.deferred = []
        commands = {
            name: (model, lambda given: given.model_dump(exclude_unset=True)) for name, model in ARGUMENTS.items()
        }
        for name, run in (
            ("reload", self._later),
            ("fail", Mock(side_effect=ZeroDivisionError("a mistake of ours, with /a/path"))),
            ("refuse", Mock(side_effect=NO_DOG)),
            ("strange", Mock(return_value=float("nan"))),
        ):
            commands[name] = Nothing, run
        self.dispatcher = Dispatcher(commands)

    def _later(self, _):
        self.deferred.append(Deferred())
        return self.deferred[-1]

    def ask(self, body):
        """Return the list of replies to a request, which a dict is made one of."""
        replies, body = [], json.dumps(body).encode() if isinstance(body, dict) else body
        encoding = encoding_of(body)
        read = json.loads if encoding == "json" else msgpack.unpackb
        self.dispatcher.take(body, lambda reply: replies.append(read(reply)), encoding)
        return replies


def assert_well_formed(reply):
    assert reply.keys() == {"id", "ok", "result" if reply["ok"] else "error"}
    if not reply["ok"]:
        assert reply["error"].keys() == {"where", "found", "expected", "fix"}
        assert all(isinstance(text, str) and text for text in reply["error"].values())


def done(number, result):
    return [{"id": number, "ok": True, "result": result}]


def test_answers_may_come_later_as_many_as_there_is_room_for(monkeypatch):
    monkeypatch.setattr(dispatcher_module, "MAX_DEFERRED", 2)
    desk, asked = Desk(), {"character": "dog", "user": None}
    first, second, [busy] = (desk.ask({"do": "reload", "id": number}) for number in range(3))
    assert desk.ask({"do": "choose_user", "id": "№ 7"} | asked) == done("№ 7", asked)
    assert first == second == []
    assert_well_formed(busy)
    assert busy["id"] == 2
    assert busy["error"]["where"] == "the service"
    for deferred, outcome in zip(desk.deferred, ("done", NO_DOG, "nobody waits"), strict=True):
        desk.dispatcher.finish(deferred, outcome)
    assert first == done(0, "done")
    assert second == [{"id": 1, "ok": False, "error": NO_DOG.parts}]
    assert desk.ask({"do": "refuse"}) == [{"id": None, "ok": False, "error": NO_DOG.parts}]


@pytest.mark.parametrize(("do", "mistake"), [("fail", ZeroDivisionError), ("strange", ValueError)])
def test_our_own_mistakes_are_logged_and_not_told(caplog, do, mistake):
    [reply] = Desk().ask({"do": do})
    assert reply["error"] == dispatcher_module.FAILED.parts
    [record] = caplog.records
    assert record.levelno == logging.ERROR
    assert isinstance(record.exc_info[1], mistake)


BODIES = st.one_of(
    st.binary(max_size=300),
    st.fixed_dictionaries(
        {"do": st.sampled_from([*sorted(set(ARGUMENTS) - {"reload"}), "fail", "strange", "refuse"])},
        optional={
            "id": st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=70),
            "character": st.text(max_size=10) | st.integers(),
            "user": st.none() | st.integers() | st.floats(),
        },
    ).map(lambda value: json.dumps(value).encode()),
)


@settings(max_examples=200)
@given(BODIES)
def test_every_body_gets_one_well_formed_answer_and_the_next_request_works(body):
    desk = Desk()
    [reply] = desk.ask(body)
    assert_well_formed(reply)
    assert desk.ask({"do": "list", "id": 1}) == done(1, {})


@pytest.fixture
def service(play_file):
    """Play a service; `control` is the address of its control socket."""
    made = play_file()
    [made.control] = made.service.control.endpoints
    return made


@pytest.fixture
def connect(context, service):
    """Connect a socket to the control socket; return what sends message parts, and returns the reply's parts."""

    def to(kind, **options):
        client = context.socket(kind)
        for name, value in options.items():
            setattr(client, name, value)
        client.connect(service.control)

        def ask(*parts):
            client.send_multipart(parts)
            service.wait(lambda: client.poll(0))
            return client.recv_multipart()

        return client, ask

    return to


PING = b'{"do": "ping", "id": 9}'
PONG = {"id": 9, "ok": True, "result": "pong"}


def test_req_and_dealer_are_answered_in_their_own_framing_and_encoding(connect):
    _, ask = connect(zmq.REQ)
    [reply] = ask(PING)
    assert json.loads(reply) == PONG
    _, ask = connect(zmq.DEALER)
    for frame in ([], [b""]):
        *empty, reply = ask(*frame, PING)
        assert empty == frame
        assert json.loads(reply) == PONG
    for parts in ([b"a", b"b"], [b"", b"", b"x"], [PING] * 500, [b""], [b"", b""], [b" " * 65_537], [b" " * 131_072]):
        reply = json.loads(ask(*parts)[-1])
        assert_well_formed(reply)
        assert not reply["ok"]
    assert json.loads(ask(PING)[-1]) == PONG


@pytest.mark.parametrize("encoding", ["json", "msgpack"])
def test_a_program_asks_a_service_and_gets_its_result_or_its_error(service, encoding):
    def ask(do, **arguments):
        return service.beside(request, service.control, do, encoding=encoding, **arguments)

    assert ask("ping") == "pong"
    assert ask("list")["characters"] == ["dog"]
    assert ask("mirror", character="dog", on=True) == service.ask("mirror", character="dog", on=True)
    assert refused(ServiceError, ask, "calibrate", character="cat").where == "the request, character"


def test_clients_that_leave_say_far_too_much_or_never_read_harm_nobody(service, connect):
    def assert_answers():
        assert service.beside(request, service.control, "ping") == "pong"

    leaving, ask = connect(zmq.DEALER)
    leaving.send(b'{"do": "reload"}')
    ask(PING)
    leaving.close(0)
    service.run(1.0)
    assert_answers()
    verbose, _ = connect(zmq.DEALER)
    monitor = verbose.get_monitor_socket(zmq.EVENT_DISCONNECTED)
    verbose.send(b" " * 131_073)
    service.wait(lambda: monitor.poll(0))
    assert_answers()
    deaf, ask = connect(zmq.DEALER, rcvhwm=1)
    ask(PING)
    question, sent = json.dumps({"do": "calibrate", "id": "i" * 64}).encode(), []

    def all_sent():
        with suppress(zmq.Again):
            sent.extend(deaf.send(question, zmq.NOBLOCK) for _ in range(100))
        return len(sent) > 20_000

    service.wait(all_sent)
    assert_answers()


def test_asking_where_nobody_is_ends_in_a_sentence():
    def where(address, **more):
        return refused(ServiceError, request, address, "ping", **more).where

    with sockets.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and does not listen
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        assert where(address, timeout=0.2) == address
    for wrong in ("127.0.0.1:7401", "tcp://127.0.0.1", "tcp://:x", ""):
        assert where(wrong) == wrong
    assert where(address, token="") == "the token"


def test_an_answer_of_something_else_is_said(context):
    other = context.socket(zmq.ROUTER)
    address = f"tcp://127.0.0.1:{other.bind_to_random_port('tcp://127.0.0.1')}"
    with ThreadPoolExecutor() as threads:
        for answer in (b"", b"hello", b"[]", b'{"ok": false}', b'{"ok": true}', b'{"ok": false, "error": 1}'):
            told = threads.submit(refused, ServiceError, request, address, "ping")
            sender, _ = other.recv_multipart()
            other.send_multipart([sender, answer])
            assert told.result().where == address


def same_shape(left, right):
    """Whether two values of JSON have the same keys and types; lists by their first items. "…" stands for more keys."""
    if isinstance(left, dict) and isinstance(right, dict):
        shown = right.keys() - {"…"}
        same = left.keys() > shown if "…" in right else left.keys() == shown
        return same and all(same_shape(left[key], right[key]) for key in shown)
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
