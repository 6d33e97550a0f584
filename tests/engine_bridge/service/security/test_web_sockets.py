import asyncio
import gc
import os
import struct

import aiohttp
import psutil
import pytest
from aiohttp import web

from engine_bridge.service.security import web_sockets
from engine_bridge.service.security.web_sockets import MAX_FIRST_BYTES, Heartbeat, first_text, refuse

from ....clock import GivenLoop

UPGRADE = (
    "GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


async def served(handle):
    """Serve WebSockets with a handler of the request and the stream; return the server, its port and its end."""

    async def handler(request):
        stream = web.WebSocketResponse(timeout=web_sockets.CLOSE_SECONDS, autoping=False, max_msg_size=65_536)
        await stream.prepare(request)
        await handle(request, stream)
        return stream

    server = web.Server(handler)
    listening = await asyncio.get_running_loop().create_server(server, "127.0.0.1", 0)

    async def end():
        listening.close()
        await server.shutdown(0)

    return server, listening.sockets[0].getsockname()[1], end


async def refuse_all(request, stream):
    await first_text(stream)
    if not stream.closed:
        await refuse(request, stream, 4401, b"wrong token")


async def flood(port, frames, path="/"):
    """Send texts until the connection is reset."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(UPGRADE.format(path=path, port=port).encode())
        await reader.readuntil(b"\r\n\r\n")
        for _ in range(frames):
            writer.write(struct.pack(">BBQ", 0x81, 0xFF, 20_000) + bytes(4) + b"x" * 20_000)
            await asyncio.wait_for(writer.drain(), 1)
    except (OSError, TimeoutError, asyncio.IncompleteReadError):
        pass
    finally:
        writer.transport.abort()


async def sizes_of_floods(port, path="/"):
    """Return the memory of this process after each of some floods, and how many of their connections it keeps."""
    sizes = []
    for _ in range(4):
        for _ in range(4):
            await asyncio.gather(*(flood(port, 20, path) for _ in range(16)))
        for _ in range(1000):
            gc.collect()
            kinds = map(type, gc.get_objects())  # not isinstance, which asks weak proxies of objects that are gone
            kept = sum(issubclass(kind, web.RequestHandler | web.WebSocketResponse) for kind in kinds)
            if not kept:
                break
            await asyncio.sleep(0.01)
        sizes.append(psutil.Process(os.getpid()).memory_info().rss)
    return sizes, kept


def test_clients_that_send_without_a_token_leave_nothing_in_memory(monkeypatch):
    monkeypatch.setattr(web_sockets, "CLOSE_SECONDS", 0.02)

    async def run():
        _, port, end = await served(refuse_all)
        found = await sizes_of_floods(port)
        await end()
        return found

    sizes, kept = asyncio.run(run())
    assert kept == 0
    assert max(sizes[1:]) - sizes[0] < 5e6


def test_a_refused_client_is_told_why_and_what_it_sends_is_not_read(monkeypatch):
    async def run():
        _, port, end = await served(refuse_all)
        async with aiohttp.ClientSession() as http, http.ws_connect(f"http://127.0.0.1:{port}/") as client:
            for _ in range(5):
                await client.send_str("no token")
            message = await client.receive()
        await end()
        return message.type, client.close_code

    assert asyncio.run(run()) == (aiohttp.WSMsgType.CLOSE, 4401)


@pytest.mark.parametrize(
    ("sent", "text"),
    [
        ("short", "short"),
        ("x" * MAX_FIRST_BYTES, "x" * MAX_FIRST_BYTES),
        ("x" * (MAX_FIRST_BYTES + 1), None),
        (b"s", None),
        (None, None),
    ],
)
def test_only_a_short_text_that_comes_in_time_is_taken(sent, text):
    async def run():
        taken = asyncio.get_running_loop().create_future()

        async def take(_, stream):
            taken.set_result(await (first_text(stream, 0.05) if sent is None else first_text(stream)))

        _, port, end = await served(take)
        async with aiohttp.ClientSession() as http, http.ws_connect(f"http://127.0.0.1:{port}/") as client:
            if sent is not None:
                await (client.send_str if isinstance(sent, str) else client.send_bytes)(sent)
            found = await taken
        await end()
        return found

    assert asyncio.run(run()) == text


@pytest.mark.parametrize("answers", [True, False])
def test_a_silent_client_stays_as_long_as_it_answers_pings(answers, given_clock):
    async def run():
        taken, ended = [], asyncio.Event()

        async def follow(request, stream):
            async for message in Heartbeat(request, stream, 20.0).messages():
                taken.append(message.data)  # noqa: PERF401 - until the connection ends
            ended.set()

        _, port, end = await served(follow)
        async with (
            aiohttp.ClientSession() as http,
            http.ws_connect(f"http://127.0.0.1:{port}/", autoping=False) as client,
        ):
            await client.send_str("first")
            while not taken:
                await asyncio.sleep(0)
            given_clock.advance(21.0)
            pinged = await client.receive()
            assert pinged.type is aiohttp.WSMsgType.PING
            if answers:
                await client.pong(pinged.data)
                await client.send_str("last")
                await client.close()
            given_clock.advance(10.0)
            await ended.wait()
        await end()
        return taken

    with given_clock.standing(), asyncio.Runner(loop_factory=GivenLoop) as runner:
        assert runner.run(run()) == (["first", "last"] if answers else ["first"])
