"""The addon's connection over WebSocket, with the real service."""

import json

import pytest


@pytest.fixture
def connect(start_godot):
    """Have Godot connect to a WebSocket."""

    def start(address, *topics, token=""):
        return start_godot("connect.gd", address, 1, "SUB", token, 256 << 20, *topics)

    return start


@pytest.fixture
def web_service(serve, blob_puppet):
    """Start a service with a character, and return it with the address of its WebSocket."""

    def start(*more):
        played = ("--puppet", blob_puppet, "--source", "demo:walk?loop", "--calibrate", "at_once", *more)
        service = serve(*played, "--websocket", 0)
        return service, service.logged("serving")["fields"]["stream"][-1]

    return start


def fails(script, state):
    reason = script.until(lambda told: told.get("state") == state)["reason"]
    script.end()
    return reason


def test_a_token_is_sent_and_a_wrong_or_missing_one_is_final(connect, web_service, token_file):
    _, address = web_service("--token-file", token_file)
    script = connect(address, "service/characters", token=token_file.read_text())
    script.until(lambda told: "size" in told)
    script.end()
    for wrong in ("wrong", ""):
        assert address in fails(connect(address, token=wrong), "REFUSED")


def test_without_a_service_the_reason_says_so(connect, free_port):
    address = f"ws://127.0.0.1:{free_port()}/stream"
    assert address in fails(connect(address), "FAILED")


def test_requests_get_their_replies(start_godot, web_service):
    service, address = web_service()
    bodies = [{"do": "ping"}, {"do": "list"}, {"do": "mirror", "character": "cat", "on": True}]
    results = start_godot("request.gd", address, 1, "", *map(json.dumps, bodies)).finish()
    replies = {told["request"]["do"]: told["reply"] for told in results}
    assert replies["ping"]["result"] == "pong"
    assert replies["list"]["result"] == service.ask("list")
    assert replies["mirror"]["error"] == service.ask("mirror", character="cat", on=True)


def test_a_puppet_follows_a_websocket(start_godot, web_service, tmp_path):
    _, address = web_service()
    script = start_godot("watch_puppet.gd", json.dumps([{"host": address}]), tmp_path / "orders")
    script.until(lambda told: told.get("calibrated") and told["sequence"] >= 0 and told["visible"] == [True])
    script.end()
