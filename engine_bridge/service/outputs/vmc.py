"""Frames in the VMC protocol: local rotations and positions of Unity's humanoid bones, and blend shapes.

The hips have the character's root motion, and the root stays at the origin, as in other programs that send VMC.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from capture.network.osc import bundle, encode
from engine_bridge.service.protocol.frame import Frame

DATAGRAM_BYTES = 1472
"""Maximum size of a datagram that Ethernet carries in one piece, in bytes."""

LOADED = 1
NORMAL_MODE = 0
CALIBRATION = {"waiting": 0, "calibrating": 2, "performing": 3, "leaving": 0}
"""The protocol's number for each state: not calibrated, being calibrated, calibrated."""

AT_ORIGIN = np.array([0, 0, 0, 0, 0, 0, 1], dtype=np.float32)
"""Position (x, y, z) and rotation (a unit quaternion x, y, z, w) of the root."""


def datagrams(frame: Frame, seconds: float) -> Iterator[bytes]:
    """Write a frame; nothing for a character without the limbs of a humanoid.

    Parameters
    ----------
    frame : Frame
    seconds : float
        Time on the sender's clock, in seconds.

    Yields
    ------
    bytes
        Bundles of no more than `DATAGRAM_BYTES` bytes.
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
    weights = zip(frame.character.rig.puppet.targets, frame.targets_moved.tolist(), strict=True)
    blends = [encode("/VMC/Ext/Blend/Val", name, weight) for name, weight in weights]
    messages += [*blends, encode("/VMC/Ext/Blend/Apply")] if blends else []
    yield from _bundles(messages)


def _bundles(messages: Sequence[bytes]) -> Iterator[bytes]:
    """Put messages, in their order, into as few bundles as hold them."""
    waiting: list[bytes] = []
    for each in messages:
        if waiting and len(bundle(*waiting, each)) > DATAGRAM_BYTES:
            yield bundle(*waiting)
            waiting = []
        waiting.append(each)
    yield bundle(*waiting)
