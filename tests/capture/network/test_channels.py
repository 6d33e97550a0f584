import numpy as np
import pytest

from capture.network.channels import EASE_SECONDS, HOLD_SECONDS, HeldChannels

ADDRESS = "/puppetline/channel"
HEAD = ("Head", "fff", 0.0, 1.0, -2.0)


@pytest.mark.parametrize(("tags", "value"), [("sf", 0.25), ("sd", 0.25), ("si", 1), ("sf", 0.0)])
def test_a_channel_is_in_the_frames_of_every_performer(listen, osc_message, tags, value):
    wire = listen()
    wire.settle(osc_message(ADDRESS, tags, "mouth_open", value), osc_message(ADDRESS, "sf", "blink_left", 0.5))
    for user in (1, 2):
        frame = wire.frame(osc_message(f"Head_{user}", *HEAD[1:]))
        assert (frame.user, frame.channels) == (user, {"mouth_open": value, "blink_left": 0.5})
    assert not wire.source.counts.refused


def test_unknown_channels_and_values_outside_are_refused(listen, osc_message):
    wire = listen()
    wire.settle(
        osc_message(ADDRESS, "sf", "mouth", 0.5),
        *(osc_message(ADDRESS, "sf", "smile", value) for value in (-0.01, 1.01)),
        osc_message(ADDRESS, "si", "smile", 2),
        osc_message(ADDRESS, "sf", "smile", np.nan),
        *(osc_message(ADDRESS, *wrong) for wrong in (("s", "smile"), ("ss", "smile", "1"), ("sff", "smile", 1, 1))),
    )
    assert wire.source.counts.refused == {
        "unknown channel": 1,
        "channel outside 0 to 1": 3,
        "number not finite": 1,
        "wrong arguments": 3,
    }
    assert wire.frame(osc_message(*HEAD)).channels is None


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
    ("blends", "expected"),
    [
        ({"A": 0.5, "Blink_L": 0.25, "Blink_R": 0.75, "Joy": 1.0}, (0.5, 0.25, 0.75, 1.0)),
        ({"aa": 0.5, "blinkLeft": 0.25, "blinkRight": 0.75, "happy": 1.0}, (0.5, 0.25, 0.75, 1.0)),
        (
            {
                "jawOpen": 0.5,
                "eyeBlinkLeft": 0.25,
                "eyeBlinkRight": 0.75,
                "mouthSmileLeft": 0.5,
                "mouthSmileRight": 1.5,
                "tongueOut": 1.0,
            },
            (0.5, 0.25, 0.75, 1.0),
        ),
        ({"JawOpen": -0.5, "BLINK": 0.25, "mouth_smile_left": 0.5}, (0.0, 0.25, 0.25, 0.5)),
        ({"mouth_open": 0.5, "blink_left": 0.25, "blink_right": 0.75, "smile": 1.0}, (0.5, 0.25, 0.75, 1.0)),
    ],
)
def test_blend_shapes_become_channels_when_they_are_applied(listen, osc_message, blends, expected):
    wire = listen(scheme="vmc")
    wire.settle(*(osc_message("/VMC/Ext/Blend/Val", "sf", name, value) for name, value in blends.items()))
    assert wire.frame(osc_message(*HEAD)).channels is None
    wire.settle(osc_message("/VMC/Ext/Blend/Apply", ""))
    names = ("mouth_open", "blink_left", "blink_right", "smile")
    assert wire.frame(osc_message(*HEAD)).channels == dict(zip(names, expected, strict=True))


def test_a_mirroring_sender_has_its_sides_swapped(listen, osc_message):
    wire = listen("?mirrored=1", scheme="vmc")
    wire.settle(
        osc_message("/VMC/Ext/Blend/Val", "sf", "Blink_L", 1.0),
        osc_message("/VMC/Ext/Blend/Val", "sf", "A", 0.5),
        osc_message("/VMC/Ext/Blend/Apply", ""),
    )
    assert wire.frame(osc_message(*HEAD)).channels == {"blink_right": 1.0, "mouth_open": 0.5}
