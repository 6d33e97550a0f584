"""Frames out by the VMC protocol: local rotations and places of Unity's humanoid bones, for one receiver.

The hips carry what the character walks, and the root stays at the origin: so programs do that send a person.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from capture.network.osc import bundle, encode
from engine_bridge.service.protocol.frame import Frame

MOST = 1472
"""Bytes a datagram, which Ethernet carries in one piece."""

LOADED = 1
NORMAL_MODE = 0
CALIBRATION = {"waiting": 0, "calibrating": 2, "performing": 3, "leaving": 0}
"""The protocol's number for each state: not calibrated, being calibrated, calibrated."""

AT_ORIGIN = np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32)
"""A place, and a quaternion."""


def datagrams(frame: Frame, seconds: float) -> Iterator[bytes]:
    """Write a frame; nothing for a character without the limbs of a humanoid.

    Parameters
    ----------
    frame : Frame
    seconds : float
        The sender's clock.

    Yields
    ------
    bytes
        Bundles of no more than `MOST` bytes.
    """
    humanoid = frame.character.humanoid
    if humanoid is None or frame.motions is None:
        return
    placed = np.hstack(humanoid.pose(frame.motions, frame.root)).astype(np.float32)
    tracked = int(frame.state == "performing")
    messages = [
        encode("/VMC/Ext/OK", LOADED, CALIBRATION[frame.state], NORMAL_MODE, tracked),
        encode("/VMC/Ext/T", seconds),
        encode("/VMC/Ext/Root/Pos", "root", AT_ORIGIN),
        *(encode("/VMC/Ext/Bone/Pos", name, values) for name, values in zip(humanoid.names, placed, strict=True)),
    ]
    yield from _bundles(messages)


def _bundles(messages: Sequence[bytes]) -> Iterator[bytes]:
    """Put messages into as few bundles as hold them in their order."""
    waiting: list[bytes] = []
    for message in messages:
        if waiting and len(bundle(*waiting, message)) > MOST:
            yield bundle(*waiting)
            waiting = []
        waiting.append(message)
    yield bundle(*waiting)
