"""Channels from OSC: Puppetline's own message, and the blend shapes of VMC by their names in VRM and ARKit.

Senders describe a state, so a value holds for a short time after its last message and then eases to 0.
"""

import math
from collections.abc import Mapping

from capture.channels import ALL_CHANNELS
from capture.network.dialect import ChannelValues, Refusal, has_types
from capture.network.osc import Message

ADDRESS = "/puppetline/channel"

HOLD_SECONDS, EASE_SECONDS = 0.5, 0.1
"""Time for which a value holds after its message, and time constant with which it then falls to 0."""

_BLINKS = {"l": ("blink_left",), "left": ("blink_left",), "r": ("blink_right",), "right": ("blink_right",)}
BLEND_CHANNELS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("a", "aa", "jawopen"), ("mouth_open",)),
    **dict.fromkeys(("i", "ih", "e", "ee", "mouthstretchleft", "mouthstretchright"), ("mouth_wide",)),
    **dict.fromkeys(("joy", "happy", "mouthsmileleft", "mouthsmileright"), ("smile",)),
    **dict.fromkeys(("browinnerup", "surprised"), ("brow_up",)),
    "blink": ("blink_left", "blink_right"),
    **{f"{prefix}blink{side}": channels for side, channels in _BLINKS.items() for prefix in ("", "eye")},
    **{name.replace("_", ""): (name,) for name in ALL_CHANNELS},
}
"""Channels of blend shapes by name in VRM 0, VRM 1 and ARKit, and our own; lower case, without underscores."""


def read_channel(message: Message) -> ChannelValues | Refusal | None:
    """Read ``/puppetline/channel NAME v``; return None for other addresses."""
    if message.address != ADDRESS:
        return None
    if not has_types(message, "sf"):
        return "wrong arguments"
    name, value = message.arguments
    if name not in ALL_CHANNELS:
        return "unknown channel"
    return ChannelValues({name: float(value)}) if 0 <= value <= 1 else "channel outside 0 to 1"


def plain_name(blend: str) -> str:
    """Return the name of a blend shape as in `BLEND_CHANNELS`."""
    return blend.lower().replace("_", "")


def channels_of_blends(blends: Mapping[str, float]) -> dict[str, float]:
    """Return the channels of plainly named blend shapes: the largest of each channel's, clipped to [0, 1]."""
    channels: dict[str, float] = {}
    for blend, value in blends.items():
        for channel in BLEND_CHANNELS[blend]:
            channels[channel] = max(channels.get(channel, 0.0), min(value, 1.0))
    return channels


class HeldChannels:
    """The channels that have arrived, with the time of each."""

    def __init__(self) -> None:
        self._values: dict[str, tuple[float, float]] = {}

    def add(self, values: Mapping[str, float], time: float) -> None:
        """Take values that arrived at a time, in seconds."""
        self._values.update((name, (value, time)) for name, value in values.items())

    def at(self, time: float) -> dict[str, float] | None:
        """Return the values at a time; None if no channel has ever arrived."""
        eased = {
            name: value * math.exp(-max(time - arrival - HOLD_SECONDS, 0.0) / EASE_SECONDS)
            for name, (value, arrival) in self._values.items()
        }
        return eased or None
