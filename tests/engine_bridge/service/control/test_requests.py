import json

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_bridge.service.commands import ARGUMENTS
from engine_bridge.service.control.requests import (
    MAX_REQUEST_BYTES,
    decode,
    encode,
    encoding_of,
    error_reply,
    take_command,
    take_id,
)
from puppetline import toml_schema
from puppetline.errors import ServiceError

from ...refusals import refused


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[" * 60_000,
        b'{"do": "ping"} {"do": "ping"}',
        b'{"do": ["ping"]}',
        b'{"a": ' + b"9" * 5000 + b"}",
        b'{"do": "\xff"}',
        b'{"do": "ping"}' + b" " * MAX_REQUEST_BYTES,
        json.dumps(dict.fromkeys(map(str, range(17)), 1)).encode(),
        msgpack.packb({"do": "ping"}) + b"\0",
        msgpack.packb({"do": ["ping"]}),
        msgpack.packb({b"do": "ping"}),
        msgpack.packb(dict.fromkeys(map(str, range(17)), 1)),
        msgpack.packb({"do": msgpack.ExtType(5, b"ping")}),
        b"\x81\xa2do" * 10_000,
    ],
    ids=range(14),
)
def test_anything_else_is_refused_in_a_sentence(body):
    told = refused(ServiceError, decode, body, encoding_of(body))
    assert told.where == "the request"
    assert len(str(told)) < 400


def test_an_id_comes_back_as_it_is_and_a_strange_one_is_refused():
    for good in (None, -(2**63), 2**64 - 1, "", "a" * 64, "№ 7"):
        values = {"id": good, "do": "ping"}
        assert take_id(values) == good
        assert values == {"do": "ping"}
    for bad in (True, 1.0, 2**64, -(2**63) - 1, "a" * 65, "\n"):
        assert refused(ServiceError, take_id, {"id": bad}).where == "the request, id"


def test_an_unknown_command_is_told_what_it_may_have_meant():
    assert take_command({"do": "reload"}, ARGUMENTS) == "reload"
    told = refused(ServiceError, take_command, {"do": "calibrat"}, ARGUMENTS)
    assert told.fix == "Did you mean 'calibrate'?"
    assert all(name in told.expected for name in ARGUMENTS)
    for strange in (None, 1, "x" * 60_000):
        refused(ServiceError, take_command, {"do": strange}, ARGUMENTS)


NOT_NAMES = ["", "..", "../dog", "a/b", "a\\b", "dog.toml", "dog\n", "dog\0", "a" * 65, "hünd", " dog", "C:"]
NAMED = ("calibrate", "character"), ("record_start", "name"), ("record_start", "stage")
REFUSED = """
ping         now       {"now": 1}
calibrate    character {}
choose_user  user      {"character": "dog"}
choose_user  user      {"character": "dog", "user": -1}
choose_user  user      {"character": "dog", "user": 2147483648}
choose_user  user      {"character": "dog", "user": 1.0}
choose_user  user      {"character": "dog", "user": "1"}
choose_user  user      {"character": "dog", "user": true}
mirror       on        {"character": "dog", "on": 1}
mirror       on        {"character": "dog", "on": "true"}
mirror       on        {"character": "dog", "on": null}
record_start stage     {"stage": "a/b"}
set_handle   handle    {"character": "dog", "joints": "head"}
set_handle   handle    {"character": "dog", "handle": ""}
set_handle   joints    {"character": "dog", "handle": "tail", "joints": "tail"}
set_handle   joints    {"character": "dog", "handle": "tail", "joints": "head,spine"}
set_handle   joints    {"character": "dog", "handle": "tail", "joints": 1}
set_handle   axes      {"character": "dog", "handle": "tail", "axes": "zyx"}
set_handle   axes      {"character": "dog", "handle": "tail", "axes": "xx"}
set_handle   axes      {"character": "dog", "handle": "tail", "axes": "X"}
set_handle   axes      {"character": "dog", "handle": "tail", "axes": null}
set_handle   gain      {"character": "dog", "handle": "tail", "gain": NaN}
set_handle   gain      {"character": "dog", "handle": "tail", "gain": Infinity}
set_handle   gain      {"character": "dog", "handle": "tail", "gain": 2e9}
set_handle   gain      {"character": "dog", "handle": "tail", "gain": "1"}
set_handle   gain      {"character": "dog", "handle": "tail", "gain": true}
set_root     joint     {"character": "dog"}
set_root     joint     {"character": "dog", "joint": "tail"}
set_scale    scale     {"character": "dog", "scale": 0}
set_scale    scale     {"character": "dog", "scale": -1}
set_scale    scale     {"character": "dog", "scale": "big"}
set_scale    scale     {"character": "dog", "scale": null}
set_scale    scale     {"character": "dog", "scale": true}
"""
"""Commands, the argument that is wrong, and all arguments."""


def test_other_arguments_are_refused_by_name():
    lines = [line.split(maxsplit=2) for line in REFUSED.strip().splitlines()]
    requests = [(do, field, json.loads(arguments)) for do, field, arguments in lines]
    requests += [(do, key, {key: name}) for do, key in NAMED for name in NOT_NAMES]
    requests.append(("set_handle", "joints", {"character": "dog", "handle": "tail", "joints": "head " * 21}))
    for do, field, arguments in requests:
        told = refused(ServiceError, toml_schema.check, ARGUMENTS[do], arguments, "the request", ServiceError)
        assert told.where == f"the request, {field}", (do, arguments)


@given(st.text(), st.text(), st.integers() | st.text(max_size=64))
def test_an_error_is_written_whatever_it_quotes(where, found, number):
    reply = error_reply(None, ServiceError(where, found=found * 50, expected=str(number), fix="Nothing."))
    assert set(reply["error"]) == {"where", "found", "expected", "fix"}
    assert all(len(text) <= 5000 for text in reply["error"].values())
    assert json.loads(encode(reply, "json")) == msgpack.unpackb(encode(reply, "msgpack")) == reply
