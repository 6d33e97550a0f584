"""The WebSocket server of the stream: connections, credentials and delivery, in a thread with an event loop of its own.

A client gets the newest message of each topic when it can take one. A slow client skips frames, and delays neither the
others nor the service. What a client sends is carried out in the service's loop, one message at a time.
"""

import asyncio
import hmac
import json
import logging
import socket
import sys
import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from aiohttp import WSCloseCode, WSMsgType, web

from engine_bridge.service.monitoring.logs import OnceASecond
from engine_bridge.service.outputs.calls import Calls
from engine_bridge.service.protocol.header import TOPIC_BYTES
from engine_bridge.service.security.endpoints import HANDSHAKE_SECONDS, IPAddress
from engine_bridge.service.security.web_access import WebAccess
from engine_bridge.service.security.web_sockets import CLOSE_SECONDS, Heartbeat, first_text, refuse
from puppetline.errors import ServiceError

PATH = "/stream"
"""Path of the stream's address."""

MAX_TEXT_BYTES = 65_536
"""Maximum size of a client's message in bytes."""

MAX_WAITING_TOPICS = 1024
"""Maximum number of topics whose newest message waits for a slow client; messages of further topics are dropped."""

MAX_WAITING_REPLIES = 64
"""Maximum number of replies that wait for a slow client; further replies are dropped."""

MAX_HANDSHAKES = 64
"""Maximum number of connections that have not authenticated yet; further ones are closed."""

SEND_BUFFER_BYTES = 128 * 1024
"""Size of the system's send buffer per client; what waits there is old when it arrives."""

HEARTBEAT_SECONDS = 20.0
"""Time without data from a client after which it must answer a ping, in seconds; it has half that time to answer."""

WRONG_TOKEN = 4401
"""Close code of a client that did not send the token."""


class Service(Protocol):
    """What clients ask of the service; each method is called in the service's loop."""

    def join(self, client: "Client") -> None:
        """Add a client that has authenticated."""

    def leave(self, client: "Client") -> None:
        """Remove a client that has disconnected."""

    def take(self, client: "Client", text: str) -> None:
        """Carry out what a client has sent."""


@dataclass
class Counts:
    """What a server has sent and refused so far, and the clients that are connected."""

    sent: int = 0
    bytes: int = 0
    skipped: int = 0
    refused: int = 0
    clients: int = 0


class Client:
    """A connected client, and what waits to be sent to it: replies, and the newest message of each topic.

    The service's loop puts messages in, and the server's thread takes them out.
    """

    def __init__(self, counts: Counts) -> None:
        self.ready = asyncio.Event()
        """Set in the server's thread when something waits."""
        self._counts = counts
        self._lock = threading.Lock()
        self._messages: dict[bytes, tuple[bytes, ...]] = {}
        self._replies: deque[str] = deque()

    def put(self, *parts: bytes) -> None:
        """Hold a message, which is the parts one after the other, in place of an older one of its topic."""
        place = parts[0][:TOPIC_BYTES]
        with self._lock:
            if place in self._messages or len(self._messages) >= MAX_WAITING_TOPICS:
                self._counts.skipped += 1
            if place in self._messages or len(self._messages) < MAX_WAITING_TOPICS:
                self._messages[place] = parts

    def reply(self, body: bytes) -> None:
        """Hold a reply."""
        with self._lock:
            if len(self._replies) < MAX_WAITING_REPLIES:
                self._replies.append(body.decode())

    def next(self) -> "str | tuple[bytes, ...] | None":
        """Take out what to send next, replies first; None if nothing waits."""
        with self._lock:
            if self._replies:
                return self._replies.popleft()
            if not self._messages:
                return None
            return self._messages.pop(next(iter(self._messages)))


class WebSocketServer:
    """Serves clients in a thread until it is closed.

    Parameters
    ----------
    address : IPv4Address or IPv6Address
    port : int
        0 chooses a free one.
    access : WebAccess
    token : bytes or None
        Token that clients must send; None accepts every client that `access` accepts.
    max_clients : int
    calls : Calls
        Made in the service's loop.
    service : Service

    Attributes
    ----------
    address : str
        Address that clients connect to.
    counts : Counts

    Raises
    ------
    ServiceError
        An address that cannot be bound.
    """

    def __init__(
        self,
        address: IPAddress,
        port: int,
        access: WebAccess,
        token: bytes | None,
        max_clients: int,
        calls: Calls,
        service: Service,
    ) -> None:
        self.counts = Counts()
        self._access, self._token, self._max_clients = access, token, max_clients
        self._calls, self._service = calls, service
        self._log = OnceASecond(logging.getLogger(__name__))
        self._clients: dict[Client, web.WebSocketResponse] = {}
        self._admitted: set[web.RequestHandler] = set()
        self._socket = _bound(address, port)
        host = f"[{address}]" if address.version == 6 else str(address)
        self.address = f"ws://{host}:{self._socket.getsockname()[1]}{PATH}"
        self._woken = False
        self._closing = asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="websocket", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Send what waits for clients; the service's loop calls this after it has put something in."""
        if not self._woken:
            self._woken = True
            self._loop.call_soon_threadsafe(self._notify)

    def close(self) -> None:
        """Disconnect all clients and free the port; closing again does nothing."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._closing.set)
            self._thread.join(2 * CLOSE_SECONDS)

    def _notify(self) -> None:
        self._woken = False  # first: what is put in from now on needs another call
        for client in self._clients:
            client.ready.set()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        server = web.Server(self._handle, access_log=None)
        listening = await self._loop.create_server(partial(self._accept, server), sock=self._socket)
        expiring = asyncio.create_task(self._expire(server))
        await self._closing.wait()
        expiring.cancel()
        listening.close()
        closures = [
            asyncio.create_task(each.close(code=WSCloseCode.GOING_AWAY, drain=False)) for each in self._clients.values()
        ]
        if closures:
            await asyncio.wait(closures, timeout=CLOSE_SECONDS)
        await server.shutdown(0)

    def _accept(self, server: web.Server) -> asyncio.BaseProtocol:
        """Return the protocol of a new connection."""
        if len(server.connections) - len(self._admitted) >= MAX_HANDSHAKES:
            self._refuse("too many connections without authentication")
            return _Refusing()
        return server()

    async def _expire(self, server: web.Server) -> None:
        """Close the connections that have not authenticated in time; a timer for each would keep the ended ones."""
        begun: dict[web.RequestHandler, float] = {}
        while True:
            now = self._loop.time()
            waiting = [each for each in server.connections if each not in self._admitted]
            begun = {each: begun.get(each, now) for each in waiting}
            for handler, since in begun.items():
                if now - since >= HANDSHAKE_SECONDS and handler.transport is not None:
                    self._refuse("no authentication in time")
                    handler.transport.abort()
            await asyncio.sleep(HANDSHAKE_SECONDS / 10)

    def _refuse(self, reason: str, request: web.BaseRequest | None = None) -> None:
        self.counts.refused += 1
        headers = {} if request is None else {name: request.headers.get(name, "")[:200] for name in ("Host", "Origin")}
        address = {} if request is None else {"address": request.remote}
        shown = {name.lower(): value for name, value in headers.items() if value}
        self._log.warning("web client refused", reason=reason, **address, **shown)

    async def _handle(self, request: web.BaseRequest) -> web.StreamResponse:
        """Check the origin and the credentials of a request, and then serve it as a client."""
        reason = self._access.refusal(request.headers.get("Host"), request.headers.get("Origin"))
        if reason is not None:
            self._refuse(reason, request)
            return _closing(web.Response(status=403, text=f"Refused: {reason} (docs/security.md).\n"))
        if request.path != PATH:
            return _closing(web.Response(status=404, text=f"The stream is at {PATH}, a WebSocket.\n"))
        stream = web.WebSocketResponse(
            timeout=CLOSE_SECONDS, autoping=False, compress=False, max_msg_size=MAX_TEXT_BYTES, writer_limit=0
        )
        if not stream.can_prepare(request):
            return _closing(web.Response(status=400, text="Connect with a WebSocket.\n"))
        await stream.prepare(request)
        transport = request.transport
        if not isinstance(transport, asyncio.Transport):  # it has disconnected
            return stream
        transport.set_write_buffer_limits(high=0)  # so that sending waits until the system has taken the message
        try:
            await self._serve_client(request, stream)
        except ConnectionError:
            pass
        finally:
            await _end(transport)
        return stream

    async def _serve_client(self, request: web.BaseRequest, stream: web.WebSocketResponse) -> None:
        first = await first_text(stream)
        if stream.closed:
            return
        if not self._authenticates(first):
            self._refuse("wrong token", request)
            await refuse(request, stream, WRONG_TOKEN, b"wrong token")
        elif len(self._clients) >= self._max_clients:
            self._refuse("too many clients", request)
            await refuse(request, stream, WSCloseCode.TRY_AGAIN_LATER, b"too many clients")
        else:
            client = Client(self.counts)
            self._clients[client] = stream
            self._admitted.add(request.protocol)
            self.counts.clients = len(self._clients)
            sending = asyncio.create_task(_send(client, stream, self.counts))
            try:
                await self._call(partial(self._service.join, client))
                await self._receive(client, request, stream)
            finally:
                sending.cancel()
                del self._clients[client]
                self._admitted.discard(request.protocol)
                self.counts.clients = len(self._clients)
                self._calls.ask(partial(self._service.leave, client))

    def _authenticates(self, first: str | None) -> bool:
        """Tell whether a client's first message is a JSON object, with the token if one is required."""
        if first is None:
            return False
        try:
            values = json.loads(first)
        except (ValueError, RecursionError):
            return False
        if not isinstance(values, dict):
            return False
        token = values.get("token")
        if self._token is None:
            return True
        return isinstance(token, str) and hmac.compare_digest(token.encode(errors="replace"), self._token)

    async def _receive(self, client: Client, request: web.BaseRequest, stream: web.WebSocketResponse) -> None:
        """Pass on a client's messages, the next one when the service has taken the one before."""
        async for message in Heartbeat(request, stream, HEARTBEAT_SECONDS).messages():
            if message.type is not WSMsgType.TEXT:
                await stream.close(code=WSCloseCode.UNSUPPORTED_DATA, message=b"send text")
                return
            await self._call(partial(self._service.take, client, message.data))

    async def _call(self, call: "partial[None]") -> None:
        await asyncio.wrap_future(self._calls.ask(call))


async def _end(transport: asyncio.Transport) -> None:
    """Close a connection, and do not wait for a client that does not read.

    Closing while data of the client is unread resets the connection, and the reset could overtake the close frame. The
    client therefore has `CLOSE_SECONDS` to close the connection itself.
    """
    try:
        with suppress(TimeoutError):
            async with asyncio.timeout(CLOSE_SECONDS):
                while not transport.is_closing():
                    await asyncio.sleep(CLOSE_SECONDS / 25)
    finally:
        transport.abort()


async def _send(client: Client, stream: web.WebSocketResponse, counts: Counts) -> None:
    """Send what waits for a client, as fast as it reads."""
    with suppress(ConnectionError):
        while True:
            await client.ready.wait()
            client.ready.clear()
            while (message := client.next()) is not None:
                if isinstance(message, str):
                    await stream.send_str(message)
                else:
                    whole = b"".join(message)
                    await stream.send_bytes(whole)
                    counts.sent += 1
                    counts.bytes += len(whole)


class _Refusing(asyncio.Protocol):
    """Closes a connection immediately."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.abort()  # type: ignore[attr-defined]


def _closing(response: web.Response) -> web.Response:
    response.force_close()
    return response


def _bound(address: IPAddress, port: int) -> socket.socket:
    try:
        bound = socket.socket(socket.AF_INET6 if address.version == 6 else socket.AF_INET)
        if socket.has_ipv6 and address.version == 6:
            bound.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        if sys.platform != "win32":  # there, two programs could then use the port
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)  # its connections inherit it
        bound.bind((str(address), port))
        bound.listen()  # clients may connect before the thread runs
    except OSError as error:
        raise ServiceError(
            "[websocket]",
            found=f"an address that cannot be bound: {address}, port {port} ({error.strerror})",
            expected="a port that no other program uses",
            fix="Stop the other service, or choose another port.",
        ) from error
    return bound
