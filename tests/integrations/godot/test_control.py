"""Requests of the addon and the replies of the real service, or the errors that replace missing replies."""

import json

import pytest
import zmq

TOLD = {"where", "found", "expected", "fix"}


@pytest.fixture
def request_of(start_godot):
    """Have Godot make requests to a control socket on this machine."""

    def start(port, *bodies):
        return start_godot("request.gd", "127.0.0.1", port, "", *map(json.dumps, bodies))

    return start


def port_at(socket):
    return int(socket.last_endpoint.rpartition(b":")[2])


def replies(results):
    return [told["reply"] for told in results]


def test_each_request_gets_its_reply_in_its_order_though_more_wait_than_are_sent(request_of, serve, blob_puppet):
    service = serve("--puppet", blob_puppet, "--source", "osc:0")
    bodies = [
        {"do": "ping"},
        {"do": "list"},
        {"do": "mirror", "character": "blob", "on": True},
        {"do": "mirror", "character": "cat", "on": True},
        {"do": "ping", "id": "its own id is not used"},
        {"do": "pïng"},
        *({"do": "mirror", "character": "blob", "on": k % 3 == 0} for k in range(100)),
    ]
    results = request_of(service.control_port, *bodies).finish()
    assert [told["request"] for told in results] == bodies
    of = replies(results)
    assert [reply["ok"] for reply in of[:6]] == [True, True, True, False, True, False]
    assert [reply["result"]["mirror"] for reply in of[6:]] == [body["on"] for body in bodies[6:]]
    assert of[0]["result"] == of[4]["result"] == "pong"
    assert of[1]["result"] == service.ask("list")
    assert of[2]["result"]["mirror"] is True
    wrong = service.ask("mirror", character="cat", on=True)
    assert of[3]["error"] == wrong
    assert set(of[5]["error"]) == TOLD


def no_connection(port):
    return f"no connection (Cannot connect to 127.0.0.1:{port}. Check that the service is running)"


def test_without_a_service_every_request_is_told_so(request_of, free_port):
    port = free_port()
    told = replies(request_of(port, {"do": "ping"}, {"do": "list"}).finish())
    for reply in told:
        assert (reply["ok"], set(reply["error"])) == (False, TOLD)
        assert f"127.0.0.1:{port}" in reply["error"]["where"]


@pytest.fixture
def router():
    """A control socket that sends the replies of the test, in place of the service."""
    with zmq.Context() as context, context.socket(zmq.ROUTER) as router:
        router.linger = 0
        router.bind("tcp://127.0.0.1:*")
        router.rcvtimeo = 60_000
        yield router


def test_replies_find_their_requests_in_any_order_and_others_are_ignored(request_of, router):
    script = request_of(port_at(router), {"do": "a"}, {"do": "b"})
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
    refused, late = no_connection(port), "no reply within 5 s"
    over = "It is over."
    assert [(each["number"], each["found"]) for each in told] == {
        "close": [(0, refused)],
        "late": [(0, late)],
        "give_up": [(0, refused), (1, over), (2, over)],
        "drop": [(0, over), (1, over), (2, over)],
    }[how]
    assert not any(each["ok"] for each in told)
    assert end["waiting"] == 0
