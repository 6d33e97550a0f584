"""Frames and endpoints for tests of outputs, without a service."""

import numpy as np

from engine_bridge.service.protocol.frame import Frame
from puppetline import clock


def frame_of(character, sequence=0, **more):
    """Return a frame of a character that waits in its rest pose, or one with other values."""
    values = {
        "time": sequence / 30,
        "received": clock.now_ns(),
        "state": "waiting",
        "user": None,
        "R": character.rig.model.rest_controls,
        "root": np.zeros(3),
        "targets": character.rig.puppet.handle_positions,
    }
    return Frame(character=character, sequence=sequence, **values | more)


class Open:
    """An address without credentials, at any free port."""

    def __init__(self, stream="tcp://127.0.0.1:*"):
        self.stream = stream

    def prepare(self, socket):
        socket.maxmsgsize = 1024
