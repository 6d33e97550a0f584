"""Client authentication: answers libzmq's ZAP requests (RFC 27) for every new connection.

The guard runs in the service's loop and never waits. While `Guard.handle` is not called, no client is accepted.
"""

import logging
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import zmq
from zmq.utils.monitor import parse_monitor_message

from engine_bridge.service.monitoring.logs import OnceASecond
from engine_bridge.service.monitoring.status import ClientsStatus
from engine_bridge.service.security.endpoints import HANDSHAKE_SECONDS, Endpoint
from puppetline import clock

ZAP_ADDRESS = "inproc://zeromq.zap.01"

REQUESTS_PER_TURN = 64
"""Number of ZAP requests answered before frames are sent again."""

EVENTS_PER_TURN = 1024
"""Number of events of a socket read before frames are sent again."""

SETTLED_SECONDS = HANDSHAKE_SECONDS + 1.0
"""Time after which an open connection has been accepted, in seconds; all others are closed before."""

ACCEPT, LATER, REFUSE, NOT_UNDERSTOOD = b"200", b"300", b"400", b"500"
"""ZAP status codes. A client that receives `REFUSE` gives up; one that is disconnected without it reconnects."""

BROKEN_OFF = zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL


@dataclass
class _Connections:
    """The connections of all stream sockets, or of all control sockets.

    libzmq reports that connections are opened and closed, and that a client asks to be accepted, but not which
    connection that client has.

    Attributes
    ----------
    opened : dict
        Time at which each connection was opened, by its monitor and file descriptor.
    admitted : deque
        Times at which clients were accepted.
    """

    opened: dict[tuple[Any, int], float] = field(default_factory=dict)
    admitted: deque[float] = field(default_factory=deque)

    def count(self, now: float, undecided: int = 0) -> int:
        """Return the number of accepted clients that are connected, where `undecided` connections do not count.

        Clients that are not accepted do not count, even if they keep their connection open.
        """
        while self.admitted and self.admitted[0] < now - SETTLED_SECONDS:
            self.admitted.popleft()
        new = sum(came >= now - SETTLED_SECONDS for came in self.opened.values())
        return len(self.opened) - new + min(max(new - undecided, 0), len(self.admitted))


@dataclass
class _Watched:
    """A socket whose monitor is read."""

    socket: "zmq.Socket[bytes]"
    connections: _Connections
    closed: "Callable[[zmq.Socket[bytes], int], None] | None"


class Guard:
    """Accepts clients with valid credentials, up to a maximum number.

    Parameters
    ----------
    context : zmq.Context
        Context of all guarded sockets; it has no other guard.
    endpoints : sequence of Endpoint
    max_clients : int
        Maximum number of clients connected to the stream, over all endpoints, and to the control socket.

    Attributes
    ----------
    refused : int
        Number of connections refused so far: wrong credentials, too many clients, no handshake.
    """

    def __init__(
        self, context: "zmq.Context[zmq.Socket[bytes]]", endpoints: Sequence[Endpoint], max_clients: int
    ) -> None:
        self.refused = 0
        self._endpoints = {each.mechanism.encode(): each for each in endpoints}
        self._limit = max_clients
        self._connections = {
            domain: _Connections(admitted=deque(maxlen=max_clients)) for domain in (b"stream", b"control")
        }
        self._watched: dict[zmq.Socket[bytes], _Watched] = {}
        self._log = OnceASecond(logging.getLogger(__name__))
        self._socket = context.socket(zmq.ROUTER)
        self._socket.linger = 0
        self._socket.bind(ZAP_ADDRESS)

    @property
    def sockets(self) -> list[zmq.Socket[bytes]]:
        """Sockets to poll for reading, before `handle` is called."""
        return [self._socket, *self._watched]

    @property
    def clients(self) -> ClientsStatus:
        """The clients of the stream, for the status."""
        return ClientsStatus(self._connections[b"stream"].count(clock.now()), self.refused, self._limit)

    def watch(
        self, socket: "zmq.Socket[bytes]", closed: "Callable[[zmq.Socket[bytes], int], None] | None" = None
    ) -> None:
        """Count the connections of a socket that an endpoint has prepared, as soon as it is bound.

        Parameters
        ----------
        socket : zmq.Socket
        closed : callable, optional
            Called with the socket and the file descriptor of each connection that has ended.
        """
        address = f"inproc://guard.{len(self._watched)}"
        socket.monitor(address, zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED | BROKEN_OFF)
        monitor = socket.context.socket(zmq.PAIR)
        monitor.rcvhwm = 0  # if the queue were full, libzmq's thread would wait, with all its other work
        monitor.linger = 0
        monitor.connect(address)
        self._watched[monitor] = _Watched(socket, self._connections[cast(bytes, socket.zap_domain)], closed)

    def handle(self) -> None:
        """Count connections, and answer clients that ask to be accepted, up to `REQUESTS_PER_TURN`."""
        self._count()
        for _ in range(REQUESTS_PER_TURN):
            try:
                frames = self._socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._count()  # the connection that asks was opened before
            if len(frames) >= 4:  # else there is nothing that an answer could refer to
                origin, _, _, request, *_ = frames
                status = self._judge(frames[2:])
                self._socket.send_multipart([origin, b"", b"1.0", request, status, b"", b"", b""], zmq.NOBLOCK)

    def close(self) -> None:
        """Close the guard's own sockets; closing again does nothing."""
        for monitor, watched in self._watched.items():
            if not watched.socket.closed:
                watched.socket.disable_monitor()
            monitor.close()
        self._watched.clear()
        self._socket.close()

    def _judge(self, request: Sequence[bytes]) -> bytes:
        """Return the status code for a request: version, id, domain, address, identity, mechanism and credentials."""
        if len(request) < 6 or request[0] != b"1.0":
            return self._refuse(NOT_UNDERSTOOD, "request not understood", b"")
        _, _, domain, address, _, mechanism, *credentials = request
        connections, endpoint = self._connections.get(domain), self._endpoints.get(mechanism)
        if connections is None or endpoint is None or not endpoint.admits(credentials):
            return self._refuse(REFUSE, "wrong credentials", address)
        now = clock.now()
        if connections.count(now, undecided=1) >= self._limit:
            return self._refuse(LATER, "too many clients", address)
        connections.admitted.append(now)
        return ACCEPT

    def _refuse(self, status: bytes, reason: str, address: bytes) -> bytes:
        self.refused += 1
        self._log.warning("client refused", reason=reason, address=address.decode(errors="replace"))
        return status

    def _count(self) -> None:
        for monitor, watched in self._watched.items():
            for _ in range(EVENTS_PER_TURN):
                try:
                    event = parse_monitor_message(monitor.recv_multipart(zmq.NOBLOCK))
                except zmq.Again:
                    break
                connection = monitor, event["value"]
                if event["event"] == zmq.EVENT_ACCEPTED:
                    watched.connections.opened[connection] = clock.now()
                elif event["event"] == zmq.EVENT_DISCONNECTED:
                    watched.connections.opened.pop(connection, None)
                    if watched.closed is not None:
                        watched.closed(watched.socket, event["value"])
                elif event["event"] & BROKEN_OFF:
                    self.refused += 1
                    self._log.warning("connection without a handshake")
