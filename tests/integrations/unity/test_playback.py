"""Frames that come unevenly are shown evenly, a little later, and mixed where none is due."""

import json

import pytest

from ...recorded import VECTORS

SCENE = VECTORS / "scene.bin"
AHEAD = 1000.0
"""This machine's clock is that far ahead of the source's."""


@pytest.fixture
def play_back(run_core):
    """Give a playback frames [time, arrived, value], and ask at some moments what is shown; return (value, changed)."""

    def run(delay, *steps):
        told = json.dumps({"scene": str(SCENE), "delay": delay, "steps": steps})
        return [(each["value"], each["changed"]) for each in run_core("playback", told=told)]

    return run


def came(time, value, late=0.0):
    return [time, AHEAD + time + late, value]


def test_there_is_nothing_before_something_has_come(play_back):
    assert play_back(0.1, AHEAD) == [(None, False)]


def test_without_delay_the_newest_frame_is_shown_as_it_is_and_once(play_back):
    steps = [came(0.0, 5.0), AHEAD, AHEAD + 0.01, came(0.1, 6.0), came(0.2, 7.0), AHEAD + 0.2]
    assert play_back(0.0, *steps) == [(5, True), (5, False), (7, True)]


def test_between_two_frames_there_is_a_mixture_of_them_by_the_sources_time(play_back):
    frames = [came(0.0, 0.0), came(0.1, 10.0), came(0.3, 20.0)]
    moments = [AHEAD + 0.4 + t for t in (0.0, 0.025, 0.1, 0.15, 0.2, 0.3, 0.35)]
    shown = [value for value, _ in play_back(0.4, *frames, *moments)]
    assert shown == pytest.approx([0, 2.5, 10, 12.5, 15, 20, 20], abs=0.02)


def test_frames_that_were_late_on_the_way_are_shown_in_their_time(play_back):
    """Sixty frames a second whose value is their time, up to 40 ms late; shown 60 ms after, at another rate."""
    lateness = (0.0, 0.031, 0.015, 0.04, 0.024, 0.008, 0.0)
    steps = [came(number / 60, number / 60, lateness[number % 7]) for number in range(120)]
    asked = [AHEAD + number / 75 for number in range(140)]
    steps = sorted([*steps, *asked], key=lambda step: step if isinstance(step, float) else step[1])
    shown = play_back(0.06, *steps)
    for moment, (value, _) in list(zip(asked, shown, strict=True))[20:]:
        assert value == pytest.approx(moment - AHEAD - 0.06, abs=0.002)


def test_a_source_that_begins_anew_is_followed_from_its_beginning(play_back):
    steps = [came(50.0, 1.0), came(50.1, 2.0), AHEAD + 50.1, [0.0, AHEAD + 51, 3.0], AHEAD + 51.2]
    assert play_back(0.05, *steps)[-1] == (3, True)


def test_a_source_that_has_stood_still_goes_on_at_once(play_back):
    """Ten seconds without a frame, and the source's clock has stood still as well."""
    steps = [
        came(0.0, 1.0),
        came(0.1, 2.0),
        [0.2, AHEAD + 10.2, 3.0],
        AHEAD + 10.25,
        [0.3, AHEAD + 10.3, 4.0],
        AHEAD + 10.35,
    ]
    assert [value for value, _ in play_back(0.05, *steps)] == pytest.approx([3, 4], abs=0.02)


def test_frames_that_nobody_looks_at_do_not_pile_up(play_back):
    steps = [came(number / 30, float(number)) for number in range(1000)]
    assert play_back(30.0, *steps, AHEAD + 40) == [(744, True)]


def test_a_second_of_a_fast_source_can_wait(play_back):
    steps = [came(number / 240, number / 240) for number in range(960)]
    ((value, _),) = play_back(1.0, *steps, AHEAD + 959 / 240)
    assert value == pytest.approx(959 / 240 - 1.0, abs=0.002)


def test_frames_cost_the_garbage_collector_nothing(run_core):
    """Read, kept, mixed and evaluated, in whichever way."""
    measured = run_core("measure", SCENE, SCENE.with_name("1.controls.bin"))
    assert [each["what"] for each in measured] == ["nothing", "slopes", "cofactors", "bounds"]
    assert all(each["bytes"] < 1 for each in measured), measured  # of 200 frames; measuring takes a few
