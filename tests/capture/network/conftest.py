"""Senders that are independent of the tested code, and a body that walks."""

import socket

import numpy as np
import pytest
from pythonosc.osc_message_builder import OscMessageBuilder

from capture.network import source
from capture.network.source import open_osc, open_vmc
from capture.skeleton import JOINT_INDEX, SkeletonFrame

from ..bodies import STANDS
from ..conftest import Watched


def message(address, tags, *arguments):
    """Write an OSC message with another program's library."""
    builder = OscMessageBuilder(address)
    for tag, argument in zip(tags, arguments, strict=True):
        builder.add_arg(argument, tag)
    return builder.build().dgram


READ = {"s": str, "i": int, "h": int, "f": float, "d": float}


def message_of(line):
    """Write the message of a line: an address, type tags and arguments."""
    address, tags, *words = *line.split(), ""
    return message(address, tags, *(READ[tag](word) for tag, word in zip(tags, words, strict=False)))


def osceleton(name, user, x, y, z):
    return message("/joint", "sifff", name, user, x, y, z)


def kinect_sdk(name, place, confidence=1.0, *, user=2, time=5.0, address="/joint"):
    return message(address, "siiffffd", name, 0, user, *place, confidence, time)


def known(frame):
    """Return the place of each joint that is not lost."""
    return {joint: frame.positions[index].tolist() for joint, index in JOINT_INDEX.items() if frame.confidence[index]}


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

    def refused(self, *datagrams):
        """Send, and return how many were refused until now, by reason."""
        self.settle(*datagrams)
        return self.source.counts.refused

    def close(self):
        self.socket.close()
        self.source.close()


@pytest.fixture
def listen(given_clock, until_end, monkeypatch):
    """Open a source with options on a free port of this machine; the system does not date what arrives."""
    monkeypatch.setattr(source, "MAX_AGE_NS", -1)

    def opened(options="", scheme="osc"):
        return until_end(Wire((open_vmc if scheme == "vmc" else open_osc)(f"127.0.0.1:0{options}")))

    return opened


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def walking(step):
    """Return joints (20, 3) in the sensor frame: from 3 m away towards the sensor and to the performer's right."""
    phase = step * 0.5
    pose = STANDS + np.array([0.3 + 0.04 * step, -0.2 + 0.02 * np.sin(2 * phase), 3.0 - 0.07 * step])
    for side, reach in (("left", 1.0), ("right", -1.0)):
        for joint, share in (("knee", 0.125), ("ankle", 0.25), ("foot", 0.25), ("elbow", -0.1), ("hand", -0.2)):
            pose[JOINT_INDEX[f"{joint}_{side}"], 2] += share * reach * np.sin(phase)
    return pose


WALK = np.array([walking(step) for step in range(12)])


def sided(*parts):
    return {f"{side[0]}_{part}": f"{part}_{side}" for side in ("left", "right") for part in parts}


FIFTEEN = {"head": "head", "neck": "shoulder_center", "torso": "spine"}
FIFTEEN |= sided("shoulder", "elbow", "hand", "hip", "knee", "foot")
"""Joint of each of NiTE's 15 joints, by OSCeleton's names."""

TWENTY = FIFTEEN | sided("wrist", "ankle") | {"waist": "hip_center"}
"""Joint of each of the Kinect SDK's 20 joints, by OSCeleton's names."""


def assert_of_fifteen(positions, confidence, pose):
    """Check joints of a pose of which only NiTE's 15 joints were sent: the others lie between their neighbours."""
    ours = dict(zip(JOINT_INDEX, pose, strict=True))
    made = {"hip_center": (ours["hip_left"] + ours["hip_right"]) / 2}
    for side in ("left", "right"):
        made[f"wrist_{side}"] = 0.25 * ours[f"elbow_{side}"] + 0.75 * ours[f"hand_{side}"]
        made[f"ankle_{side}"] = 0.15 * ours[f"knee_{side}"] + 0.85 * ours[f"foot_{side}"]
    np.testing.assert_allclose(positions, list((ours | made).values()), atol=1e-6)
    np.testing.assert_array_equal(confidence, [0.5 if name in made else 1.0 for name in JOINT_INDEX])
