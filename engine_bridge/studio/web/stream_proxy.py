"""Passes the service's stream through to a page, so that the page needs one address and one token.

Only the newest message of each topic waits for a page. A page that reads slowly therefore skips frames, but gets no old
ones, and does not delay other pages.
"""

import asyncio
import contextlib
import json
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable
from typing import Literal, Protocol

import aiohttp
from aiohttp import WSMsgType, web

from engine_bridge.service.monitoring.logs import OnceASecond
from engine_bridge.service.security.web_sockets import CLOSE_SECONDS, Heartbeat, first_text, refuse
from engine_bridge.studio.messages.connection import CloseCode
from engine_bridge.studio.service.service_process import Reached
from engine_bridge.studio.service.stream_link import REFUSED, streaming, subscription_of
from engine_bridge.studio.web.api_connection import HEARTBEAT_SECONDS, HELLO_SECONDS, token_of

TOPIC_BYTES = 64
"""Length of a message's topic in bytes (docs/protocol.md)."""

MAX_TEXT_BYTES = 65_536
"""Maximum size of a page's message in bytes."""

MAX_MESSAGE_BYTES = 1 << 30
"""Maximum size of a message of the service in bytes."""

MAX_REPLIES = 256
"""Maximum number of replies of the service that wait for a page."""

SEND_BUFFER_BYTES = 262_144
"""Size of the system's buffer of a page's connection in bytes; what is in it cannot be replaced by newer frames."""

Rights = Literal["none", "subscribe", "all"]
"""What a token allows on the stream: a screen subscribes, and a page of the studio also makes requests."""

_rarely = OnceASecond(logging.getLogger(__name__))


class _Newest:
    """Messages of the service that wait for the page: texts in order, and the newest binary message of each topic."""

    def __init__(self) -> None:
        self._texts: deque[str] = deque(maxlen=MAX_REPLIES)
        self._topics: dict[bytes, bytes] = {}
        self._wake = asyncio.Event()
        self._ended = False

    def put(self, data: str | bytes) -> None:
        if isinstance(data, str):
            self._texts.append(data)
        else:
            self._topics[data[:TOPIC_BYTES]] = data
        self._wake.set()

    def end(self) -> None:
        self._ended = True
        self._wake.set()

    async def take(self) -> str | bytes | None:
        """Return the next message; None after the last."""
        while not self._texts and not self._topics:
            if self._ended:
                return None
            self._wake.clear()
            await self._wake.wait()
        if self._texts:
            return self._texts.popleft()
        return self._topics.pop(next(iter(self._topics)))


async def pass_through(
    request: web.Request,
    rights_of: Callable[[str], Rights],
    handshakes: asyncio.Semaphore,
    reached: Callable[[], Reached | None],
) -> web.WebSocketResponse:
    """Serve a page's WebSocket until the page or the service closes it.

    The service is connected to by WebSocket or, if it was started elsewhere, by ZeroMQ.
    """
    page = web.WebSocketResponse(timeout=CLOSE_SECONDS, autoping=False, max_msg_size=MAX_TEXT_BYTES, compress=False)
    async with handshakes:
        await page.prepare(request)
        _limit_buffers(request)
        token = token_of(await first_text(page, HELLO_SECONDS))
    rights = "none" if token is None else rights_of(token)
    if rights == "none":
        _rarely.warning("client refused", reason="no session token", address=request.remote)
        await refuse(request, page, CloseCode.REFUSED, b"no session token")
        return page
    heartbeat = Heartbeat(request, page, HEARTBEAT_SECONDS)
    service = reached()
    if service is None or not service.stream:
        await page.close(code=CloseCode.NO_SERVICE, message=b"the service is not running")
        return page
    with contextlib.suppress(aiohttp.ClientError, OSError):
        if service.stream.startswith("tcp://"):
            async with streaming(service.stream, service.token) as link:
                await _exchange(page, heartbeat, link)
        else:
            async with (
                aiohttp.ClientSession() as session,
                session.ws_connect(service.stream, max_msg_size=MAX_MESSAGE_BYTES, compress=0) as socket,
            ):
                await socket.send_str(json.dumps({} if service.token is None else {"token": service.token}))
                await _exchange(page, heartbeat, _WebSocket(socket, rights))
    if not page.closed:
        await page.close(code=CloseCode.NO_SERVICE, message=b"the service has ended")
    return page


class _Upstream(Protocol):
    """The service's side of a connection: accepts texts, and yields texts and messages until it ends."""

    async def send(self, text: str) -> str | None: ...

    def messages(self) -> AsyncIterator[str | bytes]: ...


class _WebSocket:
    """The service's WebSocket."""

    def __init__(self, socket: "aiohttp.ClientWebSocketResponse", rights: Rights) -> None:
        self._socket, self._rights = socket, rights

    async def send(self, text: str) -> str | None:
        if self._rights == "subscribe" and subscription_of(text) is None:
            return REFUSED
        await self._socket.send_str(text)
        return None

    async def messages(self) -> AsyncIterator[str | bytes]:
        async for message in self._socket:
            if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                yield message.data


async def _exchange(page: web.WebSocketResponse, heartbeat: Heartbeat, upstream: _Upstream) -> None:
    """Pass messages in both directions until one side ends."""
    newest = _Newest()

    async def receive() -> None:
        async for data in upstream.messages():
            newest.put(data)
        newest.end()

    async def send() -> None:
        while (data := await newest.take()) is not None:
            await (page.send_str(data) if isinstance(data, str) else page.send_bytes(data))

    async def forward() -> None:
        async for message in heartbeat.messages():
            if message.type is WSMsgType.TEXT and (refusal := await upstream.send(message.data)) is not None:
                newest.put(refusal)

    tasks = [asyncio.create_task(each()) for each in (receive, send, forward)]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(*tasks, return_exceptions=True)


def _limit_buffers(request: web.Request) -> None:
    import socket

    if request.transport is None:
        return
    request.transport.set_write_buffer_limits(high=SEND_BUFFER_BYTES)
    connection = request.transport.get_extra_info("socket")
    if connection is not None:
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
