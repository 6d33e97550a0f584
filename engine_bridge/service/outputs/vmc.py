"""Frames in the VMC protocol: local rotations and positions of Unity's humanoid bones, and blend shapes.

The hips have the character's root motion, and the root stays at the origin, as in other programs that send VMC. If the
performer's fingers are measured, the hands have fingers with an adult's proportions.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from capture.channels import FINGERS, FULL_BEND_DEGREES
from capture.network.osc import bundle, encode
from engine_bridge.service.protocol.frame import Frame

DATAGRAM_BYTES = 1472
"""Maximum size of a datagram that Ethernet carries in one piece, in bytes."""

LOADED = 1
NORMAL_MODE = 0
CALIBRATION = {"waiting": 0, "calibrating": 2, "performing": 3, "leaving": 0}
"""The protocol's number for each state: not calibrated, being calibrated, calibrated."""

FOREARM_METRES, PHALANX_METRES = 0.25, 0.03
"""Lengths of an adult's forearm and of the bones of a finger, in metres."""

KNUCKLES_METRES = {
    "thumb": (0.02, 0.03),
    "index": (0.088, 0.03),
    "middle": (0.094, 0.01),
    "ring": (0.09, -0.01),
    "little": (0.08, -0.03),
}
"""Places of an adult's knuckles in a T-pose, from the wrist outwards and forward, in metres."""

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
    if humanoid is None:
        return
    placed = np.hstack(humanoid.pose(frame.pose.bones, frame.pose.root)).astype(np.float32)
    tracked = int(frame.state == "performing")
    messages = [
        encode("/VMC/Ext/OK", LOADED, CALIBRATION[frame.state], NORMAL_MODE, tracked),
        encode("/VMC/Ext/T", seconds),
        encode("/VMC/Ext/Root/Pos", "root", AT_ORIGIN),
        *(encode("/VMC/Ext/Bone/Pos", name, values) for name, values in zip(humanoid.names, placed, strict=True)),
    ]
    messages += _fingers(frame, dict(zip(humanoid.names, placed, strict=True)))
    weights = zip(frame.character.prepared.puppet.targets, frame.targets_moved.tolist(), strict=True)
    blends = [encode("/VMC/Ext/Blend/Val", name, weight) for name, weight in weights]
    messages += [*blends, encode("/VMC/Ext/Blend/Apply")] if blends else []
    yield from _bundles(messages)


def _fingers(frame: Frame, placed: dict[str, NDArray[np.float32]]) -> Iterator[bytes]:
    """Write the measured joints of fingers. Palms are down in a T-pose: fingers bend about z, thumbs about y."""
    channels = frame.pose.channels or {}
    for side, out in (("left", -1.0), ("right", 1.0)):
        name = side.title()
        hand = placed.get(f"{name}Hand")
        if hand is None or f"index_1_{side}" not in channels:
            continue
        size = float(np.linalg.norm(hand[:3])) / FOREARM_METRES
        for finger in FINGERS:
            for k, part in enumerate(("Proximal", "Intermediate", "Distal"), 1):
                angle = math.radians(FULL_BEND_DEGREES) * channels.get(f"{finger}_{k}_{side}", 0.0)
                turn = -out * math.sin(angle / 2)
                axis = (0.0, -turn, 0.0) if finger == "thumb" else (0.0, 0.0, turn)
                along, ahead = KNUCKLES_METRES[finger] if k == 1 else (PHALANX_METRES, 0.0)
                values = np.array([size * out * along, 0.0, size * ahead, *axis, math.cos(angle / 2)], np.float32)
                yield encode("/VMC/Ext/Bone/Pos", f"{name}{finger.title()}{part}", values)


def _bundles(messages: Sequence[bytes]) -> Iterator[bytes]:
    """Put messages, in their order, into as few bundles as hold them."""
    waiting: list[bytes] = []
    for each in messages:
        if waiting and len(bundle(*waiting, each)) > DATAGRAM_BYTES:
            yield bundle(*waiting)
            waiting = []
        waiting.append(each)
    yield bundle(*waiting)
