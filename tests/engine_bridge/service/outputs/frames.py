"""Frames and endpoints for tests of outputs, without a service."""

import numpy as np
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage

from engine_bridge.export.live_basis import Projection
from engine_bridge.performance.pose import Pose
from engine_bridge.service.protocol.frame import Frame
from puppetline import clock


def frame_of(character, sequence=0, **more):
    """Return a frame of a character that waits in its rest pose, or one with other values."""
    values = {
        "time": sequence / 30,
        "received": clock.now_ns(),
        "state": "waiting",
        "user": None,
        "pose": pose_of(character.prepared),
    }
    return Frame(character=character, sequence=sequence, **values | more)


def pose_of(prepared, **more):
    """Return the rest pose of a character, or one with other values."""
    model, handles = prepared.model, prepared.puppet.handle_positions
    values = {"targets": handles, "bones": np.tile(np.eye(4, 3), (len(model.bones), 1, 1)), "root": np.zeros(3)}
    return Pose(**values | {"R": model.rest_controls, "model": model} | more)


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


def messages(datagrams):
    """Return what python-osc reads in datagrams: address and arguments, in their order."""
    contents = (OscBundle(each) if each.startswith(b"#bundle") else [OscMessage(each)] for each in datagrams)
    return [(message.address, message.params) for messages in contents for message in messages]
