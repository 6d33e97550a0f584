"""OSCeleton-KinectSDK and OSCeleton-KinectSDK2: the 20 joints of Microsoft's SDKs, each in a datagram of its own.

Joint, sensor, performer, x, y, z in millimetres (their manuals say centimetres, their code multiplies metres by 1000),
a confidence (1 tracked, 0.5 inferred, 0.1 not tracked) and a time in milliseconds, which is the same in all joints of a
frame. Their axes are the sensor frame's but for y, which they turn down. Neither mirrors, and neither says who has
gone.
"""

from collections.abc import Mapping

import numpy as np

from capture.network.dialect import Nothing, Pose, Reading, Units, Values, in_metres, joint, kinect20, shape
from capture.network.osc import Message
from capture.skeleton import INFERRED, LOST

JOINTS = ("/joint", "/osceleton2/joint")
IGNORED = (
    *("/face", "/face_animation"),
    *("/osceleton2/hand", "/osceleton2/face_rotation", "/osceleton2/face_property"),
)


class KinectSDK:
    """Joints with confidence and time, of either SDK."""

    bundle_is_frame = False
    mirrors = False

    def read(self, message: Message) -> Reading | None:
        """Understand a message."""
        if message.address in JOINTS and shape(message) == "siifffff":
            name, _, user, x, y, z, confidence, time = message.arguments
            return joint(name, user, (x, y, z, confidence), time)
        return Nothing() if message.address in IGNORED else None

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> Pose:
        """Make joints into a pose."""
        values = np.array(list(parts.values()))
        positions = in_metres(values[:, :3], units, "m")[0] * [1.0, -1.0, 1.0]
        sure = np.where(values[:, 3] < INFERRED, LOST, np.minimum(values[:, 3], 1.0))
        return kinect20(parts, positions, sure.astype(np.float32))
