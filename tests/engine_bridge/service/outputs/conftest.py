"""Receivers of OSC."""

import socket
from contextlib import suppress

import pytest

from engine_bridge.service.outputs.osc import OscOutput, OscTable

from .frames import messages


class Receiver:
    """A socket that takes what targets are sent."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port = self.socket.getsockname()[1]

    def datagrams(self):
        """Return all datagrams that have come."""
        datagrams = []
        with suppress(BlockingIOError):
            while True:
                datagrams.append(self.socket.recv(65536))
        return datagrams

    def messages(self):
        """Return what python-osc reads in them, see `messages`."""
        return messages(self.datagrams())

    def close(self):
        self.socket.close()


@pytest.fixture
def receiver(until_end):
    return until_end(Receiver())


@pytest.fixture
def output(receiver, given_clock, until_end):
    """Open outputs to the receiver."""
    return lambda **more: until_end(OscOutput(OscTable(port=receiver.port, **more)))


@pytest.fixture
def give():
    """Offer frames to an output and have it send what is due."""

    def offer(out, *frames):
        for frame in frames:
            out.offer(frame)
        out.send_due()

    return offer
