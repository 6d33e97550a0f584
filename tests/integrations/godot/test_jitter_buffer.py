"""The jitter buffer of the addon shows what its source had at the time of its delay."""

import json

import pytest

from ..playback import NumberedPlayback


class TestJitterBuffer(NumberedPlayback):
    capacity = 512

    @pytest.fixture
    def play_back(self, run_godot):
        return lambda delay, steps: run_godot("jitter_buffer.gd", json.dumps(steps), delay)


def test_the_number_of_waiting_frames_is_that_of_the_delay(run_godot):
    """A second of 240 frames; the last one of each moment is shown, or the one before it."""
    steps = [(number / 240, number, 7 + number / 240) for number in range(481)]
    [told] = run_godot("jitter_buffer.gd", json.dumps([*steps, (2.0,)]), 1.0)
    assert told["waiting"] == 240
