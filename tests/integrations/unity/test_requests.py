"""Requests of the plain C# core over the real control socket."""

import json
import signal

import pytest


@pytest.fixture
def ask(start):
    """Send several requests together; return the replies in the order of arrival."""

    def run(port, *requests, token=""):
        program = start("Core", "request", "127.0.0.1", port, token)
        for request in requests:
            program.tell(json.dumps(request))
        return [each["reply"] for each in program.finish()]

    return run


def test_requests_are_answered_in_order_as_python_is_though_more_than_may_wait(figure, ask):
    """Arguments of every type arrive."""
    first, listed, mirrored, chosen, wrong, *others = ask(
        figure.control_port,
        {"do": "ping"},
        {"do": "list"},
        {"do": "mirror", "character": "blob", "on": False},
        {"do": "choose_user", "character": "blob", "user": None},
        {"do": "choose_user", "character": 'no "such\\ \n ünicörn', "user": 7},
        *[{"do": "ping"}] * 100,
    )
    assert first == {"id": 1, "ok": True, "result": "pong"}
    assert listed["result"] == figure.ask("list")
    assert (mirrored["ok"], mirrored["result"]["mirror"]) == (True, False)
    assert chosen["result"]["name"] == "blob"
    assert wrong["error"] == figure.ask("choose_user", character='no "such\\ \n ünicörn', user=7)
    assert others == [{"id": number, "ok": True, "result": "pong"} for number in range(6, 106)]


def test_without_a_service_or_with_a_wrong_token_there_is_an_error(ask, free_port, locked_figure, token_file):
    ports = free_port(), locked_figure.control_port
    for port, token in ((ports[0], ""), (ports[1], "wrong"), (ports[1], "")):
        (reply,) = ask(port, {"do": "ping"}, token=token)
        assert (reply["ok"], f"127.0.0.1:{port}" in reply["error"]["where"]) == (False, True), reply
        assert {"where", "found", "expected", "fix"} == reply["error"].keys()
    (reply,) = ask(ports[1], {"do": "ping"}, token=token_file.read_text())
    assert reply["result"] == "pong"


@pytest.mark.slow
def test_requests_of_a_service_that_is_gone_fail_and_later_ones_succeed(serve_figure, start):
    service = serve_figure()
    program = start("Core", "request", "127.0.0.1", service.port + 1, "")
    program.tell('{"do": "ping"}')
    assert program.until(lambda said: True)["reply"]["result"] == "pong"
    service.stop(signal.SIGKILL)
    program.tell('{"do": "ping"}')
    assert not program.until(lambda said: True, since=1)["reply"]["ok"]
    serve_figure(port=service.port)
    program.tell('{"do": "ping"}')
    assert program.until(lambda said: True, since=2)["reply"]["result"] == "pong"
    program.finish()
