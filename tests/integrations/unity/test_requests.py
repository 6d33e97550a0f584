"""Requests of the plain C# core over the real control socket."""

import json
import signal

import pytest

from ..requests import Requests


@pytest.fixture
def ask(start):
    """Send several requests together; return the replies in the order of arrival."""

    def run(port, *requests, token=""):
        program = start("Core", "request", "127.0.0.1", port, token)
        for request in requests:
            program.tell(json.dumps(request))
        return [each["reply"] for each in program.finish()]

    return run


class TestRequests(Requests):
    pass


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
