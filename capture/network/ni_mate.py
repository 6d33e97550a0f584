"""NI mate: a message a joint, whose address is the joint's name, commonly without a slash.

The number of floats says what they are: 3 a position, 7 a position and a quaternion, 12 a position and a matrix; 1, 4
and 9 tell no position. A performer's number may stand before the name or after it (``2/Left_Hand``, ``Left_Hand_2``),
as the user's template has it. ``NI_mate_sync`` ends a frame.

Its manual says neither units nor axes. Its plug-ins for Blender and Unity turn its coordinates as those of a
right-handed frame with y up and z towards the viewer, so the sensor frame is (−x, y, −z): half a turn about y, which
keeps left and right what they are.
"""

import re
from collections.abc import Mapping

import numpy as np

from capture.network.dialect import (
    NAMES,
    FrameEnd,
    Nothing,
    Pose,
    Reading,
    Units,
    Values,
    in_metres,
    joint,
    kinect20,
    shape,
)
from capture.network.osc import Message
from capture.skeleton import TRACKED

TO_SENSOR_FRAME = np.array([-1.0, 1.0, -1.0])
WITH_POSITION, WITHOUT_POSITION = ("f" * 3, "f" * 7, "f" * 12), ("f", "f" * 4, "f" * 9)

_ADDRESS = re.compile(
    r"/?((user)?[_/ ]?(?P<before>\d{1,9})[_/ ])?(skeleton_)?(?P<name>[a-z_]+?)([_/ ]?(?P<after>\d{1,9}))?"
)


class NIMate:
    """Its formats Basic, Orientation, and both; Animata and OSCeleton are read as OSCeleton's, Omni names no joints."""

    bundle_is_frame = False
    mirrors = False

    def read(self, message: Message) -> Reading | None:
        """Understand a message."""
        match = _ADDRESS.fullmatch(message.address.lower())
        if not match:
            return None
        if match["name"] == "ni_mate_sync":
            return FrameEnd()
        if match["name"] not in NAMES:
            return None
        tags = shape(message)
        if tags in WITH_POSITION:
            return joint(match["name"], int(match["before"] or match["after"] or 0), message.arguments[:3])
        return Nothing() if tags in WITHOUT_POSITION else "wrong arguments"

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> Pose:
        """Make joints into a pose; without `units`, metres or millimetres by the size of the numbers."""
        values = np.array(list(parts.values()))
        return kinect20(parts, in_metres(values, units, "m")[0] * TO_SENSOR_FRAME, TRACKED)
