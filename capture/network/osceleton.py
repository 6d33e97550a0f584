"""OSCeleton: NiTE's skeletons, one bundle per performer and frame.

OSCeleton has three layouts (the default, ``-k`` for Animata, ``-q`` for Quartz Composer) and two scales. It sends
screen coordinates unless started with ``-xr``. From millimetres X, Y, Z they are x = (1280 − X) / 2560, y = (960 − Y) /
1920 and z = 7.8125 Z / 10000. For a single hand (``-n``) they are x = (480 − X) / 960 and y = (320 − Y) / 640.

X points to the right of the depth image, Y up and Z away from the sensor. NiTE names sides as in a mirror: *left* is at
the left of the image. With ``-r`` the image is mirrored, so names are correct and X is the x of sensor coordinates.
Without ``-r`` the image is the camera's view, so names and x are swapped: the skeleton is mirrored (`Dialect.mirrors`).
"""

import re
from collections.abc import Mapping

import numpy as np

from capture.network import dialect
from capture.network.osc import Message
from capture.skeleton import TRACKED

SCREEN_ORIGIN, SCREEN_SCALE = np.array([1.28, 0.96, 0.0]), np.array([-2.56, -1.92, 1.28])
"""Conversion of a skeleton: metres = origin + scale × screen coordinates."""
HAND_ORIGIN, HAND_SCALE = np.array([0.48, 0.32, 0.0]), np.array([-0.96, -0.64, 1.28])
"""The same conversion of a single hand."""

DEFAULT_DEPTH_METRES = 2.5
"""Distance from the sensor of a performer whose depth is not sent (``-k``)."""

_JOINED = re.compile(r"(?P<name>[A-Za-z_]+)(?P<user>\d{0,9})")
_QUARTZ = re.compile(r"/joint/(?P<name>[A-Za-z_]+)/(?P<user>\d{1,9})")
_IGNORED = re.compile(r"/new_user|/new_skel|/user/\d{1,9}|/orient(/[A-Za-z_]+/\d{1,9})?")


class OSCeleton:
    """The three layouts, with positions in screen coordinates or millimetres, and messages about performers."""

    bundle_is_frame = True
    mirrors = True
    sends_positions = True

    def read(self, message: Message) -> dialect.Reading | None:
        """Read a message."""
        address, _, arguments = message
        if address == "/joint" and dialect.has_types(message, "sifff"):
            return dialect.joint_part(arguments[0], arguments[1], arguments[2:])
        if address == "/joint" and dialect.has_types(message, "sff"):
            joined = _JOINED.fullmatch(str(arguments[0]))
            if joined is None:
                return "unknown joint"
            return dialect.joint_part(joined["name"], int(joined["user"] or 0), arguments[1:])
        if dialect.has_types(message, "fff", "ff") and (quartz := _QUARTZ.fullmatch(address)):
            return dialect.joint_part(quartz["name"], int(quartz["user"]), arguments)
        if address == "/lost_user":
            return self._lost(message)
        return dialect.Ignored() if _IGNORED.fullmatch(address) else None

    def _lost(self, message: Message) -> dialect.Reading:
        if not message.arguments:  # with -n, the hand is user 0
            return dialect.PerformerLost(0)
        user = message.arguments[0]
        if dialect.has_types(message, "i") and isinstance(user, int):
            return dialect.PerformerLost(user)
        return "wrong arguments"

    def pose(self, parts: Mapping[str, dialect.Values], units: dialect.Units | None) -> dialect.PerformerPose:
        """Convert joints to a pose; `units` "screen" or "mm" replaces the detection by size."""
        values = np.array([(*value, np.nan)[:3] for value in parts.values()])
        positions, found = dialect.to_metres(values, units, "screen")
        if found == "screen":
            hand_alone = parts.keys() == {"hand_left"}
            origin, scale = (HAND_ORIGIN, HAND_SCALE) if hand_alone else (SCREEN_ORIGIN, SCREEN_SCALE)
            positions = origin + scale * values
        positions[np.isnan(positions[:, 2]), 2] = DEFAULT_DEPTH_METRES
        return dialect.kinect20(parts, positions, TRACKED)
