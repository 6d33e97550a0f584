"""The output over ZeroMQ, the stream: clients subscribe, and only what they subscribe to is computed.

Nothing here waits: a client that does not read loses messages, and does not slow down the others (docs/protocol.md).
"""

from collections.abc import Sequence

import zmq

from engine_bridge.service.monitoring.status import OutputStatus
from engine_bridge.service.outputs.output import Opening, Output, OutputTable
from engine_bridge.service.outputs.stream import Stream, StreamOutput
from engine_bridge.service.protocol.header import FRAME_KINDS
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.security.endpoints import Endpoint, NetworkSettings

QUEUED_FRAMES = 2
"""Number of frames per character and kind that are queued for a slow client; later ones are dropped for it."""

QUEUED_OTHERS = 8
"""Number of further messages, such as scenes, queued for a client."""

SEND_BUFFER_BYTES = 128 * 1024
"""Size of the system's send buffer per client; what waits there is old when it arrives."""

REQUESTS_PER_TURN = 256
"""Number of subscriptions read before frames are sent again."""


class NetworkTable(NetworkSettings, OutputTable):
    """[network]: where the stream and the control socket listen, and which clients may connect."""

    def open(self, opening: Opening) -> Output:
        """Open the stream; see `ZeroMqOutput`."""
        output = ZeroMqOutput(opening.context, opening.endpoints, opening.characters)
        for socket in output.sockets:
            opening.guard.watch(socket, output.forget)
        return output


class ZeroMqOutput(StreamOutput[zmq.Socket[bytes]]):
    """Sends characters to the clients that subscribe to them.

    Parameters
    ----------
    context : zmq.Context
    endpoints : sequence of Endpoint
        One socket is bound per endpoint.
    characters : sequence of StreamedCharacter
        See `announce`.

    Raises
    ------
    zmq.ZMQError
        An endpoint cannot be bound.
    """

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        endpoints: Sequence[Endpoint],
        characters: Sequence[StreamedCharacter],
    ) -> None:
        super().__init__()
        self._messages = self._bytes = 0
        waiting = QUEUED_FRAMES * len(FRAME_KINDS) * len(characters) + QUEUED_OTHERS
        try:
            for endpoint in endpoints:
                self._open(context.socket(zmq.XPUB), endpoint, waiting)
        except zmq.ZMQError:
            self.close()
            raise
        self.announce(characters)

    def _open(self, socket: zmq.Socket[bytes], endpoint: Endpoint, waiting: int) -> None:
        self._streams[socket] = Stream()
        socket.setsockopt(zmq.XPUB_VERBOSER, 1)
        socket.setsockopt(zmq.SNDHWM, waiting)
        socket.setsockopt(zmq.SNDBUF, SEND_BUFFER_BYTES)
        socket.setsockopt(zmq.LINGER, 0)
        endpoint.prepare(socket)
        socket.bind(endpoint.stream)

    @property
    def sockets(self) -> list[zmq.Socket[bytes]]:
        """One socket per endpoint, in their order."""
        return list(self._streams)

    @property
    def endpoints(self) -> list[str]:
        """Addresses that clients connect to, with their actual ports."""
        return [bytes(socket.getsockopt(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode() for socket in self._streams]

    @property
    def statistics(self) -> OutputStatus:
        """Messages and bytes so far; libzmq does not report what it drops for slow clients."""
        return OutputStatus("zeromq", " ".join(self.endpoints), self._messages, self._bytes, None, 0)

    def handle(self, socket: zmq.Socket[bytes]) -> None:
        """Read subscriptions, up to `REQUESTS_PER_TURN`, and answer those that ask for something."""
        stream = self._streams[socket]
        for _ in range(REQUESTS_PER_TURN):
            try:
                request = socket.recv(zmq.NOBLOCK, copy=False)
            except zmq.Again:
                break
            self._take(stream, request.bytes, _connection(request))
        self.send_due()

    def _take(self, stream: Stream, request: bytes, connection: int | None) -> None:
        if request[:1] == b"\x01" and connection is not None:
            self._subscribe(stream, request[1:], connection)
        elif request[:1] == b"\x00":
            self._unsubscribe(stream, request[1:], connection)

    def forget(self, socket: zmq.Socket[bytes], connection: int) -> None:
        """Forget a client that has disconnected: the next one may have the same number."""
        if socket in self._streams:
            self._streams[socket].subscriptions.forget(connection)

    def close(self) -> None:
        """Close all sockets; closing again does nothing."""
        for socket in self._streams:
            socket.close(0)
        self._streams.clear()

    def _send(self, socket: zmq.Socket[bytes], *parts: bytes) -> None:
        message = b"".join(parts)
        socket.send(message, zmq.NOBLOCK)
        self._messages += 1
        self._bytes += len(message)


def _connection(request: zmq.Frame) -> int | None:
    """Return the number of the connection that a subscription came from; None if the connection has ended."""
    try:
        return int(request.get(zmq.SRCFD))
    except zmq.ZMQError:
        return None
