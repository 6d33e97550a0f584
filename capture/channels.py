"""Channels: named numbers from 0 to 1 beside the joints, such as how loud the performer speaks."""

CHANNELS = (
    "voice",
    "mouth_open",
    "mouth_wide",
    "smile",
    "blink_left",
    "blink_right",
    "brow_up",
    "hand_open_left",
    "hand_open_right",
    "point_left",
    "point_right",
)
"""Names of channels; left and right are the performer's.

``voice`` is measured by `capture.voice`, the others by `capture.trackers.face` and `capture.trackers.hands`.
Senders (`capture.network.channels`) and recordings of the Kinect v2 (`capture.formats`) have some of them too.
"""

FINGERS = ("thumb", "index", "middle", "ring", "little")

FINGER_CHANNELS = tuple(
    f"{finger}_{joint}_{side}" for side in ("left", "right") for finger in FINGERS for joint in (1, 2, 3)
)
"""Names of the channels of the joints of fingers, from the palm to the tip: how far each is bent."""

ALL_CHANNELS = CHANNELS + FINGER_CHANNELS

FULL_BEND_DEGREES = 120.0
"""Bend of a finger's joint from the flat hand at which its channel is 1."""
