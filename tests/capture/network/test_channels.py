import numpy as np
import pytest

from capture.network.channels import EASE_SECONDS, HOLD_SECONDS, HeldChannels

from .conftest import message, message_of

ADDRESS = "/puppetline/channel"
HEAD = message("Head", "fff", 0.0, 1.0, -2.0)


@pytest.mark.parametrize(("tags", "value"), [("sf", 0.25), ("sd", 0.25), ("si", 1), ("sf", 0.0)])
def test_a_channel_is_in_the_frames_of_every_performer(listen, tags, value):
    wire = listen()
    wire.settle(message(ADDRESS, tags, "mouth_open", value), message(ADDRESS, "sf", "blink_left", 0.5))
    for user in (1, 2):
        frame = wire.frame(message(f"Head_{user}", "fff", 0.0, 1.0, -2.0))
        assert (frame.user, frame.channels) == (user, {"mouth_open": value, "blink_left": 0.5})
    assert not wire.source.counts.refused


def test_unknown_channels_and_values_outside_are_refused(listen):
    wire = listen()
    lines = "sf smile -0.01", "sf smile 1.01", "si smile 2", "sf mouth 0.5", "sf smile nan", "s smile", "ss smile 1"
    assert wire.refused(*(message_of(f"{ADDRESS} {line}") for line in lines)) == {
        "unknown channel": 1,
        "channel outside 0 to 1": 3,
        "number not finite": 1,
        "wrong arguments": 2,
    }
    assert wire.frame(HEAD).channels is None


def test_a_value_holds_for_a_while_and_then_eases_to_0():
    channels = HeldChannels()
    assert channels.at(5.0) is None
    channels.add({"smile": 0.8, "voice": 0.5}, 10.0)
    channels.add({"voice": 0.4}, 10.0 + HOLD_SECONDS)
    times = 10.0 + HOLD_SECONDS + np.array([0.0, EASE_SECONDS, 100 * EASE_SECONDS])
    eased = [channels.at(time) for time in times]
    assert [each["smile"] for each in eased] == pytest.approx([0.8, 0.8 / np.e, 0.0])
    assert [each["voice"] for each in eased] == pytest.approx([0.4, 0.4, 0.0])


BLENDS = [
    "A 0.5 Blink_L 0.25 Blink_R 0.75 Joy 1",
    "aa 0.5 blinkLeft 0.25 blinkRight 0.75 happy 1",
    "jawOpen 0.5 eyeBlinkLeft 0.25 eyeBlinkRight 0.75 mouthSmileLeft 0.5 mouthSmileRight 1.5 tongueOut 1",
    "JawOpen -0.5 BLINK 0.25 mouth_smile_left 0.5",
    "mouth_open 0.5 blink_left 0.25 blink_right 0.75 smile 1",
]


@pytest.mark.parametrize("blends", BLENDS)
@pytest.mark.parametrize("mirrored", ["", "?mirrored=1"])
def test_blend_shapes_become_channels_when_they_are_applied_and_a_mirroring_sender_has_its_sides_swapped(
    listen, blends, mirrored
):
    wire, words = listen(mirrored, scheme="vmc"), blends.split()
    for name, value in zip(words[::2], words[1::2], strict=True):
        wire.settle(message_of(f"/VMC/Ext/Blend/Val sf {name} {value}"))
    assert wire.frame(HEAD).channels is None
    wire.settle(message("/VMC/Ext/Blend/Apply", ""))
    expected = (0.0, 0.25, 0.25, 0.5) if "BLINK" in blends else (0.5, 0.25, 0.75, 1.0)
    names = ("mouth_open", *("blink_left", "blink_right")[:: -1 if mirrored else 1], "smile")
    assert wire.frame(HEAD).channels == dict(zip(names, expected, strict=True))
