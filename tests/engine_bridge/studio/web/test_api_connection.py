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
    assert token not in caplog.text
    assert session not in caplog.text
    assert studio.run(studio.enter(session))["session"] == session
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
        async with studio.page() as page:
            return page.hello, await page.state()

    hello, state = studio.run(first())
    assert Greeting.model_validate(hello).parents["head"] == "shoulder_center"
    assert ".glb" in hello["suffixes"]["character"]
    assert State.model_validate(state).characters == []
    assert state["banner"]["text"] == "No character is open."


def test_a_page_whose_state_cannot_be_sent_is_disconnected_instead_of_showing_an_old_one(studio, monkeypatch):
    hello = json.dumps({"token": studio.session})
    monkeypatch.setattr(Studio, "state", property(lambda _: {}["a stage that has just gone"]))
    assert studio.closed_with("/api", hello) == WSCloseCode.ABNORMAL_CLOSURE


@pytest.mark.parametrize(
    ("request_", "where", "found"),
    [
        ({}, "the request, do", "nothing"),
        ({"do": ["ping"]}, "the request, do", "the unknown request ['ping']"),
        ({"do": "__class__"}, "the request, do", "the unknown request '__class__'"),
        ({"do": "ping", "path": "/etc"}, "the request, path", "the unknown key 'path'"),
        ({"do": "puppet", "character": "../x"}, "the request, character", "'../x'"),
        ({"do": "puppet", "character": "dog"}, "the request, character", "no character 'dog'"),
        ({"do": "open_character", "upload": "x"}, "the request, upload", "no upload 'x'"),
        ({"do": "open_example", "name": "cat"}, "the request, name", "the unknown name 'cat'"),
        ({"do": "source"}, "the request", "no source"),
        ({"do": "source", "uri": "osc:7110", "example": "walk"}, "the request", "uri and example"),
        ({"do": "source", "uri": "replay:/etc/passwd"}, "the request, uri", "'replay:/etc/passwd'"),
        ({"do": "source", "uri": "openni:file=/etc/passwd"}, "the request, uri", "'openni:file=/etc/passwd'"),
        ({"do": "source", "uri": "fused:/etc/x.toml"}, "the request, uri", "'fused:/etc/x.toml'"),
        ({"do": "source", "take": "nothing"}, "the request, take", "no take 'nothing'"),
        ({"do": "cancel", "job": "x"}, "the request, job", "no running job 'x'"),
        ({"do": "record_stop"}, "the service", "no character"),
    ],
)
def test_a_request_that_cannot_be_carried_out_is_explained(studio, request_, where, found):
    async def ask():
        async with studio.page() as page:
            return await page.send({"id": 7, **request_})

    reply = studio.run(ask())
    assert reply["ok"] is False
    assert (reply["error"]["where"], reply["error"]["found"]) == (where, found)
    assert reply["error"]["fix"]


def test_every_request_is_carried_out_by_something(studio):
    made = studio.served.studio
    assert [do for do in REQUESTS if not callable(getattr(made, f"_do_{do}", None))] == []
    assert all("Result" in str(each.__doc__) for each in REQUESTS.values())


def test_many_frames_that_are_no_requests_and_one_that_is_too_large_end_the_connection(studio):
    hello = json.dumps({"token": studio.session})
    wrong = itertools.cycle(["?", b"\0\1", "[]", '{"do": "ping"}', '{"id": "x"}', '{"id": true}', "[" * 100_000])
    frames = itertools.islice(wrong, MAX_MISTAKES)
    assert studio.closed_with("/api", hello, *frames) == CloseCode.NOT_UNDERSTOOD
    assert studio.result("ping") == "pong"
    assert studio.closed_with("/api", hello, "x" * 2_000_000) == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
