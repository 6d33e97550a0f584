"""Connections that request nothing do not block the port of phones."""

import asyncio
from contextlib import asynccontextmanager

import pytest
from aiohttp import web

from engine_bridge.studio.web import phone_connections
from engine_bridge.studio.web.phone_connections import limited

REQUEST = b"GET / HTTP/1.1\r\nHost: a\r\n\r\n"


async def answer(request):
    return web.Response(text="film")


@asynccontextmanager
async def connecting():
    """Yield a function that opens connections to a server."""
    server = web.Server(answer)
    listening = await asyncio.get_running_loop().create_server(limited(server), "127.0.0.1", 0)
    address = listening.sockets[0].getsockname()
    writers = []

    async def connect():
        reader, writer = await asyncio.open_connection(*address)
        writers.append(writer)
        return reader, writer

    yield connect
    for writer in writers:
        writer.close()
    listening.close()
    await server.shutdown()


async def ends(reader):
    """Return whether the other side has closed a connection without an answer."""
    try:
        return await reader.read() == b""
    except ConnectionError:
        return True


@pytest.mark.parametrize("sent", [b"", REQUEST[:10]])
def test_connections_without_a_request_are_closed(monkeypatch, sent):
    monkeypatch.setattr(phone_connections, "REQUEST_SECONDS", 0.05)

    async def run():
        async with connecting() as connect:
            reader, writer = await connect()
            writer.write(sent)
            assert await ends(reader)

    asyncio.run(run())


def test_requests_in_pieces_are_answered_and_connections_beyond_the_limit_closed(monkeypatch):
    monkeypatch.setattr(phone_connections, "MAX_CONNECTIONS", 2)

    async def run():
        async with connecting() as connect:
            first, writer = await connect()
            writer.write(REQUEST[:10])
            await writer.drain()
            writer.write(REQUEST[10:] + REQUEST)
            for _ in range(2):
                assert await first.readuntil(b"film")
            second, writer = await connect()
            third, _ = await connect()
            assert await ends(third)
            writer.write(b"x" * (phone_connections.MAX_HEADER_BYTES + 1))
            assert await ends(second)

    asyncio.run(run())
