"""A studio that joins a service which runs already: `puppetline studio --service`, and `puppetline serve --studio`."""

import asyncio
import copy
import re
import subprocess

import aiohttp
import psutil
import pytest

from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet_values import values_of
from engine_bridge.service.protocol.payloads import decode

from ...service.conftest import free_port, serve_module
from ..conftest import TIMEOUT_SECONDS, connected, received

__all__ = ["free_port", "serve_module"]

pytestmark = pytest.mark.slow

TOKEN = "the-token-of-the-service"


@pytest.fixture(scope="module")
def start(serve_module, blob_puppet, free_port):
    """Start a service with a token and one character, again and again at the same port."""
    performing = ("--source", "demo:bark?loop", "--calibrate", "at_once")
    arguments = ("--puppet", blob_puppet, *performing, "--port", free_port())
    return lambda: serve_module(*arguments, env={"PUPPETLINE_TOKEN": TOKEN})


@pytest.fixture(scope="module")
def service(start):
    return start()


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


def test_the_state_is_that_of_the_service(joined, service):
    state = joined.until(lambda state: state["performers"])
    (character,) = state["characters"]
    assert character == character | {
        "name": "blob",
        "model": "",
        "stage": "stage",
        "handles": ["left hand", "right hand", "head", "left foot", "right foot"],
    }
    assert (state["source"]["text"], joined.greeting["joined"]) == ("demo:bark?loop", True)
    assert (state["service"]["running"], state["service"]["address"]) == (True, service.control)


def test_the_stream_is_passed_through_and_a_text_that_is_no_subscription_is_answered(joined):
    async def receive():
        received = {}
        async with (
            aiohttp.ClientSession() as http,
            http.ws_connect(f"{joined.address}/stream", max_msg_size=0) as socket,
        ):
            await socket.send_json({"token": joined.session})
            await socket.send_json({"do": "reload"})
            refusal = await socket.receive_json()
            for topic in ("blob/scene/mine", "blob/controls"):
                await socket.send_json({"subscribe": topic})
            while len(received) < 2:
                message = decode((await socket.receive()).data)
                received[message.topic] = message
        return refusal, received

    refusal, received = joined.run(receive())
    assert (refusal["ok"], refusal["error"]["fix"]) == (False, "Send requests to /api.")
    assert received["blob/controls"].header.revision == received["blob/scene/mine"].header.revision
    assert received["blob/controls"].body.shape == (30, 3, 4)


def test_limbs_and_handles_are_edited_and_saved_and_changes_by_others_reach_the_page(joined, service, limbed_puppet):
    before = joined.result("puppet", character="blob")["puppet"]
    after = copy.deepcopy(before)
    after["handle"][0] |= {"joint": "head", "gain": 2.0}
    after["root"] = None
    reply = joined.result("edit", character="blob", puppet=after)
    assert (reply["puppet"], reply["saved"]) == (after, False)
    mapping = service.ask("puppet", token=TOKEN.encode(), character="blob")
    assert (mapping["handles"][0]["joints"], mapping["root"]) == (["head"], None)
    joined.until(lambda state: not state["characters"][0]["saved"])
    limbed = values_of(puppet_file.load(limbed_puppet)) | {"root": before["root"]}
    limbed["retarget"]["mirror"] = True
    assert joined.result("edit", character="blob", puppet=limbed)["puppet"] == limbed
    joined.until(lambda state: state["characters"][0]["limbs"] and state["characters"][0]["mirror"])
    assert joined.error("edit", character="blob", puppet=limbed | {"handle": 1})["where"] == "the puppet, handle"
    reply = joined.result("edit", character="blob", puppet=before)
    assert (reply["puppet"], reply["saved"]) == (before, True)
    assert joined.result("save_puppet", character="blob") == {"character": "blob", "name": "", "file": ""}
    version = joined.until(lambda state: state["characters"][0]["saved"])["characters"][0]["version"]
    service.ask("set_scale", token=TOKEN.encode(), character="blob", scale=1.25)
    joined.until(lambda state: state["characters"][0]["version"] != version)
    assert joined.result("puppet", character="blob")["puppet"]["retarget"]["scale"] == 1.25
    service.ask("revert_puppet", token=TOKEN.encode(), character="blob")


def test_what_needs_the_services_files_is_refused(joined):
    status, reply = joined.upload("dog.obj", b"v 0 0 0\n")
    errors = [joined.error("open_example", name="human"), joined.error("source", example="walk"), reply["error"]]
    assert status == 400
    assert [each["found"] for each in errors] == ["a service that was started elsewhere"] * 3


def test_requests_are_passed_on(joined):
    joined.result("calibrate", character="blob")
    assert joined.error("choose_user", character="blob", user=77)["found"] == "no user 77 in view of the sensor"
    joined.until(lambda state: state["performers"])
    assert [each["user"] for each in joined.result("look")["performers"]] == [1]
    assert joined.result(
        "smoothing_preview", alpha=0.6, gamma=0.5, jitter_radius=0.05, max_deviation=None, prediction=0
    )
    take = joined.result("record_start", name="evening")["take"]
    joined.until(lambda state: state["recording"] == take)
    assert joined.result("record_stop")["name"] == "evening"
    assert [each["name"] for each in joined.state["takes"]] == ["evening"]
    assert joined.error("stop", character="cat")["found"] == "no character 'cat'"
    assert joined.result("stop") == {"stopped": []}


def test_a_killed_service_takes_its_page_with_it_and_the_next_one_accepts_the_same_windows(
    commands, blob_puppet, tmp_path, free_port, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    given = ("--puppet", blob_puppet, "--source", "demo:walk?loop", "--port", free_port(), "--no-announce")

    def start():
        process = commands.start("serve", *given, "--studio", page, cwd=tmp_path, stdout=subprocess.PIPE)
        opened = re.fullmatch(r"The studio is at (http://\S+)/#token=(\S+)\n", process.stdout.readline())
        return process, opened.groups()

    async def enter(address, token):
        async with connected(address, token) as socket:
            hello = (await socket.receive_json())["hello"]
            frame = await received(socket, lambda frame: frame.get("state", {}).get("characters"))
            return hello, frame["state"]["characters"][0]["name"]

    page = free_port()
    process, opened = start()
    hello, name = asyncio.run(enter(*opened))
    assert (hello["joined"], name) == (True, "blob")
    children = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    assert not psutil.wait_procs(children, TIMEOUT_SECONDS)[1]
    process, (address, _) = start()
    assert asyncio.run(enter(address, hello["session"]))[1] == "blob"
    process.terminate()
    assert process.wait() == 0
