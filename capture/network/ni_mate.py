"""NI mate: one message per joint. The address is the joint's name, usually without a slash.

The number of floats defines their meaning: 3 are a position, 7 a position and a quaternion, 12 a position and a matrix;
1, 4 and 9 contain no position. The user number precedes or follows the name (``2/Left_Hand``, ``Left_Hand_2``),
depending on NI mate's template. ``NI_mate_sync`` ends a frame.

The manual defines neither units nor axes. NI mate's plug-ins for Blender and Unity treat its coordinates as
right-handed, with y up and z towards the viewer. Sensor coordinates are therefore (−x, y, −z): half a turn about y,
which does not swap left and right.
"""

import re
from collections.abc import Mapping

import numpy as np

from capture.network import dialect
from capture.network.osc import Message
from capture.skeleton import TRACKED

TO_SENSOR_COORDINATES = np.array([-1.0, 1.0, -1.0])
WITH_POSITION, WITHOUT_POSITION = ("f" * 3, "f" * 7, "f" * 12), ("f", "f" * 4, "f" * 9)

_ADDRESS = re.compile(
    r"/?((user)?[_/ ]?(?P<before>\d{1,9})[_/ ])?(skeleton_)?(?P<name>[a-z_]+?)([_/ ]?(?P<after>\d{1,9}))?"
)


class NIMate:
    """The formats Basic, Orientation, and both. Animata and OSCeleton formats are OSCeleton's; Omni names no joints."""

    bundle_is_frame = False
    mirrors = False
    sends_positions = True

    def read(self, message: Message) -> dialect.Reading | None:
        """Read a message."""
        match = _ADDRESS.fullmatch(message.address.lower())
        if not match:
            return None
        if match["name"] == "ni_mate_sync":
            return dialect.FrameEnd()
        if match["name"] not in dialect.JOINT_NAMES:
            return None
        if dialect.has_types(message, *WITH_POSITION):
            return dialect.joint_part(match["name"], int(match["before"] or match["after"] or 0), message.arguments[:3])
        return dialect.Ignored() if dialect.has_types(message, *WITHOUT_POSITION) else "wrong arguments"

    def pose(self, parts: Mapping[str, dialect.Values], units: dialect.Units | None) -> dialect.PerformerPose:
        """Convert joints to a pose; without `units`, the size of the numbers decides between metres and millimetres."""
        values = np.array(list(parts.values()))
        return dialect.kinect20(parts, dialect.to_metres(values, units, "m")[0] * TO_SENSOR_COORDINATES, TRACKED)
