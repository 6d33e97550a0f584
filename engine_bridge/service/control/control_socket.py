"""The control socket: clients ask for something, and get one answer each (docs/control.md)."""

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
from engine_bridge.service.security.endpoints import Door, check_token
from puppetline import toml_schema
from puppetline.errors import PuppetlineError, ServiceError
from puppetline.toml_schema import Table

AT_A_TIME = 16
BYTES_AT_A_TIME = 65_536
"""Requests, and bytes of them, after which frames have their turn again."""

REQUESTS_WAITING, REPLIES_WAITING = 16, 64
"""For one client; what comes on top waits on its side, or is lost to it."""

MOST_DEFERRED = 256
"""Answers that may be due later."""

Command = tuple[type[Table], Callable[[Any], Any]]
"""What arguments it takes, and what is called with them: it returns a result of JSON's types or a `Deferred`."""


FAILED = ServiceError(
    "the service", found="an unforeseen error", expected="none", fix="Look into the log of the service, and report it."
)
BUSY = ServiceError(
    "the service", found="too many requests that wait", expected="some patience", fix="Ask again in a few seconds."
)

log = logging.getLogger(__name__)


class Deferred:
    """An answer that a command will give in a later turn of the loop, by `Control.finish`."""


@dataclass
class _Caller:
    """Where an answer goes: the socket, the parts that stand before it, how it is written, and what it refers to."""

    socket: "zmq.Socket[bytes]"
    envelope: list[bytes]
    encoding: Encoding
    request: RequestId = None


class Control:
    """Answers requests, each with one reply, whatever it holds.

    Parameters
    ----------
    context : zmq.Context
    doors : sequence of Door
    commands : mapping
        By name. A `PuppetlineError` is told to whoever asked, any other exception is logged.

    Raises
    ------
    zmq.ZMQError
        An endpoint that cannot be bound.
    """

    def __init__(
        self,
        context: "zmq.Context[zmq.Socket[bytes]]",
        doors: Sequence[Door],
        commands: Mapping[str, Command],
    ) -> None:
        self._commands = commands
        self._deferred: dict[Deferred, _Caller] = {}
        self.sockets: list[zmq.Socket[bytes]] = []
        """What to poll for reading: one socket a door, in their order."""
        try:
            for door in doors:
                self._open(context, door)
        except zmq.ZMQError:
            self.close()
            raise

    def _open(self, context: "zmq.Context[zmq.Socket[bytes]]", door: Door) -> None:
        socket = context.socket(zmq.ROUTER)
        self.sockets.append(socket)
        socket.linger = 0
        socket.rcvhwm = REQUESTS_WAITING
        socket.sndhwm = REPLIES_WAITING
        door.prepare(socket)
        socket.bind(door.control)

    @property
    def endpoints(self) -> list[str]:
        """Where clients connect to, in the order of the doors."""
        return [cast(bytes, socket.last_endpoint).rstrip(b"\0").decode() for socket in self.sockets]

    def handle(self, socket: "zmq.Socket[bytes]") -> None:
        """Take requests that have come in, not too many at a time, and answer them."""
        taken = 0
        for _ in range(AT_A_TIME):
            try:
                frames = socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._take(socket, frames)
            taken += sum(map(len, frames))
            if taken >= BYTES_AT_A_TIME:
                return

    def finish(self, deferred: Deferred, outcome: Any) -> None:
        """Give an answer that was put off: a result, or the exception that came instead."""
        caller = self._deferred.pop(deferred, None)
        if caller is not None:
            self._answer(caller, outcome)

    def close(self) -> None:
        """Close all doors; closing again does nothing."""
        for socket in self.sockets:
            socket.close(0)
        self.sockets.clear()
        self._deferred.clear()

    def _take(self, socket: "zmq.Socket[bytes]", frames: list[bytes]) -> None:
        """Answer one message: who sent it, an empty part (of a REQ socket) or none, the request."""
        start = 2 if len(frames) > 2 and not frames[1] else 1
        caller = _Caller(socket, frames[:start], encoding_of(frames[start]))
        try:
            if len(frames) > start + 1:
                raise ServiceError(
                    WHERE, found=f"{len(frames) - start} parts", expected="one", fix="Send a request in one part."
                )
            outcome = self._carry_out(caller, frames[start])
        except Exception as error:  # whatever a command does, the service goes on
            outcome = error
        if not isinstance(outcome, Deferred):
            self._answer(caller, outcome)
        elif len(self._deferred) < MOST_DEFERRED:
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
    """Ask a service for something, and wait for its answer.

    Parameters
    ----------
    address : str
        Of its control socket: ``tcp://127.0.0.1:7401``.
    do : str
        See `engine_bridge.service.control.requests.ARGUMENTS`.
    token : str, optional
        Where the service asks for one.
    encoding : {"json", "msgpack"}
    timeout : float
        Seconds.
    **arguments
        What belongs to the command.

    Returns
    -------
    JSON
        The result.

    Raises
    ------
    ServiceError
        The service's own, if it refuses; or there is no answer, or none that is understood.
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
            address, found=f"no address ({error})", expected="tcp://HOST:PORT", fix="Write tcp://127.0.0.1:7401, say."
        ) from error
    finally:
        context.destroy(linger=0)
    if monitor in ready:
        raise ServiceError(
            address,
            found="a service that does not let this client in",
            expected="a token if it asks for one, and none if not",
            fix="Give the token of the service, which its token_file holds.",
        )
    raise ServiceError(
        address,
        found=f"no answer within {timeout:g} s",
        expected="a service that runs there",
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
            found="an answer that makes no sense",
            expected="a Puppetline service of this version",
            fix="Check the address; the control socket's port follows the stream's.",
        ) from mistake
    raise error


def _reply(caller: _Caller, outcome: Any) -> bytes:
    """Write the answer; what only the service's own log should say is a general error."""
    try:
        if not isinstance(outcome, Exception):
            return encode(ok_reply(caller.request, outcome), caller.encoding)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        outcome = error
    if not isinstance(outcome, PuppetlineError):
        log.error("request failed", exc_info=outcome)
        outcome = FAILED
    return encode(error_reply(caller.request, outcome), caller.encoding)
