"""The output over WebSocket: the stream and the control socket's requests, for web pages (docs/protocol.md)."""

import json
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Field

from engine_bridge.service.monitoring.status import OutputStatus
from engine_bridge.service.outputs.calls import Calls
from engine_bridge.service.outputs.output import Answer, Opening, Output, OutputTable
from engine_bridge.service.outputs.stream import Stream, StreamOutput
from engine_bridge.service.protocol.header import is_topic, subscription
from engine_bridge.service.security.endpoints import IPAddress, Port, Text, address_of
from engine_bridge.service.security.web_access import WebAccess
from puppetline.errors import ServiceError
from puppetline.toml_schema import mistake

if TYPE_CHECKING:
    from engine_bridge.service.outputs.websocket_server import Client

ORIGIN = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://[^/\s?#@]+")

CONNECTION = 0
"""Number of a client's only connection in its subscriptions."""


def _origin(text: str) -> str:
    if not ORIGIN.fullmatch(text):
        raise mistake(
            found=repr(text),
            expected="the scheme, the host and the port of web pages, and no path",
            fix="Write for example 'http://localhost:8000'.",
        )
    return text


Origin = Annotated[str, Field(strict=True), AfterValidator(_origin)]


class WebSocketTable(OutputTable):
    """[websocket]: the address that web pages connect to, and which pages may connect.

    Attributes
    ----------
    port : int
        0 chooses any free port.
    host : str
    origins : tuple of str
        Origins of the pages that may connect, such as ``http://localhost:8000``.
    max_clients : int
    """

    port: Port = 7402
    host: Text = "127.0.0.1"
    origins: Annotated[tuple[Origin, ...], Field(max_length=64)] = ()
    max_clients: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 64

    def open(self, opening: Opening) -> Output:
        """Start the server; see `WebSocketOutput`."""
        return WebSocketOutput(self, opening)


class WebSocketOutput(StreamOutput["Client"]):
    """Sends characters to the web pages that subscribe to them, and carries out their requests.

    Parameters
    ----------
    table : WebSocketTable
    opening : Opening

    Raises
    ------
    ServiceError
        The address cannot be bound, or other machines could connect to it without a token.
    """

    def __init__(self, table: WebSocketTable, opening: Opening) -> None:
        from engine_bridge.service.outputs.websocket_server import WebSocketServer  # importing it takes a while

        super().__init__()
        self._answer_request: Answer = opening.answer
        address = address_of(table.host, "[websocket], host")
        token = _token(opening, address)
        access = WebAccess(address, table.host, table.origins)
        self._calls = Calls()
        self._server = WebSocketServer(address, table.port, access, token, table.max_clients, self._calls, self)
        self.announce(opening.characters)

    @property
    def endpoints(self) -> list[str]:
        """The address that clients connect to, with its actual port."""
        return [self._server.address]

    @property
    def sockets(self) -> Sequence[int]:
        """The file descriptor that is readable while calls of the server wait."""
        return [self._calls.fileno()]

    def handle(self, socket: int) -> None:  # noqa: ARG002
        """Carry out what clients have sent, and answer the subscriptions whose time has come."""
        self._calls.make()
        self.send_due()

    @property
    def statistics(self) -> OutputStatus:
        """Messages sent to all clients, messages replaced or dropped, connected clients and refused connections."""
        counts = self._server.counts
        return OutputStatus(
            "websocket",
            self._server.address,
            counts.sent,
            counts.bytes,
            counts.skipped,
            0,
            counts.clients,
            counts.refused,
        )

    def close(self) -> None:
        """Disconnect all clients; closing again does nothing."""
        self._server.close()
        self._calls.close()

    def join(self, client: "Client") -> None:
        """Add a client that has authenticated."""
        self._streams[client] = Stream()

    def leave(self, client: "Client") -> None:
        """Remove a client that has disconnected."""
        self._streams.pop(client, None)

    def take(self, client: "Client", text: str) -> None:
        """Carry out what a client has sent: a subscription, the end of one, or a request."""
        do, place = _subscription(text)
        if do is None:
            self._answer_request(text.encode(), lambda body: self._reply(client, body))
            return
        stream = self._streams[client]
        self._unsubscribe(stream, subscription(place), CONNECTION)
        if do == "subscribe":
            self._subscribe(stream, subscription(place), CONNECTION)

    def _reply(self, client: "Client", body: bytes) -> None:
        client.reply(body)
        self._server.wake()

    def _send(self, peer: "Client", *parts: bytes) -> None:
        peer.put(*parts)
        self._server.wake()


def _subscription(text: str) -> tuple[str | None, str]:
    """Return ``"subscribe"`` or ``"unsubscribe"`` and a topic; None and an empty string for any other text."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        return None, ""
    if isinstance(values, dict) and len(values) == 1:
        [(do, place)] = values.items()
        if do in ("subscribe", "unsubscribe") and isinstance(place, str) and is_topic(place):
            return do, place
    return None, ""


def _token(opening: Opening, address: IPAddress) -> bytes | None:
    """Return the token of [network], which clients must send; None without one.

    Raises
    ------
    ServiceError
        Other machines could connect without one.
    """
    token = next((each.token for each in opening.endpoints if each.mechanism == "PLAIN"), None)
    if token is None and not address.is_loopback:
        raise ServiceError(
            "[websocket], host",
            found=f"{str(address)!r}, which other machines can reach, and no token",
            expected="a token if other machines can connect",
            fix='Make a token (puppetline token FILE) and set token_file in [network], or use host = "127.0.0.1".',
        )
    return token
