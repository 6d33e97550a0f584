"""VMC protocol 3.1, of Virtual Motion Capture and many others: local rotations of Unity's humanoid bones.

A port is one performer's. Positions come from forward kinematics over a body of our own proportions
(`capture.network.humanoid`), because bones' lengths are an avatar's and not the performer's. The hips are where they
are sent, in the root's frame. Unity's axes become the sensor frame's as (x, y, −z): an avatar that faces +z is a
performer who faces the sensor. The origin is the sender's.

A bone keeps its rotation until it is sent again. As the protocol demands of receivers, arguments beyond those that it
names are ignored and so are addresses other than those read here; fewer arguments are refused.
"""

import math
from collections.abc import Mapping

import numpy as np

from capture.network.dialect import Gone, Nothing, Part, Pose, Reading, Units, Values, kinect20, shape
from capture.network.humanoid import IDENTITY, JOINTS, MOVED_BY, SKELETON, Quaternion, moved, places, product
from capture.network.osc import Message
from capture.skeleton import INFERRED, LOST, TRACKED

PERFORMER = 0
TO_SENSOR_FRAME = np.array([1.0, 1.0, -1.0])
BAD_TRACKING = 0
"""The fourth argument of ``/VMC/Ext/OK``."""

_PLACED = "s" + "f" * 7  # a name, a position and a quaternion x, y, z, w
_LENGTHS = 0.5, 2.0  # of what is meant as a unit quaternion
_ROOT: Values = (0.0, 0.0, 0.0, *IDENTITY)


class Vmc:
    """The bones that have come so far, and what the sender says of its state."""

    bundle_is_frame = False
    mirrors = False

    def __init__(self) -> None:
        self._bones: dict[str, Values] = {}
        self._loaded = True
        self._certainty = TRACKED

    def read(self, message: Message) -> Reading | None:
        """Understand a message."""
        address = message.address
        if not address.startswith("/VMC/"):
            return None
        if address == "/VMC/Ext/OK":
            return self._status(message)
        if address not in ("/VMC/Ext/Bone/Pos", "/VMC/Ext/Root/Pos"):
            return Nothing()
        if not shape(message).startswith(_PLACED):
            return "wrong arguments"
        bone, *values = message.arguments[:8]
        name = "Root" if address == "/VMC/Ext/Root/Pos" else str(bone)
        if not self._loaded or name not in ("Root", "Hips", *SKELETON):
            return Nothing()
        length = math.hypot(*values[3:])
        if not _LENGTHS[0] < length < _LENGTHS[1]:
            return "wrong arguments"
        self._bones[name] = (*values[:3], *(value / length for value in values[3:]))
        return Part(PERFORMER, name, self._bones[name])

    def _status(self, message: Message) -> Reading:
        tags = shape(message)
        if not tags.startswith("i"):
            return "wrong arguments"
        self._certainty = INFERRED if tags.startswith("iiii") and message.arguments[3] == BAD_TRACKING else TRACKED
        self._loaded = message.arguments[0] != 0
        if self._loaded:
            return Nothing()
        self._bones.clear()
        return Gone(PERFORMER)

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> Pose:  # noqa: ARG002 - metres, by the protocol
        """Pose the bones, those of this frame and those that stay."""
        bones = {**self._bones, **parts}
        root_place, root_turn = _split(bones.get("Root", _ROOT))
        place, turn = _split(bones.get("Hips", _ROOT))
        hips = moved(root_place, root_turn, place), product(root_turn, turn)
        rotations = {name: _split(values)[1] for name, values in bones.items()}
        positions = np.array(places(hips, rotations)) * TO_SENSOR_FRAME
        sure = [self._certainty if MOVED_BY[joint] in bones else LOST for joint in JOINTS]
        return kinect20(JOINTS, positions, np.array(sure, dtype=np.float32))


def _split(values: Values) -> tuple[tuple[float, float, float], Quaternion]:
    x, y, z, a, b, c, d = values
    return (x, y, z), (a, b, c, d)
