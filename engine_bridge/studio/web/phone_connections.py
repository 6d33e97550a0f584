"""Limits the connections of visitors' phones, so that those that request nothing do not block the others."""

import asyncio
from collections.abc import Callable
from typing import cast

from aiohttp import web

MAX_CONNECTIONS = 256
"""Maximum number of open connections; beyond it, new ones are closed."""

REQUEST_SECONDS = 10.0
"""Time that a connection has for the header of a request, in seconds."""

MAX_HEADER_BYTES = 16_384
"""Maximum size of the header of the first request."""


def limited(server: web.Server) -> Callable[[], asyncio.Protocol]:
    """Return a factory of protocols for `create_server`, which pass connections on to a server when they request."""
    waiting: set[_Waiting] = set()
    return lambda: _Waiting(server, waiting)


class _Waiting(asyncio.Protocol):
    """A connection until the header of its first request is complete."""

    def __init__(self, server: web.Server, waiting: set["_Waiting"]) -> None:
        self._server, self._waiting = server, waiting
        self._received = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.Transport", transport)
        self._timer = asyncio.get_running_loop().call_later(REQUEST_SECONDS, self._transport.abort)
        if len(self._waiting) + len(self._server.connections) >= MAX_CONNECTIONS:
            self._transport.abort()
        self._waiting.add(self)

    def data_received(self, data: bytes) -> None:
        self._received += data
        if b"\r\n\r\n" in self._received:
            self.connection_lost(None)
            handler = self._server()
            self._transport.set_protocol(handler)
            handler.connection_made(self._transport)
            handler.data_received(self._received)
        elif len(self._received) > MAX_HEADER_BYTES:
            self._transport.abort()

    def connection_lost(self, _: Exception | None) -> None:
        self._timer.cancel()
        self._waiting.discard(self)
