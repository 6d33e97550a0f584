"""Receivers of OSC."""

import socket

import pytest

from engine_bridge.service.outputs.osc import OscOutput, OscTable


@pytest.fixture
def receiver():
    """A socket that takes what targets are sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        made.bind(("127.0.0.1", 0))
        made.setblocking(False)
        yield made


@pytest.fixture
def output(receiver, given_clock, until_end):
    """Open outputs to the receiver."""
    port = receiver.getsockname()[1]
    return lambda **more: until_end(OscOutput(OscTable(port=port, **more)))
