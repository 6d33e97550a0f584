"""Requests of the addon and the replies of the real service, or the errors that replace missing replies."""

import json

import pytest
import zmq

from ..requests import Requests


@pytest.fixture
def request_of(start_godot):
    """Have Godot make requests to a control socket on this machine."""

    def start(port, *bodies, token=""):
        return start_godot("request.gd", "127.0.0.1", port, token, *map(json.dumps, bodies))

    return start


class TestRequests(Requests):
    @pytest.fixture
    def ask(self, request_of):
        def run(port, *bodies, token=""):
            told = request_of(port, *bodies, token=token).finish()
            assert [each["request"] for each in told] == [*bodies]
            return [each["reply"] for each in told]

        return run


@pytest.fixture
def router():
    """A control socket that sends the replies of the test, in place of the service, and its port."""
    with zmq.Context() as context, context.socket(zmq.ROUTER) as router:
        router.linger = 0
        router.rcvtimeo = 60_000
        yield router, router.bind_to_random_port("tcp://127.0.0.1")


def test_replies_find_their_requests_in_any_order_and_others_are_ignored(request_of, router):
    router, port = router
    script = request_of(port, {"do": "a"}, {"do": "b"})
    origin, first = router.recv_multipart()
    _, second = router.recv_multipart()
    first, second = json.loads(first), json.loads(second)
    assert (first["do"], second["do"]) == ("a", "b")
    for nothing in (b"", b"no json", b"[1]", b'{"id": null, "ok": true}', b'{"id": 99, "ok": true}', b"\xff\xfe"):
        router.send_multipart([origin, nothing])
    router.send_multipart([origin, json.dumps({"id": first["id"], "ok": "yes"}).encode()])
    for request in (second, first):
        reply = {"id": request["id"], "ok": True, "result": request["do"]}
        router.send_multipart([origin, json.dumps(reply).encode()])
    results = script.finish(allow=["Unicode parsing error", "Invalid UTF-8"])
    assert [(told["request"]["do"], told["reply"]["result"]) for told in results] == [("b", "b"), ("a", "a")]


@pytest.mark.parametrize("how", ["close", "late", "give_up", "drop"])
def test_a_callback_may_end_all_requests(start_godot, free_port, how):
    port = free_port()
    *told, end = start_godot("leave_control.gd", port, how).finish()
    refused, late, over = f"127.0.0.1:{port}", "no reply", "It is over."
    expected = {"close": [refused], "late": [late], "give_up": [refused, over, over], "drop": [over] * 3}[how]
    for number, (each, wanted) in enumerate(zip(told, expected, strict=True)):
        assert (each["number"], wanted in each["found"]) == (number, True)
    assert not any(each["ok"] for each in told)
    assert end["waiting"] == 0
