"""The control socket, which answers each request of a client once (docs/control.md)."""

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import msgpack
import zmq

from engine_bridge.service.control.requests import (
    WHERE,
    Encoding,
    RequestId,
    decode,
    encode,
    encoding_of,
    error_reply,
    ok_reply,
    take_command,
    take_id,
)
from engine_bridge.service.security.credentials import check_token
from engine_bridge.service.security.endpoints import Endpoint
from puppetline import toml_schema
from puppetline.errors import PuppetlineError, ServiceError
from puppetline.toml_schema import Table

REQUESTS_PER_TURN = 16
BYTES_PER_TURN = 65_536
"""Number and size of requests answered before frames are sent again."""

QUEUED_REQUESTS, QUEUED_REPLIES = 16, 64
"""Maximum queue lengths per client; further requests wait on the client's side, further replies are lost."""

MAX_DEFERRED = 256
"""Maximum number of answers that are given later."""

Command = tuple[type[Table], Callable[[Any], Any]]
"""Model of the arguments, and the function that is called with them; it returns JSON types or a `Deferred`."""

FAILED = ServiceError(
    "the service", found="an internal error", expected="none", fix="Read the log of the service, and report the error."
)
BUSY = ServiceError(
    "the service",
    found="too many pending requests",
    expected="fewer requests at a time",
    fix="Retry in a few seconds.",
)

log = logging.getLogger(__name__)


class Deferred:
    """An answer that a command gives in a later turn of the loop, by `Control.finish`."""


@dataclass
class _Caller:
    """Destination of an answer: the socket, the parts before it, its encoding, and the number of its request."""

    socket: "zmq.Socket[bytes]"
    envelope: list[bytes]
    encoding: Encoding
    request: RequestId = None


class Control:
    """Answers each request with one reply, whatever it contains.

    Parameters
    ----------
    context : zmq.Context
    endpoints : sequence of Endpoint
    commands : mapping
        By name. The client receives a `PuppetlineError`; any other exception is logged.

    Raises
    ------
    zmq.ZMQError
        An endpoint that cannot be bound.
    """

    def __init__(
        self,
        context: "zmq.Context[zmq.Socket[bytes]]",
        endpoints: Sequence[Endpoint],
        commands: Mapping[str, Command],
    ) -> None:
        self._commands = commands
        self._deferred: dict[Deferred, _Caller] = {}
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
        """Read and answer requests, up to `REQUESTS_PER_TURN`."""
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

    def finish(self, deferred: Deferred, outcome: Any) -> None:
        """Send a deferred answer: a result, or the exception that was raised instead."""
        caller = self._deferred.pop(deferred, None)
        if caller is not None:
            self._answer(caller, outcome)

    def close(self) -> None:
        """Close all sockets; closing again does nothing."""
        for socket in self.sockets:
            socket.close(0)
        self.sockets.clear()
        self._deferred.clear()

    def _take(self, socket: "zmq.Socket[bytes]", frames: list[bytes]) -> None:
        """Answer one message: the sender's identity, an empty part if it has a REQ socket, the request."""
        start = 2 if len(frames) > 2 and not frames[1] else 1
        caller = _Caller(socket, frames[:start], encoding_of(frames[start]))
        try:
            if len(frames) > start + 1:
                raise ServiceError(
                    WHERE, found=f"{len(frames) - start} parts", expected="one", fix="Send a request in one part."
                )
            outcome = self._carry_out(caller, frames[start])
        except Exception as error:  # a command must not end the service
            outcome = error
        if not isinstance(outcome, Deferred):
            self._answer(caller, outcome)
        elif len(self._deferred) < MAX_DEFERRED:
            self._deferred[outcome] = caller
        else:
            self._answer(caller, BUSY)

    def _carry_out(self, caller: _Caller, body: bytes) -> Any:
        values = decode(body)
        caller.request = take_id(values)
        model, run = self._commands[take_command(values, self._commands)]
        return run(toml_schema.check(model, values, WHERE, ServiceError))

    def _answer(self, caller: _Caller, outcome: Any) -> None:
        caller.socket.send_multipart([*caller.envelope, _reply(caller, outcome)], zmq.NOBLOCK)


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
        Of its control socket: ``tcp://127.0.0.1:7401``.
    do : str
        See `engine_bridge.service.control.requests.ARGUMENTS`.
    token : str, optional
        Required if the service has one.
    encoding : {"json", "msgpack"}
    timeout : float
        Seconds.
    **arguments
        Arguments of the command.

    Returns
    -------
    JSON
        The result.

    Raises
    ------
    ServiceError
        The service's own error; or no answer, or one that is not understood.
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
        socket.send(encode({"do": do, "id": 1, **arguments}, encoding))
        poller = zmq.Poller()
        poller.register(socket, zmq.POLLIN)
        poller.register(monitor, zmq.POLLIN)
        ready = dict(poller.poll(round(timeout * 1000)))
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


def _reply(caller: _Caller, outcome: Any) -> bytes:
    """Write the answer; an internal error is logged, and the client receives `FAILED`."""
    try:
        if not isinstance(outcome, Exception):
            return encode(ok_reply(caller.request, outcome), caller.encoding)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        outcome = error
    if not isinstance(outcome, PuppetlineError):
        log.error("request failed", exc_info=outcome)
        outcome = FAILED
    return encode(error_reply(caller.request, outcome), caller.encoding)
