"""Requests to a service's control socket from an event loop."""

import asyncio
import contextlib
from itertools import count
from typing import Any

import zmq
import zmq.asyncio

from engine_bridge.service.control.requests import encode
from puppetline.errors import ServiceError

REPLY_SECONDS = 30.0
"""Maximum time for a reply in seconds; a reload computes models."""


class ControlLink:
    """A connection to a control socket; several requests may wait for their replies.

    Parameters
    ----------
    address : str
        Address of the control socket, such as ``tcp://127.0.0.1:7401``.
    token : str or None
    """

    def __init__(self, address: str, token: str | None) -> None:
        self._numbers = count(1)
        self._waiting: dict[int, asyncio.Future[Any]] = {}
        self._context = zmq.asyncio.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.linger = 0
        self._socket.immediate = True  # nothing is queued for a service that does not run
        self._socket.ipv6 = "[" in address
        if token is not None:
            self._socket.plain_username, self._socket.plain_password = b"puppetline", token.encode()
        self._socket.connect(address)
        self._reader = asyncio.create_task(self._read())

    async def request(self, do: str, timeout: float = REPLY_SECONDS, **arguments: Any) -> Any:
        """Send a request, and return its result.

        Raises
        ------
        ServiceError
            The service's own error, no reply within `timeout` seconds, or the connection was closed.
        """
        number = next(self._numbers)
        sending = asyncio.ensure_future(self._socket.send(encode({"do": do, "id": number, **arguments}, "json")))
        reply = self._waiting[number] = asyncio.get_running_loop().create_future()
        try:
            async with asyncio.timeout(timeout):
                answer = await reply  # and not `sending`, which closing the socket cancels, and whoever waits for it
        except TimeoutError as error:
            raise ServiceError(
                "the service", found=f"no reply within {timeout:g} s", expected="a running service", fix="Try again."
            ) from error
        finally:
            sending.cancel()
            del self._waiting[number]
        if not answer["ok"]:
            raise ServiceError(**answer["error"])
        return answer["result"]

    async def close(self) -> None:
        """Close the connection; requests that wait fail."""
        self._reader.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._reader
        for reply in self._waiting.values():
            if not reply.done():
                reply.set_exception(
                    ServiceError(
                        "the service",
                        found="a service that has ended",
                        expected="a running service",
                        fix="Try again in a second.",
                    )
                )
        self._context.destroy(linger=0)

    async def _read(self) -> None:
        import json

        while True:
            body = await self._socket.recv()
            with contextlib.suppress(ValueError):
                answer = json.loads(body)
                reply = self._waiting.get(answer.get("id"))
                if reply is not None and not reply.done():
                    reply.set_result(answer)
