"""Outputs of OSC."""

import pytest

from engine_bridge.service.outputs.osc import OscOutput, OscTable


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
