"""nuitrack-osceleton: Nuitrack's skeletons in messages like OSCeleton's, with the user number before the joint.

Coordinates are a joint's place in the depth image, x to the right and y down, each from 0 to 1, and its depth in
millimetres. The sensor's angle of view, which is not sent, determines the width of the image in metres at that depth;
that of the PrimeSense family is assumed. The program mirrors its image unless started with ``-r``, and *left* is at the
left of the image, as in OSCeleton.
"""

from collections.abc import Mapping

import numpy as np

from capture.network.dialect import PerformerPose, Reading, Units, Values, has_types, joint_part, kinect20, to_metres
from capture.network.osc import Message
from capture.skeleton import TRACKED

IMAGE_SIZE_METRES = 2 * np.tan(np.radians([58.6, 45.6]) / 2)
"""Width and height of the view of a Kinect v1, a PrimeSense or an Astra at a depth of 1 m."""


class Nuitrack:
    """Joints in normalised projective coordinates."""

    bundle_is_frame = True
    mirrors = False
    sends_positions = True

    def read(self, message: Message) -> Reading | None:
        """Read a message; messages about performers are OSCeleton's."""
        if message.address == "/joint" and has_types(message, "isfff"):
            user, name, *values = message.arguments
            return joint_part(name, user, tuple(values))
        return None

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> PerformerPose:
        """Convert joints to a pose; `units` are the units of depth."""
        values = np.array(list(parts.values()))
        depth = to_metres(values[:, 2:], units, "m")[0]
        xy = (values[:, :2] - 0.5) * [1.0, -1.0] * IMAGE_SIZE_METRES * depth
        return kinect20(parts, np.hstack((xy, depth)), TRACKED)
