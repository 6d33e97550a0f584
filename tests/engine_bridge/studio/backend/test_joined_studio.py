"""A studio that joins a service which runs already: `puppetline studio --service`, and `puppetline serve --studio`."""

import asyncio
import re
import subprocess
from contextlib import asynccontextmanager

import aiohttp
import pytest

from engine_bridge.service.protocol.payloads import decode

from ...service.conftest import free_port, serve, serve_module

__all__ = ["free_port", "serve", "serve_module"]

pytestmark = pytest.mark.slow

TOKEN = "the-token-of-the-service"


@pytest.fixture(scope="module")
def service(serve_module, blob_puppet, free_port):
    """A service with a token and one character."""
    performing = ("--source", "demo:bark?loop", "--calibrate", "at_once")
    arguments = ("--puppet", blob_puppet, *performing, "--port", free_port())
    return serve_module(*arguments, env={"PUPPETLINE_TOKEN": TOKEN})


@pytest.fixture(scope="module")
def joined(service, start_studio, tmp_path_factory):
    """A studio that has joined it."""
    address = service.stream.removeprefix("tcp://")
    unused = tmp_path_factory.mktemp("joined") / "unused"
    running = start_studio(unused, service=address, service_token=TOKEN)
    running.until(lambda state: state["characters"])
    yield running
    running.close()
    assert not unused.exists()


@asynccontextmanager
async def stream_of(studio):
    """Connect to the stream."""
    address = f"{studio.address}/stream"
    async with aiohttp.ClientSession() as http, http.ws_connect(address, max_msg_size=0) as socket:
        await socket.send_json({"token": studio._session})
        yield socket


async def streamed(studio, *topics):
    """Return the first message of each topic."""
    received = {}
    async with asyncio.timeout(60), stream_of(studio) as socket:
        for topic in topics:
            await socket.send_json({"subscribe": topic})
        async for frame in socket:
            if frame.type == aiohttp.WSMsgType.BINARY:
                message = decode(frame.data)
                received[message.topic] = message
            if len(received) == len(topics):
                return received
    raise AssertionError(received)


def test_the_state_is_that_of_the_service(joined, service):
    state = joined.until(lambda state: state["performers"])
    (character,) = state["characters"]
    assert (character["name"], character["model"], character["stage"]) == ("blob", "", "stage")
    assert character["handles"] == ["left hand", "right hand", "head", "left foot", "right foot"]
    assert state["source"]["text"] == "demo:bark?loop"
    assert state["service"]["running"]
    assert state["service"]["address"] == service.control
    assert joined.session
    assert joined.run(hello(joined))["joined"] is True


async def hello(studio):
    async with studio.page(studio._session) as page:
        return page.hello


def test_the_stream_is_passed_through_byte_for_byte(joined):
    assert joined.session
    received = joined.run(streamed(joined, "blob/scene/mine", "blob/controls", "blob/joints"))
    revision = received["blob/scene/mine"].header.revision
    assert received["blob/controls"].header.revision == revision
    assert received["blob/controls"].body.shape == (30, 3, 4)


def test_a_text_that_is_no_subscription_is_answered_and_the_stream_goes_on(joined):
    async def ask():
        async with stream_of(joined) as socket:
            await socket.send_json({"do": "reload"})
            refusal = await socket.receive_json()
            await socket.send_json({"subscribe": "blob/controls"})
            return refusal, decode((await socket.receive()).data).topic

    assert joined.session
    refusal, topic = joined.run(ask())
    assert (refusal["ok"], refusal["error"]["fix"]) == (False, "Send requests to /api.")
    assert topic == "blob/controls"


def test_a_handle_is_mapped_saved_and_reverted(joined, service):
    before = joined.result("puppet", character="blob")["puppet"]
    after = joined.result("puppet", character="blob")["puppet"]
    after["handle"][0] |= {"joint": "head", "gain": 2.0}
    after["root"] = None
    reply = joined.result("edit", character="blob", puppet=after)
    assert (reply["puppet"], reply["saved"]) == (after, False)
    mapping = service.ask("puppet", token=TOKEN.encode(), character="blob")
    assert mapping["handles"][0]["joints"] == ["head"]
    assert mapping["root"] is None
    joined.until(lambda state: not state["characters"][0]["saved"])
    assert joined.result("revert_puppet", character="blob")["puppet"] == before
    assert joined.result("save_puppet", character="blob") == {"character": "blob", "name": "", "file": ""}


def test_changes_by_others_reach_the_page(joined, service):
    (before,) = joined.state["characters"]
    service.ask("set_scale", token=TOKEN.encode(), character="blob", scale=1.25)
    joined.until(lambda state: state["characters"][0]["version"] != before["version"])
    assert joined.result("puppet", character="blob")["puppet"]["retarget"]["scale"] == 1.25
    joined.result("revert_puppet", character="blob")


def test_what_needs_the_services_files_is_refused(joined):
    assert joined.error("open_example", name="human")["found"] == "a service that was started elsewhere"
    assert joined.error("source", example="walk")["found"] == "a service that was started elsewhere"
    status, reply = joined.upload("dog.obj", b"v 0 0 0\n")
    assert (status, reply["error"]["found"]) == (400, "a service that was started elsewhere")
    puppet = joined.result("puppet", character="blob")["puppet"]
    assert joined.error("edit", character="blob", puppet=puppet | {"handle": []})["where"] == "the puppet"


def test_requests_are_passed_on(joined):
    joined.result("calibrate", character="blob")
    joined.result("mirror", character="blob", on=True)
    joined.until(lambda state: state["characters"][0]["mirror"])
    joined.result("mirror", character="blob", on=False)
    assert joined.error("choose_user", character="blob", user=77)["found"] == "no user 77 in view of the sensor"
    joined.until(lambda state: state["performers"])
    (performer,) = joined.result("look")["performers"]
    assert performer["user"] == 1
    assert joined.result(
        "smoothing_preview", alpha=0.6, gamma=0.5, jitter_radius=0.05, max_deviation=None, prediction=0
    )


def test_a_take_is_recorded_on_the_services_machine(joined):
    take = joined.result("record_start", name="evening")["take"]
    joined.until(lambda state: state["recording"] == take)
    assert joined.result("record_stop")["name"] == "evening"
    assert [each["name"] for each in joined.state["takes"]] == ["evening"]


def test_takes_of_the_service_are_stopped_there(joined):
    assert joined.error("stop", character="cat")["found"] == "no character 'cat'"
    assert joined.result("stop") == {"stopped": []}


def test_the_page_continues_after_the_service_has_started_again(serve, start_studio, blob_puppet, free_port, tmp_path):
    port = free_port()
    arguments = ("--puppet", blob_puppet, "--source", "demo:bark?loop", "--port", port)
    first = serve(*arguments)
    studio = start_studio(tmp_path / "studio", service=f"127.0.0.1:{port}")
    studio.until(lambda state: state["characters"])
    first.process.kill()
    first.ended()
    lost = studio.until(lambda state: not state["service"]["running"])
    assert lost["banner"]["text"] == f"The service at 127.0.0.1:{port} does not answer."
    serve(*arguments)
    studio.until(lambda state: state["service"]["running"] and state["characters"])
    studio.close()


def test_serve_prints_the_address_of_the_page_and_ends_it(commands, blob_puppet, tmp_path, own_cache, free_port):
    given = ("--puppet", blob_puppet, "--source", "demo:walk?loop", "--port", free_port())
    arguments = (*given, "--no-announce", "--studio", 0)
    process = commands.start("serve", *arguments, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    line = process.stdout.readline()
    address, token = re.fullmatch(r"The studio is at (http://\S+)/#token=(\S+)\n", line).groups()

    async def enter():
        async with (
            aiohttp.ClientSession() as http,
            http.ws_connect(f"{address}/api", max_msg_size=0) as socket,
            asyncio.timeout(60),
        ):
            await socket.send_json({"token": token})
            greeting = (await socket.receive_json())["hello"]
            while not (state := (await socket.receive_json())["state"])["characters"]:
                pass
            return greeting["joined"], state["characters"][0]["name"]

    assert asyncio.run(enter()) == (True, "blob")
    process.terminate()
    assert process.wait() == 0
    with pytest.raises(OSError, match=r"Connect call failed|Cannot connect"):
        asyncio.run(enter())


def test_the_videos_of_a_kiosk_s_visitors_are_listed(joined, monkeypatch):
    service = joined.served.studio.service
    request = service.request
    listed = [{"code": "K7M2QX", "seconds_left": 541}, {"code": "ABCDEF", "seconds_left": None}]

    async def answered(do, **arguments):
        return {"clips": listed} if do == "clips" else await request(do, **arguments)

    monkeypatch.setattr(service, "request", answered)
    state = joined.until(lambda state: state["clips"])
    assert state["clips"] == [{"code": "K7M2QX", "minutes": 10}, {"code": "ABCDEF", "minutes": None}]
