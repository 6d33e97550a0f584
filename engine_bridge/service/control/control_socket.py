"""The control socket, which answers each request of a client once (docs/control.md)."""

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, cast

import msgpack
import zmq

from engine_bridge.service.control.dispatcher import Dispatcher, refusal
from engine_bridge.service.control.requests import WHERE, Encoding, encode, encoding_of
from engine_bridge.service.security.credentials import check_token
from engine_bridge.service.security.endpoints import Endpoint
from puppetline.errors import ServiceError

REQUESTS_PER_TURN = 16
BYTES_PER_TURN = 65_536
"""Number and size of requests answered before frames are sent again."""

QUEUED_REQUESTS, QUEUED_REPLIES = 16, 64
"""Maximum queue lengths per client; further requests wait on the client's side, further replies are lost."""


class Control:
    """Receives requests over ZeroMQ.

    Parameters
    ----------
    context : zmq.Context
    endpoints : sequence of Endpoint
    dispatcher : Dispatcher
        Answers each request.

    Raises
    ------
    zmq.ZMQError
        An endpoint that cannot be bound.
    """

    def __init__(
        self, context: "zmq.Context[zmq.Socket[bytes]]", endpoints: Sequence[Endpoint], dispatcher: Dispatcher
    ) -> None:
        self._dispatcher = dispatcher
        self.sockets: list[zmq.Socket[bytes]] = []
        """Sockets to poll for reading, one per endpoint, in their order."""
        try:
            for endpoint in endpoints:
                self._open(context, endpoint)
        except zmq.ZMQError:
            self.close()
            raise

    def _open(self, context: "zmq.Context[zmq.Socket[bytes]]", endpoint: Endpoint) -> None:
        socket = context.socket(zmq.ROUTER)
        self.sockets.append(socket)
        socket.linger = 0
        socket.rcvhwm = QUEUED_REQUESTS
        socket.sndhwm = QUEUED_REPLIES
        endpoint.prepare(socket)
        socket.bind(endpoint.control)

    @property
    def endpoints(self) -> list[str]:
        """Addresses that clients connect to, with their actual ports."""
        return [cast(bytes, socket.last_endpoint).rstrip(b"\0").decode() for socket in self.sockets]

    def handle(self, socket: "zmq.Socket[bytes]") -> None:
        """Read and answer requests, until `REQUESTS_PER_TURN` or `BYTES_PER_TURN` is reached."""
        taken = 0
        for _ in range(REQUESTS_PER_TURN):
            try:
                frames = socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._take(socket, frames)
            taken += sum(map(len, frames))
            if taken >= BYTES_PER_TURN:
                return

    def close(self) -> None:
        """Close all sockets; closing again does nothing."""
        for socket in self.sockets:
            socket.close(0)
        self.sockets.clear()

    def _take(self, socket: "zmq.Socket[bytes]", frames: list[bytes]) -> None:
        """Answer one message: the sender's identity, an empty part if it has a REQ socket, the request."""
        start = 2 if len(frames) > 2 and not frames[1] else 1
        envelope, encoding = frames[:start], encoding_of(frames[start])

        def reply(body: bytes) -> None:
            if not socket.closed:
                socket.send_multipart([*envelope, body], zmq.NOBLOCK)

        if len(frames) > start + 1:
            parts = ServiceError(
                WHERE,
                found=f"{len(frames) - start} message parts",
                expected="one part",
                fix="Send each request in one part.",
            )
            reply(refusal(parts, encoding))
        else:
            self._dispatcher.take(frames[start], reply, encoding)


def request(
    address: str,
    do: str,
    *,
    token: str | None = None,
    encoding: Encoding = "json",
    timeout: float = 5.0,
    **arguments: Any,
) -> Any:
    """Send a request to a service, and wait for its answer.

    Parameters
    ----------
    address : str
        Address of the control socket, such as ``tcp://127.0.0.1:7401``.
    do : str
        See docs/control.md.
    token : str, optional
        Required if the service has one.
    encoding : {"json", "msgpack"}
    timeout : float
        Maximum time to wait for the answer, in seconds.
    **arguments
        Arguments of the command.

    Returns
    -------
    JSON
        The result.

    Raises
    ------
    ServiceError
        The service's own error, no answer within `timeout`, or an answer that is not understood.
    """
    password = None if token is None else check_token(token, "the token").encode()
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        socket = context.socket(zmq.DEALER)
        socket.ipv6 = "[" in address
        if password is not None:
            socket.plain_username, socket.plain_password = b"puppetline", password
        monitor = socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL)
        socket.connect(address)
        with suppress(zmq.Again):  # a service that has refused this client already takes nothing, and `monitor` tells
            socket.send(encode({"do": do, "id": 1, **arguments}, encoding), zmq.NOBLOCK)
        poller = zmq.Poller()
        poller.register(socket, zmq.POLLIN)
        poller.register(monitor, zmq.POLLIN)
        ready = dict(poller.poll(None if math.isinf(timeout) else round(timeout * 1000)))
        if socket in ready:
            return _result(address, socket.recv(), encoding)
    except zmq.ZMQError as error:
        raise ServiceError(
            address,
            found=f"no address ({error})",
            expected="tcp://HOST:PORT",
            fix="Write for example tcp://127.0.0.1:7401.",
        ) from error
    finally:
        context.destroy(linger=0)
    if monitor in ready:
        raise ServiceError(
            address,
            found="a service that refuses this client",
            expected="a token if the service has one, and none otherwise",
            fix="Use the token in the service's token_file.",
        )
    raise ServiceError(
        address,
        found=f"no answer within {timeout:g} s",
        expected="a running service",
        fix="Start it (puppetline serve), or check its address.",
    )


def _result(address: str, reply: bytes, encoding: Encoding) -> Any:
    try:
        values = json.loads(reply) if encoding == "json" else msgpack.unpackb(reply)
        if values["ok"]:
            return values["result"]
        error = ServiceError(**values["error"])
    except (ValueError, KeyError, TypeError) as mistake:
        raise ServiceError(
            address,
            found="an answer that is not understood",
            expected="a Puppetline service of this version",
            fix="Check the address; the control socket's port follows the stream's.",
        ) from mistake
    raise error
