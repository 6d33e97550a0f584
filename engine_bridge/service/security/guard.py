"""Who may come in: libzmq asks (ZAP, RFC 27) about everybody who connects, and the guard answers.

It lives in the loop of the service like everything else and never waits. While nobody calls `Guard.handle`, nobody
comes in.
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import zmq
from zmq.utils.monitor import parse_monitor_message

from engine_bridge.service.monitoring.logs import OnceASecond
from engine_bridge.service.security.endpoints import HANDSHAKE, Door

ENDPOINT = "inproc://zeromq.zap.01"

AT_A_TIME = 64
"""Questions that are answered before frames have their turn again."""

EVENTS_AT_A_TIME = 1024
"""Of a socket's comings and goings."""

SETTLED = HANDSHAKE + 1.0
"""Seconds after which a connection that is still there has been let in: all others are cut off before."""

YES, LATER, NO, NOT_UNDERSTOOD = b"200", b"300", b"400", b"500"
"""A client that hears `NO` gives up; one that is cut off without a word tries again."""

BROKEN_OFF = zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL


@dataclass
class _Crowd:
    """The connections of all stream sockets, or of all control sockets.

    libzmq tells who comes and goes, and that somebody was let in, but not which connection that was.

    Attributes
    ----------
    opened : dict
        When each connection came, by its monitor and file descriptor.
    admitted : deque
        When somebody was let in.
    """

    opened: dict[tuple[Any, int], float] = field(default_factory=dict)
    admitted: deque[float] = field(default_factory=deque)

    def size(self, now: float, knocking: int = 0) -> int:
        """Count those that have been let in and are still there, of which `knocking` connections are none.

        Strangers that keep a connection open do not count.
        """
        while self.admitted and self.admitted[0] < now - SETTLED:
            self.admitted.popleft()
        new = sum(came >= now - SETTLED for came in self.opened.values())
        return len(self.opened) - new + min(max(new - knocking, 0), len(self.admitted))


class Guard:
    """Lets in whom a door admits, while there is room.

    Parameters
    ----------
    context : zmq.Context
        Of all sockets that it guards, which has no other guard.
    doors : sequence of Door
    max_clients : int
        How many may be connected to the stream, whichever door they took, and as many to the control socket.

    Attributes
    ----------
    socket : zmq.Socket
        Readable when somebody is at a door.
    refused : int
        Connections so far that were not let in: no credentials, no room, no handshake.
    """

    def __init__(self, context: "zmq.Context[zmq.Socket[bytes]]", doors: Sequence[Door], max_clients: int) -> None:
        self.refused = 0
        self._doors = {door.mechanism.encode(): door for door in doors}
        self._limit = max_clients
        self.gone: Callable[[zmq.Socket[bytes], int], None] = lambda _socket, _connection: None
        """Told when a connection of a socket has ended, by its file descriptor."""
        self._crowds = {kind: _Crowd(admitted=deque(maxlen=max_clients)) for kind in (b"stream", b"control")}
        self._monitors: dict[zmq.Socket[bytes], tuple[zmq.Socket[bytes], _Crowd]] = {}
        self._log = OnceASecond(logging.getLogger(__name__))
        self.socket = context.socket(zmq.ROUTER)
        self.socket.linger = 0
        self.socket.bind(ENDPOINT)

    @property
    def clients(self) -> dict[str, int]:
        """Who is connected to the stream, who was refused so far anywhere, and the limit: for the statistics."""
        return {
            "connected": self._crowds[b"stream"].size(time.monotonic()),
            "refused": self.refused,
            "limit": self._limit,
        }

    def watch(self, socket: "zmq.Socket[bytes]") -> "zmq.Socket[bytes]":
        """Count the connections of a socket that a door has prepared; call it as soon as it is bound.

        Returns
        -------
        zmq.Socket
            Readable when somebody has come or gone.
        """
        endpoint = f"inproc://guard.{len(self._monitors)}"
        socket.monitor(endpoint, zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED | BROKEN_OFF)
        monitor = socket.context.socket(zmq.PAIR)
        monitor.rcvhwm = 0  # libzmq's thread waits, with everything else it has to do, where there is no room
        monitor.linger = 0
        monitor.connect(endpoint)
        self._monitors[monitor] = socket, self._crowds[cast(bytes, socket.zap_domain)]
        return monitor

    def handle(self) -> None:
        """Take note of who has come and gone, and answer who is at a door; not too many at a time."""
        self._count()
        for _ in range(AT_A_TIME):
            try:
                frames = self.socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._count()  # who asks has come before
            if len(frames) >= 4:  # else there is nothing that an answer could refer to
                origin, _, _, request, *_ = frames
                status = self._judge(frames[2:])
                self.socket.send_multipart([origin, b"", b"1.0", request, status, b"", b"", b""], zmq.NOBLOCK)

    def close(self) -> None:
        """Let go of all sockets that are its own; closing again does nothing."""
        for monitor, (socket, _) in self._monitors.items():
            if not socket.closed:
                socket.disable_monitor()
            monitor.close()
        self._monitors.clear()
        self.socket.close()

    def _judge(self, request: Sequence[bytes]) -> bytes:
        """Decide about version, request id, domain, address, identity, mechanism and credentials."""
        if len(request) < 6 or request[0] != b"1.0":
            return self._refuse(NOT_UNDERSTOOD, "question not understood", b"")
        _, _, domain, address, _, mechanism, *credentials = request
        crowd, door = self._crowds.get(domain), self._doors.get(mechanism)
        if crowd is None or door is None or not door.admits(credentials):
            return self._refuse(NO, "wrong credentials", address)
        now = time.monotonic()
        if crowd.size(now, knocking=1) >= self._limit:
            return self._refuse(LATER, "too many clients", address)
        crowd.admitted.append(now)
        return YES

    def _refuse(self, status: bytes, reason: str, address: bytes) -> bytes:
        self.refused += 1
        self._log.warning("client refused", reason=reason, address=address.decode(errors="replace"))
        return status

    def _count(self) -> None:
        for monitor, (socket, crowd) in self._monitors.items():
            for _ in range(EVENTS_AT_A_TIME):
                try:
                    event = parse_monitor_message(monitor.recv_multipart(zmq.NOBLOCK))
                except zmq.Again:
                    break
                connection = monitor, event["value"]
                if event["event"] == zmq.EVENT_ACCEPTED:
                    crowd.opened[connection] = time.monotonic()
                elif event["event"] == zmq.EVENT_DISCONNECTED:
                    crowd.opened.pop(connection, None)
                    self.gone(socket, event["value"])
                elif event["event"] & BROKEN_OFF:
                    self.refused += 1
                    self._log.warning("connection without a handshake")
