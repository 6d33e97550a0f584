"""What clients show of frames that come unevenly: what their source had at the time of the delay, computed by hand.

The tests of a client derive a class from `Playback`, or from `NumberedPlayback`, and give it the fixture `play_back`.
"""

from itertools import pairwise
from unittest.mock import ANY

import pytest


def frames(count, rate=25.0, source=7.0, late=lambda _number: 0.0):
    """Return steps in which frames arrive: (moment, number, time of the source)."""
    return [(number / rate + late(number), number + 1, source + number / rate) for number in range(count)]


def looks(*moments):
    return [(moment,) for moment in moments]


def looked_at(*steps):
    """Look when each frame has arrived."""
    return [each for step in steps for each in ([step, (step[0],)] if len(step) > 1 else [step])]


FIRST_TWO = frames(2)
UNEVEN = frames(120, 60, late=lambda number: (0.0, 0.031, 0.015, 0.04, 0.024, 0.008, 0.0)[number % 7])
AT_75 = looks(*(number / 75 for number in range(20, 140)))
CASES = {
    "nothing before the first frame": (0.05, looks(0.0), [None]),
    "between two frames": (
        *(0.05, sorted([*looked_at(*frames(4)), *looks(0.05, 0.06, 0.09, 0.11, 0.14)], key=lambda step: step[0])),
        [7.0, 7.0, 7.0, 7.01, 7.03, 7.04, 7.06, 7.07, 7.09],
    ),
    "a late frame changes nothing": (
        *(0.05, looked_at((0.0, 1, 7.0), (0.07, 2, 7.04), (0.08, 3, 7.08), (0.1,))),
        [7.0, 7.02, 7.03, 7.05],
    ),
    "the last frame stays": (0.05, [*FIRST_TWO, *looks(0.2, 9.0)], [7.04, 7.04]),
    "what has piled up in a pause of the network is caught up with": (
        *(0.05, [*FIRST_TWO, *((1.0, n, 7.0 + 0.04 * (n - 1)) for n in range(3, 27)), *looks(1.0, 1.01)]),
        [7.95, 7.96],
    ),
    "a source that begins anew": (0.05, [*FIRST_TWO, (1.0, 1, 3.0), *looks(1.0, 1.2)], [3.0, 3.0]),
    "up to 40 ms late, looked at at another rate": (
        *(0.06, sorted([*UNEVEN, *AT_75], key=lambda step: step[0])),
        [7.0 + moment - 0.06 for (moment,) in AT_75],
    ),
    "a second of a fast source can wait": (1.0, [*frames(961, 240), *looks(4.0)], [10.0]),
}
"""Delay, steps, and the shown times of the source."""

NUMBERED = {
    "a pause of the source": (
        *(0.05, looked_at(*FIRST_TWO, (6.1, 3, 13.04), (6.14, 4, 13.08), (6.17,))),
        [7.0, 7.0, 13.04, 13.04, 13.06],
    ),
    "a clock that is elsewhere is believed at once": (
        *(0.05, looked_at(*frames(80, late=lambda number: 0.4 if number >= 10 else 0.0))),
        [ANY] * 79 + [7.0 + 79 / 25 - 0.05],
    ),
    **{
        f"begun again with {again}": (0.05, [*FIRST_TWO, (0.08, *again), *looks(0.08, 0.09)], [again[1]] * 2)
        for again in ((1, 7.08), (2, 7.08), (3, 7.04))
    },
}
"""Further cases of clients that count frames."""


class Playback:
    """Tests of a client's buffer. `play_back` takes a delay and steps, and returns for each look `time` and `lost`."""

    tolerance = 1e-9
    capacity = 256

    @pytest.fixture(params=CASES)
    def case(self, request):
        return CASES[request.param]

    def test_shown_is_what_the_source_had_at_the_time_of_the_delay(self, play_back, case):
        delay, steps, expected = case
        for told, time in zip(play_back(delay, steps), expected, strict=True):
            assert told["time"] == (pytest.approx(time, abs=self.tolerance) if isinstance(time, float) else time)

    def test_frames_that_nobody_looks_at_do_not_pile_up(self, play_back):
        [told] = play_back(30.0, [*frames(1000, 10_000), *looks(0.1)])
        assert told["time"] == pytest.approx(7.0 + (1000 - self.capacity) / 10_000, abs=self.tolerance)


class NumberedPlayback(Playback):
    """Tests of a buffer that counts frames and lets the clock of the source drift."""

    @pytest.fixture(params=[*CASES, *NUMBERED])
    def case(self, request):
        return (CASES | NUMBERED)[request.param]

    def test_lost_frames_are_counted_and_bridged(self, play_back):
        told = play_back(0.05, looked_at((0.0, 1, 7.0), (0.12, 4, 7.12), (0.14,)))
        assert told[-1]["time"] == pytest.approx(7.09)
        assert [each["lost"] for each in told] == [0, 2, 2]

    def test_a_clock_that_drifts_is_followed_slowly(self, play_back):
        """From 1.2 s on, frames are 0.02 s later. Two windows of a second seek the quickest frame; then a twentieth of
        the passing time makes up for the difference."""
        steps = [*looked_at(*frames(100, late=lambda number: 0.02 if number >= 30 else 0.0)), (4.0,)]
        moments = [step[0] for step in steps if len(step) == 1]
        told = play_back(0.05, steps)
        behind = [7.0 + at - 0.05 - each["time"] for at, each in zip(moments, told, strict=True)]
        assert behind[2:50] == pytest.approx([0.0] * 48, abs=1e-9)  # what is new is late, and no news
        changes = [later - earlier for earlier, later in pairwise(behind[2:])]
        assert min(changes) >= -1e-9
        assert max(changes) <= 0.05 * 0.06 + 1e-9
        assert behind[-1] == pytest.approx(0.02, abs=1e-9)
