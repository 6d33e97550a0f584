"""Requests of the plain C# core over the real control socket."""

import json

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


def test_a_request_is_answered_as_python_is(figure, ask):
    (ping,) = ask(figure.control_port, {"do": "ping"})
    assert ping == {"id": 1, "ok": True, "result": "pong"}
    (listed,) = ask(figure.control_port, {"do": "list"})
    assert listed["result"] == figure.ask("list")


def test_arguments_of_every_type_arrive(figure, ask):
    mirrored, chosen, wrong = ask(
        figure.control_port,
        {"do": "mirror", "character": "blob", "on": False},
        {"do": "choose_user", "character": "blob", "user": None},
        {"do": "choose_user", "character": 'no "such\\ \n ünicörn', "user": 7},
    )
    assert (mirrored["ok"], mirrored["result"]["mirror"]) == (True, False)
    assert chosen["result"]["name"] == "blob"
    assert wrong["error"] == figure.ask("choose_user", character='no "such\\ \n ünicörn', user=7)


def test_more_requests_than_may_wait_are_all_answered_in_order(figure, ask):
    replies = ask(figure.control_port, *({"do": "ping"} for _ in range(100)))
    assert [reply["id"] for reply in replies] == list(range(1, 101))
    assert {reply.get("result") for reply in replies} == {"pong"}


def test_a_take_is_recorded(figure, ask):
    (begun,) = ask(figure.control_port, {"do": "record_start", "name": "evening"})
    assert begun["result"]["take"] == "evening"
    (ended,) = ask(figure.control_port, {"do": "record_stop"})
    assert ended["result"]["bytes"] > 0


def test_without_a_service_there_is_an_error_that_says_so(ask, free_port):
    port = free_port()
    (reply,) = ask(port, {"do": "ping"})
    assert (reply["ok"], f"127.0.0.1:{port}" in reply["error"]["where"]) == (False, True)
    assert "Check that puppetline serve is running there" in reply["error"]["found"]
    assert {"where", "found", "expected", "fix"} == reply["error"].keys()


@pytest.mark.parametrize(("given", "found"), [("wrong", "does not accept the token"), ("", "token")])
def test_a_wrong_token_is_an_error_that_says_so(locked_figure, ask, token_file, given, found):
    (reply,) = ask(locked_figure.control_port, {"do": "ping"}, token=given)
    assert (reply["ok"], found in reply["error"]["found"]) == (False, True), reply
    (reply,) = ask(locked_figure.control_port, {"do": "ping"}, token=token_file.read_text())
    assert reply["result"] == "pong"


@pytest.mark.slow
def test_requests_of_a_service_that_is_gone_fail_and_later_ones_succeed(serve_figure, start):
    service = serve_figure()
    program = start("Core", "request", "127.0.0.1", service.port + 1, "")
    program.tell('{"do": "ping"}')
    assert program.until(lambda said: True)["reply"]["result"] == "pong"
    service.process.kill()
    service.ended()
    program.tell('{"do": "ping"}')
    assert not program.until(lambda said: True, since=1)["reply"]["ok"]
    serve_figure(port=service.port)
    program.tell('{"do": "ping"}')
    assert program.until(lambda said: True, since=2)["reply"]["result"] == "pong"
    program.finish()
