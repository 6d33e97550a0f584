"""nuitrack-osceleton: Nuitrack's skeletons in OSCeleton's manner, with the performer before the joint.

Coordinates are where a joint stands in the depth picture, x to the right and y down, each 0 to 1, and its depth in
millimetres. The picture's width in metres at that depth follows from the sensor's angle of view, which is not sent:
that of the PrimeSense family is taken. The program makes its picture a mirror unless told ``-r``, and *left* is at the
left of it, as with OSCeleton.
"""

from collections.abc import Mapping

import numpy as np

from capture.network.dialect import Pose, Reading, Units, Values, in_metres, joint, kinect20, shape
from capture.network.osc import Message
from capture.skeleton import TRACKED

PICTURE = 2 * np.tan(np.radians([58.6, 45.6]) / 2)
"""Width and height, metres, of what a Kinect v1, a PrimeSense or an Astra sees at a depth of 1 m."""


class Nuitrack:
    """Joints in normalised projective coordinates."""

    bundle_is_frame = True
    mirrors = False

    def read(self, message: Message) -> Reading | None:
        """Understand a message; those about performers are OSCeleton's."""
        if message.address == "/joint" and shape(message) == "isfff":
            user, name, *place = message.arguments
            return joint(name, user, tuple(place))
        return None

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> Pose:
        """Make joints into a pose; `units` are the depth's."""
        places = np.array(list(parts.values()))
        depth = in_metres(places[:, 2:], units, "m")[0]
        across = (places[:, :2] - 0.5) * [1.0, -1.0] * PICTURE * depth
        return kinect20(parts, np.hstack((across, depth)), TRACKED)
