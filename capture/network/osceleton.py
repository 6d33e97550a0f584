"""OSCeleton: NiTE's skeletons, one bundle a performer a frame.

It has three layouts (as it comes, ``-k`` for Animata, ``-q`` for Quartz Composer) and two scales. Screen coordinates,
which it sends unless told ``-xr``, are x = (1280 − X) / 2560, y = (960 − Y) / 1920 and z = 7.8125 Z / 10000 of
millimetres X, Y, Z; with ``-n``, of a hand alone, x = (480 − X) / 960 and y = (320 − Y) / 640.

X grows to the right of the depth picture, Y up and Z away from the sensor. NiTE takes what it sees for a performer who
faces it as in a mirror, so that *left* is at the left of the picture. With ``-r`` the picture is a mirror: names are
the performer's own, and X is the sensor frame's x. Without, it is the camera's own view, and names and x are exchanged:
the whole body is a mirror's (`Dialect.mirrors`).
"""

import re
from collections.abc import Mapping

import numpy as np

from capture.network.dialect import Gone, Nothing, Pose, Reading, Units, Values, in_metres, joint, kinect20, shape
from capture.network.osc import Message
from capture.skeleton import TRACKED

SCREEN_ORIGIN, SCREEN_SCALE = np.array([1.28, 0.96, 0.0]), np.array([-2.56, -1.92, 1.28])
"""Metres = origin + scale × screen coordinates."""
HAND_ORIGIN, HAND_SCALE = np.array([0.48, 0.32, 0.0]), np.array([-0.96, -0.64, 1.28])

FLAT_DEPTH = 2.5
"""Metres from the sensor to where a performer is put whose depth is not sent (``-k``)."""

_JOINED = re.compile(r"(?P<name>[A-Za-z_]+)(?P<user>\d{0,9})")
_QUARTZ = re.compile(r"/joint/(?P<name>[A-Za-z_]+)/(?P<user>\d{1,9})")
_IGNORED = re.compile(r"/new_user|/new_skel|/user/\d{1,9}|/orient(/[A-Za-z_]+/\d{1,9})?")


class OSCeleton:
    """Its three layouts, of positions in screen coordinates or raw millimetres, and its messages about performers."""

    bundle_is_frame = True
    mirrors = True

    def read(self, message: Message) -> Reading | None:
        """Understand a message."""
        address, _, arguments = message
        tags = shape(message)
        if address == "/joint" and tags == "sifff":
            return joint(arguments[0], arguments[1], arguments[2:])
        if address == "/joint" and tags == "sff":
            joined = _JOINED.fullmatch(str(arguments[0]))
            return joint(joined["name"], int(joined["user"] or 0), arguments[1:]) if joined else "unknown joint"
        if tags in ("fff", "ff") and (quartz := _QUARTZ.fullmatch(address)):
            return joint(quartz["name"], int(quartz["user"]), arguments)
        if address == "/lost_user":
            return self._lost(message)
        return Nothing() if _IGNORED.fullmatch(address) else None

    def _lost(self, message: Message) -> Reading:
        if not message.arguments:  # with -n, where the hand is user 0
            return Gone(0)
        user = message.arguments[0]
        return Gone(user) if shape(message) == "i" and isinstance(user, int) else "wrong arguments"

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> Pose:
        """Make joints into a pose; `units` "screen" or "mm" if it cannot be told from the numbers."""
        values = np.array([(*value, np.nan)[:3] for value in parts.values()])
        positions, found = in_metres(values, units, "screen")
        if found == "screen":
            hand_alone = parts.keys() == {"hand_left"}
            origin, scale = (HAND_ORIGIN, HAND_SCALE) if hand_alone else (SCREEN_ORIGIN, SCREEN_SCALE)
            positions = origin + scale * values
        positions[np.isnan(positions[:, 2]), 2] = FLAT_DEPTH
        return kinect20(parts, positions, TRACKED)
