import itertools
import json

import aiohttp
import pytest
from aiohttp import WSCloseCode

from engine_bridge.studio.backend.studio import Studio
from engine_bridge.studio.messages.connection import CloseCode, Greeting
from engine_bridge.studio.messages.requests import REQUESTS
from engine_bridge.studio.messages.state import State
from engine_bridge.studio.web import api_connection
from engine_bridge.studio.web.api_connection import MAX_MISTAKES

from ...service.security.test_web_sockets import sizes_of_floods
from ..conftest import connected, received


@pytest.mark.parametrize(
    "frame", ["", "token", "{}", '{"token": 3}', "[]", "null", "[" * 100_000, b"\0\1", '{"do": "ping", "id": 1}']
)
def test_a_client_without_a_token_is_disconnected(studio, frame):
    assert studio.closed_with("/api", frame) == CloseCode.NOT_UNDERSTOOD


def test_a_wrong_token_and_a_replayed_one_are_refused(studio, caplog):
    token = studio.token()
    session = studio.run(studio.enter(token))["session"]
    for refused in (token, "wrong"):
        assert studio.closed_with("/api", json.dumps({"token": refused})) == CloseCode.REFUSED
    assert not any(secret in caplog.text for secret in (token, session))
    address = studio.result("invite")["address"]
    assert studio.run(studio.enter(address.partition("#token=")[2]))["session"] not in (session, studio.session)


@pytest.mark.slow
def test_clients_that_send_without_a_token_leave_nothing_in_memory(studio, monkeypatch):
    monkeypatch.setattr(api_connection, "CLOSE_SECONDS", 0.02)
    sizes, kept = studio.run(sizes_of_floods(studio.served.port, "/api"))
    assert kept == 0
    assert max(sizes[1:]) - sizes[0] < 5e6


def test_the_stream_accepts_session_tokens_only(studio):
    assert studio.closed_with("/stream", json.dumps({"token": studio.token()})) == CloseCode.REFUSED
    assert studio.closed_with("/stream", json.dumps({"token": studio.session})) == CloseCode.NO_SERVICE


def test_the_greeting_is_followed_by_the_whole_state(studio):
    async def first():
        async with connected(studio.address, studio.session) as socket:
            frames = [await socket.receive_json() for _ in range(2)]
            studio.served.studio.changed()
            return *frames, await received(socket, lambda frame: "state" in frame)

    hello, state, again = studio.run(first())
    assert again == state
    hello, state = hello["hello"], state["state"]
    assert Greeting.model_validate(hello).parents["head"] == "shoulder_center"
    assert ".glb" in hello["suffixes"]["character"]
    assert State.model_validate(state).characters == []
    assert state["banner"]["text"] == "No character is open."


def test_a_page_whose_state_cannot_be_sent_is_disconnected_instead_of_showing_an_old_one(studio, monkeypatch):
    hello = json.dumps({"token": studio.session})
    monkeypatch.setattr(Studio, "state", property(lambda _: {}["a stage that has just gone"]))
    assert studio.closed_with("/api", hello) == WSCloseCode.ABNORMAL_CLOSURE


def asked(studio, request):
    """Return the reply to a request."""

    async def ask():
        async with connected(studio.address, studio.session) as socket:
            await socket.send_json(request)
            return await received(socket, lambda frame: "id" in frame)

    return studio.run(ask())


@pytest.mark.parametrize(
    ("request_", "key"),
    [
        ({}, "do"),
        ({"do": ["ping"]}, "do"),
        ({"do": "__class__"}, "do"),
        ({"do": "ping", "path": "/etc"}, "path"),
        ({"do": "puppet", "character": "../x"}, "character"),
        ({"do": "puppet", "character": "dog"}, "character"),
        ({"do": "open_character", "upload": "x"}, "upload"),
        ({"do": "open_example", "name": "cat"}, "name"),
        ({"do": "source"}, None),
        ({"do": "source", "uri": "osc:7110", "example": "walk"}, None),
        ({"do": "source", "uri": "replay:/etc/passwd"}, "uri"),
        ({"do": "source", "uri": "openni:file=/etc/passwd"}, "uri"),
        ({"do": "source", "uri": "fused:/etc/x.toml"}, "uri"),
        ({"do": "source", "take": "nothing"}, "take"),
        ({"do": "cancel", "job": "x"}, "job"),
    ],
)
def test_a_request_that_cannot_be_carried_out_is_explained(studio, request_, key):
    reply = asked(studio, {"id": 7, **request_})
    assert reply["ok"] is False
    assert reply["error"]["where"] == "the request" + (f", {key}" if key else "")
    assert all(reply["error"].values())


def test_a_recording_needs_a_character(studio):
    assert studio.error("record_stop")["found"] == "no character"


def test_every_request_is_carried_out_by_something(studio):
    made = studio.served.studio
    assert [do for do in REQUESTS if not callable(getattr(made, f"_do_{do}", None))] == []
    assert all("Result" in str(each.__doc__) for each in REQUESTS.values())


def test_a_request_is_answered_with_its_number(studio):
    assert asked(studio, {"id": 3, "do": "ping"}) == {"id": 3, "ok": True, "result": "pong"}


def test_many_frames_that_are_no_requests_and_one_that_is_too_large_end_the_connection(studio):
    hello = json.dumps({"token": studio.session})
    wrong = itertools.cycle(["?", b"\0\1", "[]", '{"do": "ping"}', '{"id": "x"}', '{"id": true}', "[" * 100_000])
    frames = itertools.islice(wrong, MAX_MISTAKES)
    assert studio.closed_with("/api", hello, *frames) == CloseCode.NOT_UNDERSTOOD
    assert studio.closed_with("/api", hello, "x" * 2_000_000) == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
