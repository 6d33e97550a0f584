"""`puppetline serve --websocket` as a process, with aiohttp's client."""

import asyncio
import json

import aiohttp
import pytest

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
