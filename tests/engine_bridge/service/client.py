"""A client of a service."""

import time

import zmq

from engine_bridge.service.protocol.payloads import decode

TIMEOUT_SECONDS = 180.0
"""Time after which a test fails, in seconds; the first start compiles."""


class Client:
    """A client with a SUB socket."""

    def __init__(self, endpoint, *topics):
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.SUB)
        self.socket.linger = self.socket.rcvhwm = 0
        self.socket.reconnect_ivl, self.socket.reconnect_ivl_max = 50, 200
        for topic in topics:
            self.socket.subscribe(topic.encode() + b"\0")
        self.socket.connect(endpoint)

    def until(self, wanted, kind=None):
        """Receive until a message of a kind satisfies a condition; return all messages of that kind."""
        give_up = time.monotonic() + TIMEOUT_SECONDS
        received = []
        while True:
            assert self.socket.poll(max(0, 1000 * (give_up - time.monotonic()))), received[-3:]
            message = decode(self.socket.recv())
            if kind is None or message.topic.endswith(f"/{kind}"):
                received.append(message)
                if wanted(message):
                    return received

    def pending(self):
        """Return the messages that have arrived."""
        received = []
        while self.socket.poll(0):
            received.append(decode(self.socket.recv()))
        return received

    def close(self):
        self.socket.close()
        self.context.term()
