import numpy as np
import pytest

from capture.network.channels import EASE_SECONDS, HOLD_SECONDS, HeldChannels

from .conftest import message

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
    outside = [("sf", "smile", -0.01), ("sf", "smile", 1.01), ("si", "smile", 2)]
    wrong = [("s", "smile"), ("ss", "smile", "1"), ("sff", "smile", 1.0, 1.0)]
    others = ("sf", "mouth", 0.5), ("sf", "smile", np.nan)
    assert wire.refused(*(message(ADDRESS, *each) for each in (*outside, *wrong, *others))) == {
        "unknown channel": 1,
        "channel outside 0 to 1": 3,
        "number not finite": 1,
        "wrong arguments": 3,
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


@pytest.mark.parametrize(
    ("blends", "values"),
    [
        ("A Blink_L Blink_R Joy", (0.5, 0.25, 0.75, 1.0)),
        ("aa blinkLeft blinkRight happy", (0.5, 0.25, 0.75, 1.0)),
        (
            "jawOpen eyeBlinkLeft eyeBlinkRight mouthSmileLeft mouthSmileRight tongueOut",
            (0.5, 0.25, 0.75, 0.5, 1.5, 1.0),
        ),
        ("JawOpen BLINK mouth_smile_left", (-0.5, 0.25, 0.5)),
        ("mouth_open blink_left blink_right smile", (0.5, 0.25, 0.75, 1.0)),
    ],
)
@pytest.mark.parametrize("mirrored", ["", "?mirrored=1"])
def test_blend_shapes_become_channels_when_they_are_applied_and_a_mirroring_sender_has_its_sides_swapped(
    listen, blends, values, mirrored
):
    wire = listen(mirrored, scheme="vmc")
    for each in zip(blends.split(), values, strict=True):
        wire.settle(message("/VMC/Ext/Blend/Val", "sf", *each))
    assert wire.frame(HEAD).channels is None
    wire.settle(message("/VMC/Ext/Blend/Apply", ""))
    expected = (0.0, 0.25, 0.25, 0.5) if "BLINK" in blends else (0.5, 0.25, 0.75, 1.0)
    names = ("mouth_open", *("blink_left", "blink_right")[:: -1 if mirrored else 1], "smile")
    assert wire.frame(HEAD).channels == dict(zip(names, expected, strict=True))
