"""Frames that come unevenly are shown evenly, a little later, and mixed where none is due."""

import json

import pytest

from ...recorded import VECTORS
from ..playback import Playback

SCENE = VECTORS / "scene.bin"
AHEAD = 1000.0
"""This machine's clock is that far ahead of the moments of the steps."""


@pytest.fixture
def run_playback(run_core):
    """Give a playback frames [time, arrived, value], and ask at some moments what is shown."""

    def run(delay, *steps):
        return run_core("playback", told=json.dumps({"scene": str(SCENE), "delay": delay, "steps": steps}))

    return run


class TestPlayback(Playback):
    tolerance = 2e-3  # its estimate of the source's clock drifts by 0.005

    @pytest.fixture
    def play_back(self, run_playback):
        def play(delay, steps):
            frames = ([step[2], AHEAD + step[0], step[2]] if len(step) > 1 else AHEAD + step[0] for step in steps)
            return [{"time": told["value"]} for told in run_playback(delay, *frames)]

        return play


def test_without_delay_the_newest_frame_is_shown_as_it_is_and_once(run_playback):
    frames = [[time, AHEAD + time, value] for time, value in ((0.0, 5.0), (0.1, 6.0), (0.2, 7.0))]
    told = run_playback(0.0, frames[0], AHEAD, AHEAD + 0.01, *frames[1:], AHEAD + 0.2)
    assert [(each["value"], each["changed"]) for each in told] == [(5, True), (5, False), (7, True)]


def test_a_source_that_has_stood_still_goes_on_at_once(run_playback):
    """Ten seconds without a frame, and the source's clock has stood still as well."""
    steps = [[0.0, AHEAD, 1.0], [0.1, AHEAD + 0.1, 2.0], [0.2, AHEAD + 10.2, 3.0], AHEAD + 10.25]
    told = run_playback(0.05, *steps, [0.3, AHEAD + 10.3, 4.0], AHEAD + 10.35)
    assert [each["value"] for each in told] == pytest.approx([3, 4], abs=0.02)


def test_frames_cost_the_garbage_collector_nothing(run_core):
    """Read, kept, mixed and evaluated, in whichever way."""
    measured = run_core("measure", SCENE, SCENE.with_name("1.controls.bin"))
    assert [each["what"] for each in measured] == ["nothing", "slopes", "cofactors", "bounds"]
    assert all(each["bytes"] < 1 for each in measured), measured  # of 200 frames; measuring takes a few
