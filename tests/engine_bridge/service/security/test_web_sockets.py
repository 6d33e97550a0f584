import asyncio
import gc
import struct
import tracemalloc
from contextlib import asynccontextmanager

import aiohttp
import pytest
from aiohttp import web

from engine_bridge.service.security.web_sockets import CLOSE_SECONDS, MAX_FIRST_BYTES, Heartbeat, first_text

from ....clock import GivenLoop

UPGRADE = (
    "GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


@asynccontextmanager
async def connected(handle):
    """Serve a client with a handler of the request and the stream, and give the client; it answers no pings."""

    async def handler(request):
        stream = web.WebSocketResponse(timeout=CLOSE_SECONDS, autoping=False, max_msg_size=65_536)
        await stream.prepare(request)
        await handle(request, stream)
        return stream

    server = web.Server(handler)
    listening = await asyncio.get_running_loop().create_server(server, "127.0.0.1", 0)
    address = "http://{}:{}/".format(*listening.sockets[0].getsockname())
    async with aiohttp.ClientSession() as http, http.ws_connect(address, autoping=False) as client:
        yield client
    listening.close()
    await server.shutdown(0)


async def flood(port, path):
    """Send texts until the connection is reset."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(UPGRADE.format(path=path, port=port).encode())
        await reader.readuntil(b"\r\n\r\n")
        for _ in range(20):
            writer.write(struct.pack(">BBQ", 0x81, 0xFF, 20_000) + bytes(4) + b"x" * 20_000)
            await asyncio.wait_for(writer.drain(), 1)
    except (OSError, TimeoutError, asyncio.IncompleteReadError):
        pass
    finally:
        writer.transport.abort()


async def sizes_of_floods(port, path):
    """Return the bytes that this process has after each of two floods, and how many of their connections it keeps."""
    sizes = []
    gc.collect()
    gc.freeze()  # what is here already is neither counted nor looked through again
    tracemalloc.start()
    for _ in range(2):
        await asyncio.gather(*(flood(port, path) for _ in range(16)))
        for _ in range(1000):
            gc.collect()
            kinds = map(type, gc.get_objects())  # not isinstance, which asks weak proxies of objects that are gone
            kept = sum(issubclass(kind, web.RequestHandler | web.WebSocketResponse) for kind in kinds)
            if not kept:
                break
            await asyncio.sleep(0.01)
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    gc.unfreeze()
    return sizes, kept


LONGEST = "x" * MAX_FIRST_BYTES


@pytest.mark.parametrize(
    ("sent", "text"), [("short", "short"), (LONGEST, LONGEST), (LONGEST + "x", None), (b"s", None), (None, None)]
)
def test_only_a_short_text_that_comes_in_time_is_taken(sent, text):
    async def run():
        taken = asyncio.get_running_loop().create_future()

        async def take(_, stream):
            taken.set_result(await first_text(stream, 0.05 if sent is None else None))

        async with connected(take) as client:
            if sent is not None:
                await (client.send_str if isinstance(sent, str) else client.send_bytes)(sent)
            return await taken

    assert asyncio.run(run()) == text


def test_a_silent_client_stays_as_long_as_it_answers_pings(given_clock):
    """That it does not stay otherwise is tested with the whole server."""

    async def run():
        taken, ended = [], asyncio.Event()

        async def follow(request, stream):
            async for message in Heartbeat(request, stream, 20.0).messages():
                taken.append(message.data)  # noqa: PERF401 - until the connection ends
            ended.set()

        async with connected(follow) as client:
            await client.send_str("first")
            while not taken:
                await asyncio.sleep(0)
            given_clock.advance(21.0)
            pinged = await client.receive()
            assert pinged.type is aiohttp.WSMsgType.PING
            await client.pong(pinged.data)
            await client.send_str("last")
            await client.close()
            given_clock.advance(10.0)
            await ended.wait()
        return taken

    with given_clock.standing(), asyncio.Runner(loop_factory=GivenLoop) as runner:
        assert runner.run(run()) == ["first", "last"]
