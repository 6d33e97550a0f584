"""VMC protocol 3.1, of Virtual Motion Capture and other programs: local rotations of Unity's humanoid bones.

A port receives one performer. Positions follow by forward kinematics with a typical body (`capture.network.humanoid`),
because the lengths of the bones sent are those of an avatar. The position of the hips is used as sent, relative to the
root. Unity's axes become sensor coordinates as (x, y, −z): an avatar that faces +z is a performer who faces the sensor.
The origin is the sender's.

A bone keeps its rotation until it is sent again. As the protocol requires, additional arguments and other addresses are
ignored; messages with fewer arguments are refused. Blend shapes become channels when they are applied.
"""

import math
from collections.abc import Mapping

import numpy as np

from capture.network import dialect, humanoid
from capture.network.channels import BLEND_CHANNELS, channels_of_blends, plain_name
from capture.network.osc import Message
from capture.skeleton import INFERRED, LOST, TRACKED

USER = 0
TO_SENSOR_COORDINATES = np.array([1.0, 1.0, -1.0])
BAD_TRACKING_STATUS = 0
"""Value of the fourth argument of ``/VMC/Ext/OK`` while tracking is bad."""

_BONE_TAGS = "s" + "f" * 7  # a name, a position and a quaternion x, y, z, w
_QUATERNION_LENGTHS = 0.5, 2.0  # accepted for a unit quaternion
_ROOT: dialect.Values = (0.0, 0.0, 0.0, *humanoid.IDENTITY)


class Vmc:
    """The bones received so far, the blend shapes that are not applied yet, and the sender's status."""

    bundle_is_frame = False
    mirrors = False
    sends_positions = False

    def __init__(self) -> None:
        self._bones: dict[str, dialect.Values] = {}
        self._blends: dict[str, float] = {}
        self._loaded = True
        self._confidence = TRACKED

    def read(self, message: Message) -> dialect.Reading | None:
        """Read a message."""
        address = message.address
        if not address.startswith("/VMC/"):
            return None
        if address == "/VMC/Ext/OK":
            return self._status(message)
        if address.startswith("/VMC/Ext/Blend/"):
            return self._blend(message)
        if address not in ("/VMC/Ext/Bone/Pos", "/VMC/Ext/Root/Pos"):
            return dialect.Ignored()
        if not dialect.has_types(message, _BONE_TAGS, more=True):
            return "wrong arguments"
        bone, *values = message.arguments[:8]
        name = "Root" if address == "/VMC/Ext/Root/Pos" else str(bone)
        if not self._loaded or name not in ("Root", "Hips", *humanoid.SKELETON):
            return dialect.Ignored()
        length = math.hypot(*values[3:])
        if not _QUATERNION_LENGTHS[0] < length < _QUATERNION_LENGTHS[1]:
            return "wrong arguments"
        self._bones[name] = (*values[:3], *(value / length for value in values[3:]))
        return dialect.Part(USER, name, self._bones[name])

    def _blend(self, message: Message) -> dialect.Reading:
        if message.address == "/VMC/Ext/Blend/Apply":
            channels = channels_of_blends(self._blends)
            self._blends.clear()
            return dialect.ChannelValues(channels)
        if message.address != "/VMC/Ext/Blend/Val":
            return dialect.Ignored()
        if not dialect.has_types(message, "sf", more=True):
            return "wrong arguments"
        name = plain_name(message.arguments[0])
        if name in BLEND_CHANNELS:
            self._blends[name] = message.arguments[1]
        return dialect.Ignored()

    def _status(self, message: Message) -> dialect.Reading:
        if not dialect.has_types(message, "i", more=True):
            return "wrong arguments"
        is_bad = dialect.has_types(message, "iiii", more=True) and message.arguments[3] == BAD_TRACKING_STATUS
        self._confidence = INFERRED if is_bad else TRACKED
        self._loaded = message.arguments[0] != 0
        if self._loaded:
            return dialect.Ignored()
        self._bones.clear()
        return dialect.PerformerLost(USER)

    def pose(self, parts: Mapping[str, dialect.Values], units: dialect.Units | None) -> dialect.PerformerPose:  # noqa: ARG002 - metres, by the protocol
        """Pose the bones of this frame and those received before."""
        bones = {**self._bones, **parts}
        root_position, root_rotation = _split(bones.get("Root", _ROOT))
        position, rotation = _split(bones.get("Hips", _ROOT))
        place = humanoid.transformed(root_position, root_rotation, position)
        hips = place, humanoid.quaternion_product(root_rotation, rotation)
        rotations = {name: _split(values)[1] for name, values in bones.items()}
        positions = np.array(humanoid.joint_positions(hips, rotations)) * TO_SENSOR_COORDINATES
        confidence = [self._confidence if humanoid.DRIVING_BONES[joint] in bones else LOST for joint in humanoid.JOINTS]
        return dialect.kinect20(humanoid.JOINTS, positions, np.array(confidence, dtype=np.float32))


def _split(values: dialect.Values) -> tuple[tuple[float, float, float], humanoid.Quaternion]:
    x, y, z, a, b, c, d = values
    return (x, y, z), (a, b, c, d)
