"""WebSockets of clients who may be anyone until they have authenticated.

Of such a client, one short message is read and nothing after it. aiohttp alone would read on while it waits for the
client's close frame. Its heartbeat would keep what belongs to an ended connection in memory, because data that arrives
after the end starts it again.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import suppress

from aiohttp import WSMessage, WSMsgType, web

MAX_FIRST_BYTES = 4096
"""Maximum size of the first message, which has the token, in bytes."""

CLOSE_SECONDS = 0.5
"""Time in which a client can read why it is refused, before the connection is reset, in seconds."""


async def first_text(stream: web.WebSocketResponse, seconds: float | None = None) -> str | None:
    """Return a client's first message; None if it is not a short text, or does not come in time.

    Parameters
    ----------
    stream : WebSocketResponse
        With ``timeout=CLOSE_SECONDS`` and without a heartbeat.
    seconds : float, optional
    """
    with suppress(TimeoutError):
        first = await stream.receive(seconds)
        if first.type is WSMsgType.TEXT and len(first.data) <= MAX_FIRST_BYTES:
            return str(first.data)
    return None


async def refuse(request: web.BaseRequest, stream: web.WebSocketResponse, code: int, reason: bytes) -> None:
    """Close the connection of a client that has not authenticated, without reading on."""
    transport = request.transport
    if not isinstance(transport, asyncio.Transport):  # it has disconnected
        return
    transport.set_protocol(_Deaf(request.protocol))
    transport.pause_reading()
    await stream.close(code=code, message=reason)
    transport.abort()


class _Deaf(asyncio.Protocol):
    """Ignores what a client sends, and otherwise does what another protocol does."""

    def __init__(self, protocol: asyncio.Protocol) -> None:
        self.pause_writing, self.resume_writing = protocol.pause_writing, protocol.resume_writing  # type: ignore[method-assign]
        self.connection_lost = protocol.connection_lost  # type: ignore[method-assign]


class Heartbeat:
    """The messages of a client that has authenticated, who is disconnected if it does not answer pings.

    Parameters
    ----------
    request : BaseRequest
    stream : WebSocketResponse
        With ``autoping=False``.
    seconds : float
        Time without data from the client after which it must answer a ping; it has half that time to answer.
    """

    def __init__(self, request: web.BaseRequest, stream: web.WebSocketResponse, seconds: float) -> None:
        self._request, self._stream, self._seconds = request, stream, seconds

    async def messages(self) -> AsyncIterator[WSMessage]:
        """Yield the client's messages until the connection ends."""
        self._heard = asyncio.get_running_loop().time()
        pinging = asyncio.create_task(self._ping())
        try:
            async for message in self._stream:
                self._heard = asyncio.get_running_loop().time()
                if message.type is WSMsgType.PING:
                    await self._stream.pong(message.data)
                elif message.type is not WSMsgType.PONG:
                    yield message
        finally:
            pinging.cancel()

    async def _ping(self) -> None:
        with suppress(ConnectionError):
            while (silence := asyncio.get_running_loop().time() - self._heard) < 1.5 * self._seconds:
                if silence >= self._seconds:
                    await self._stream.ping()
                await asyncio.sleep(self._seconds / 4)
        if self._request.transport is not None:
            self._request.transport.abort()
