"""The stream of a service over ZeroMQ, with the interface of a WebSocket, for `studio.web.stream_proxy`."""

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import zmq
import zmq.asyncio

from engine_bridge.service.security.endpoints import keep_alive

MAX_TOPIC_CHARACTERS = 63
"""Maximum length of a topic (docs/protocol.md)."""

REFUSED = json.dumps(
    {
        "id": None,
        "ok": False,
        "error": {
            "where": "the stream",
            "found": "no subscription",
            "expected": "subscribe or unsubscribe, with a topic",
            "fix": "Send requests to /api.",
        },
    }
)
"""Error reply to a text that is not a subscription."""


class StreamLink:
    """A connection to a stream; see `streaming`."""

    def __init__(self, socket: "zmq.asyncio.Socket") -> None:
        self._socket = socket
        self._topics: set[str] = set()

    async def send(self, text: str) -> str | None:
        """Subscribe or unsubscribe as a WebSocket client does; return an error reply to any other text."""
        asked = subscription_of(text)
        if asked is None:
            return REFUSED
        key, topic = asked
        if topic in self._topics:  # subscribing again requests the topic again
            self._socket.unsubscribe(topic.encode() + b"\0")
            self._topics.discard(topic)
        if key == "subscribe":
            self._socket.subscribe(topic.encode() + b"\0")
            self._topics.add(topic)
        return None

    async def messages(self) -> AsyncIterator[bytes]:
        """Yield messages as they arrive."""
        while True:
            yield await self._socket.recv()


@asynccontextmanager
async def streaming(address: str, token: str | None) -> AsyncIterator[StreamLink]:
    """Connect to a stream.

    Parameters
    ----------
    address : str
        ``tcp://HOST:PORT``.
    token : str or None
    """
    context = zmq.asyncio.Context()
    try:
        socket = context.socket(zmq.SUB)
        socket.ipv6 = "[" in address
        socket.reconnect_ivl, socket.reconnect_ivl_max = 100, 1000
        keep_alive(socket)
        if token is not None:
            socket.plain_username, socket.plain_password = b"puppetline", token.encode()
        socket.connect(address)
        yield StreamLink(socket)
    finally:
        context.destroy(linger=0)


def subscription_of(text: str) -> tuple[str, str] | None:
    """Return ``subscribe`` or ``unsubscribe`` and the topic of a client's text; None for any other text."""
    try:
        ((key, topic),) = json.loads(text).items()
    except (ValueError, AttributeError, RecursionError):
        return None
    return (key, topic) if key in ("subscribe", "unsubscribe") and _is_topic(topic) else None


def _is_topic(topic: Any) -> bool:
    return isinstance(topic, str) and 0 < len(topic) <= MAX_TOPIC_CHARACTERS and topic.isascii() and "\0" not in topic
