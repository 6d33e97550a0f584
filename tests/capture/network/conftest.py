"""Senders that are independent of the tested code, and a body that walks."""

import socket
import struct
from contextlib import ExitStack

import numpy as np
import pytest

from capture.network.source import open_osc, open_vmc
from capture.skeleton import JOINT_INDEX, SkeletonFrame

from ..bodies import STANDING
from ..conftest import Watched


def _pad(data):
    return data + bytes(4 - len(data) % 4)


def message(address, tags, *arguments):
    """Write an OSC message byte for byte, as in the specification."""
    data = _pad(address.encode()) + _pad(b"," + tags.encode())
    for tag, argument in zip(tags, arguments, strict=True):
        data += _pad(argument.encode()) if tag == "s" else struct.pack(f">{'q' if tag == 'h' else tag}", argument)
    return data


def bundle(*elements, time_tag=1):
    return b"#bundle\0" + struct.pack(">Q", time_tag) + b"".join(struct.pack(">i", len(e)) + e for e in elements)


class Wire(Watched):
    """An open source, and a socket that sends to it."""

    def __init__(self, source):
        super().__init__(source)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, *datagrams):
        for datagram in datagrams:
            self.socket.sendto(datagram, ("127.0.0.1", self.source.port))

    def events(self, *datagrams, count=1, until=None):
        """Send, and wait like a caller until a number of events, without ticks, have arrived."""
        self.send(*datagrams)
        return super().events(count, until)

    def frame(self, *datagrams):
        [frame] = self.events(*datagrams)
        assert isinstance(frame, SkeletonFrame)
        return frame

    def settle(self, *datagrams):
        """Send, and return the events until all datagrams have arrived."""
        arrived = self.source.counts.received + len(datagrams)
        return self.events(*datagrams, until=lambda _: self.source.counts.received >= arrived)

    def close(self):
        self.socket.close()
        self.source.close()


@pytest.fixture
def osc_message():
    return message


@pytest.fixture
def osc_bundle():
    return bundle


@pytest.fixture
def listen():
    """Open a source with options on a free port of this machine."""
    with ExitStack() as stack:

        def opened(options="", scheme="osc"):
            wire = Wire((open_vmc if scheme == "vmc" else open_osc)(f"127.0.0.1:0{options}"))
            stack.callback(wire.close)
            return wire

        yield opened


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def walk():
    """(T, 20, 3) metres in the sensor frame: from 3 m away towards the sensor and to the performer's right."""
    standing = np.array([STANDING[name] for name in JOINT_INDEX])
    frames = []
    for step in range(12):
        phase = step * 0.5
        pose = standing + np.array([0.3 + 0.04 * step, -0.2 + 0.02 * np.sin(2 * phase), 3.0 - 0.07 * step])
        for name, reach in (("left", 1.0), ("right", -1.0)):
            for joint, share in (("knee", 0.5), ("ankle", 1.0), ("foot", 1.0)):
                pose[JOINT_INDEX[f"{joint}_{name}"], 2] += 0.25 * reach * share * np.sin(phase)
            for joint, share in (("elbow", 0.5), ("wrist", 0.9), ("hand", 1.0)):
                pose[JOINT_INDEX[f"{joint}_{name}"], 2] -= 0.2 * reach * share * np.sin(phase)
        frames.append(pose)
    return np.array(frames)


def sided(*parts):
    return {f"{side[0]}_{part}": f"{part}_{side}" for side in ("left", "right") for part in parts}


FIFTEEN = {"head": "head", "neck": "shoulder_center", "torso": "spine"}
FIFTEEN |= sided("shoulder", "elbow", "hand", "hip", "knee", "foot")
"""Joint of each of NiTE's 15 joints, by OSCeleton's names."""

TWENTY = FIFTEEN | sided("wrist", "ankle") | {"waist": "hip_center"}
"""Joint of each of the Kinect SDK's 20 joints, by OSCeleton's names."""


@pytest.fixture
def fifteen():
    return FIFTEEN


@pytest.fixture
def twenty():
    return TWENTY


@pytest.fixture
def assert_of_fifteen():
    """Check a frame of a pose of which only NiTE's 15 joints were sent: the others lie between their neighbours."""

    def check(frame, user, pose):
        ours = {name: pose[index] for name, index in JOINT_INDEX.items()}
        ours["hip_center"] = (ours["hip_left"] + ours["hip_right"]) / 2
        for side in ("left", "right"):
            ours[f"wrist_{side}"] = 0.25 * ours[f"elbow_{side}"] + 0.75 * ours[f"hand_{side}"]
            ours[f"ankle_{side}"] = 0.15 * ours[f"knee_{side}"] + 0.85 * ours[f"foot_{side}"]
        confidence = [
            0.5 if name == "hip_center" or name.startswith(("wrist", "ankle")) else 1.0 for name in JOINT_INDEX
        ]
        assert frame.user == user
        np.testing.assert_allclose(frame.positions, list(ours.values()), atol=1e-6)
        assert frame.confidence.tolist() == confidence

    return check
