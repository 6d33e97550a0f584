"""`puppetline serve --websocket` as a process, with aiohttp's client."""

import asyncio
import json

import aiohttp
import numpy as np
import psutil
import pytest

from engine_bridge.service.protocol.header import PAYLOAD_OFFSET
from engine_bridge.service.protocol.payloads import decode

pytestmark = pytest.mark.slow

SECONDS = 60.0
"""Time after which a test fails, in seconds."""


@pytest.fixture
def playing(serve, blob_puppet):
    """Start a service with a character that moves; return it and the address of its WebSocket."""

    def start(*more):
        source = ("--source", "demo:walk?loop", "--calibrate", "at_once", "--websocket", "0")
        service = serve("--puppet", blob_puppet, *source, *more)
        return service, service.logged("serving")["fields"]["stream"][-1]

    return start


def with_client(address, talk, token=None):
    """Run a coroutine function with a connection that has authenticated."""

    async def run():
        async with aiohttp.ClientSession() as session, session.ws_connect(address, max_msg_size=0) as socket:
            await socket.send_json({} if token is None else {"token": token})
            return await asyncio.wait_for(talk(socket), SECONDS)

    return asyncio.run(run())


async def next_of(socket, topic):
    while True:
        message = await socket.receive_bytes()
        if message.startswith(topic.encode() + b"\0"):
            return message


def test_frames_are_byte_for_byte_those_of_zeromq_and_the_status_counts_them(playing):
    service, address = playing()
    kinds = ("controls", "vertices", "vertices16", "joints", "handles")
    beside = service.client(*(f"blob/{kind}" for kind in kinds))

    async def talk(socket):
        for kind in kinds:
            await socket.send_json({"subscribe": f"blob/{kind}"})
        found = [await socket.receive_bytes() for _ in range(100)]
        await socket.send_json({"subscribe": "service/status"})
        while True:
            status = json.loads((await next_of(socket, "service/status"))[PAYLOAD_OFFSET:])
            if status["outputs"][-1]["sent"] >= len(found):
                return found, status["outputs"][-1]

    beside.until(lambda _: True)
    over_web, output = with_client(address, talk)
    over_zeromq = set()
    while beside.socket.poll(200) and len(over_zeromq) < 2000:
        over_zeromq.add(beside.socket.recv())
    assert {decode(each).topic for each in over_web} == {f"blob/{kind}" for kind in kinds}
    assert set(over_web) <= over_zeromq
    assert (output["wire"], output["target"], output["clients"]) == ("websocket", address, 1)


def test_a_reload_from_a_web_page_reaches_its_subscribers(playing):
    _, address = playing()

    async def talk(socket):
        await socket.send_json({"do": "reload", "id": "again"})
        return json.loads(await socket.receive_str())

    assert with_client(address, talk) == {"id": "again", "ok": True, "result": {"characters": ["blob"]}}


def test_a_token_file_is_the_token_of_both_wires(playing, tmp_path):
    path = tmp_path / "token"
    path.write_text("correct-horse-battery-staple")
    path.chmod(0o600)
    service, address = playing("--token-file", path)

    async def talk(socket):
        await socket.send_json({"do": "ping"})
        message = await socket.receive()
        return message.data if message.type is aiohttp.WSMsgType.TEXT else socket.close_code

    assert json.loads(with_client(address, talk, path.read_text()))["result"] == "pong"
    assert with_client(address, talk) == 4401
    assert service.logged("web client refused")["fields"]["reason"] == "wrong token"
    assert path.read_text() not in "".join(service.log)


def test_ten_thousand_random_frames_leave_the_service_unharmed_and_its_memory_flat(playing):
    service, address = playing()
    random = np.random.default_rng(7)
    process = psutil.Process(service.process.pid)

    async def send(socket):
        for _ in range(50):
            text = random.bytes(random.integers(0, 200)).decode("latin-1")
            valid = json.dumps({random.choice(["do", "subscribe", "unsubscribe", "id"]): text})
            await socket.send_str(text if random.random() < 0.5 else valid)
        await socket.send_bytes(random.bytes(100))
        while (await socket.receive()).type is not aiohttp.WSMsgType.CLOSE:
            pass

    def attack(count):
        for _ in range(count // 51):
            with_client(address, send)

    memory = []
    for _ in range(4):
        attack(2550)
        memory.append(process.memory_info().rss)
    assert service.ask("ping") == "pong"
    frames = service.client("blob/controls").until(lambda message: message.header.state == 2)
    assert frames
    assert max(memory[1:]) - memory[0] < 10e6
