"""OSCeleton-KinectSDK and OSCeleton-KinectSDK2: the 20 joints of Microsoft's SDKs, one datagram per joint.

A message has joint, sensor, performer, x, y and z in millimetres (the manuals say centimetres, but the code multiplies
metres by 1000), a confidence (1 tracked, 0.5 inferred, 0.1 not tracked), and a time in milliseconds that is equal in
all joints of a frame. The axes are those of sensor coordinates, except that y points down. Neither program mirrors
performers or reports that a performer has left.
"""

from collections.abc import Mapping

import numpy as np

from capture.network.dialect import (
    Ignored,
    PerformerPose,
    Reading,
    Units,
    Values,
    has_types,
    joint_part,
    kinect20,
    to_metres,
)
from capture.network.osc import Message
from capture.skeleton import INFERRED, LOST

JOINTS = ("/joint", "/osceleton2/joint")
IGNORED = (
    *("/face", "/face_animation"),
    *("/osceleton2/hand", "/osceleton2/face_rotation", "/osceleton2/face_property"),
)


class KinectSDK:
    """Joints with confidence and time of either SDK."""

    bundle_is_frame = False
    mirrors = False
    sends_positions = True

    def read(self, message: Message) -> Reading | None:
        """Read a message."""
        if message.address in JOINTS and has_types(message, "siifffff"):
            name, _, user, x, y, z, confidence, time = message.arguments
            return joint_part(name, user, (x, y, z, confidence), time)
        return Ignored() if message.address in IGNORED else None

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> PerformerPose:
        """Convert joints to a pose."""
        values = np.array(list(parts.values()))
        positions = to_metres(values[:, :3], units, "m")[0] * [1.0, -1.0, 1.0]
        confidence = np.where(values[:, 3] < INFERRED, LOST, np.minimum(values[:, 3], 1.0))
        return kinect20(parts, positions, confidence.astype(np.float32))
