"""Frames and endpoints for tests of outputs, without a service."""

import numpy as np
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage

from engine_bridge.export.live_basis import Projection
from engine_bridge.service.protocol.frame import Frame
from puppetline import clock


def frame_of(character, sequence=0, **more):
    """Return a frame of a character that waits in its rest pose, or one with other values."""
    values = {
        "time": sequence / 30,
        "received": clock.now_ns(),
        "state": "waiting",
        "user": None,
        "R": character.prepared.model.rest_controls,
        "root": np.zeros(3),
        "targets": character.prepared.puppet.handle_positions,
    }
    return Frame(character=character, sequence=sequence, **values | more)


class Open:
    """An address without credentials, at any free port."""

    def __init__(self, stream="tcp://127.0.0.1:*"):
        self.stream = stream

    def prepare(self, socket):
        socket.maxmsgsize = 1024


class Basis:
    """Three morph targets, whatever the pose."""

    names = ("a", "b", "c")

    def project(self, R):
        return Projection(np.array([0.5, 0, 1], dtype=np.float32), 0.125, False)


def received(receiver):
    """Return all datagrams that have come."""
    datagrams = []
    while True:
        try:
            datagrams.append(receiver.recv(65536))
        except BlockingIOError:
            return datagrams


def messages(datagrams):
    """Return what python-osc reads in datagrams: address and arguments, in their order."""
    contents = (OscBundle(each) if each.startswith(b"#bundle") else [OscMessage(each)] for each in datagrams)
    return [(message.address, message.params) for messages in contents for message in messages]
