"""The jitter buffer of the addon, with frames at hand-computed times and a delay of 0.05 s."""

import json
from itertools import pairwise

import pytest

START = 100.0
"""Time of the local clock at which the first frame arrives, in seconds."""


@pytest.fixture
def play_back(run_godot):
    """Give frames to a buffer: at each moment, seconds after the start, (number, time of the source) of some."""

    def run(*moments, delay=0.05):
        asked = [{"now": START + after, "push": pushed} for after, *pushed in moments]
        return run_godot("jitter_buffer.gd", json.dumps(asked), delay)

    return run


def shown(told):
    return told["earlier"], told["later"], pytest.approx(told["share"], abs=1e-9)


def test_no_frame_is_shown_before_the_first_one(play_back):
    assert play_back((0.0,)) == [{"shows": False, "waiting": 0, "lost": 0}]


def test_between_two_frames_it_is_shown_how_far_the_source_had_come(play_back):
    # 0.04 s between two frames, each as late as the others: shown is what was 0.05 s ago
    told = play_back(
        (0.00, (1, 7.00)),
        (0.04, (2, 7.04)),
        (0.05,),
        (0.06,),
        (0.08, (3, 7.08)),
        (0.09,),
        (0.11,),
        (0.12, (4, 7.12)),
        (0.14,),
    )
    assert [shown(each) for each in told] == [
        (1, 1, 0.0),
        (1, 2, 0.0),
        (1, 2, 0.0),
        (1, 2, 0.25),
        (1, 2, 0.75),
        (2, 3, 0.0),
        (2, 3, 0.5),
        (2, 3, 0.75),
        (3, 4, 0.25),
    ]
    assert [each["waiting"] for each in told] == [0, 1, 1, 1, 2, 1, 1, 2, 1]


def test_a_frame_that_comes_late_changes_nothing(play_back):
    # the second frame is 0.03 s late; playing goes by the quickest
    told = play_back((0.00, (1, 7.00)), (0.07, (2, 7.04)), (0.08, (3, 7.08)), (0.10,))
    assert [shown(each) for each in told] == [(1, 1, 0.0), (1, 2, 0.5), (1, 2, 0.75), (2, 3, 0.25)]


def test_when_nothing_comes_the_last_frame_stays(play_back):
    told = play_back((0.00, (1, 7.00)), (0.04, (2, 7.04)), (0.20,), (9.00,))
    assert [shown(each) for each in told[2:]] == [(2, 2, 0.0)] * 2


def test_after_a_pause_of_the_source_it_begins_with_what_comes_then(play_back):
    # nothing lies between frames whose own times are 6 s apart; then clocks are compared anew
    told = play_back((0.00, (1, 7.00)), (0.04, (2, 7.04)), (6.10, (3, 13.04)), (6.14, (4, 13.08)), (6.17,))
    assert [shown(each) for each in told[2:]] == [(3, 3, 0.0), (3, 4, 0.0), (3, 4, 0.5)]
    assert told[-1]["lost"] == 0


def test_after_a_pause_of_the_network_what_has_piled_up_is_caught_up_with(play_back):
    late = [(n, 7.0 + 0.04 * (n - 1)) for n in range(3, 27)]
    told = play_back((0.00, (1, 7.00)), (0.04, (2, 7.04)), (1.00, *late), (1.01,))
    # 0.05 s ago the source was at 7.95 and 7.96: between frames 24 (7.92) and 25 (7.96), and then at frame 25
    assert [shown(each) for each in told[2:]] == [(24, 25, 0.75), (25, 26, 0.0)]


def test_lost_frames_are_counted_and_bridged(play_back):
    told = play_back((0.00, (1, 7.00)), (0.12, (4, 7.12)), (0.14,))
    assert shown(told[-1]) == (1, 4, 0.75)
    assert [each["lost"] for each in told] == [0, 2, 2]


@pytest.mark.parametrize("again", [(1, 7.08), (2, 7.08), (3, 7.04), (3, 3.0)], ids=str)
def test_a_restarted_service_starts_the_buffer_again(play_back, again):
    """Numbers or times that do not grow."""
    told = play_back((0.00, (1, 7.00)), (0.04, (2, 7.04)), (0.08, again), (0.09,))
    assert [shown(each) for each in told[2:]] == [(again[0], again[0], 0.0)] * 2


def test_a_clock_that_drifts_is_followed_slowly(play_back):
    # from 1.2 s on each frame is 0.02 s later than those before, and is so for as long as the quickest is sought in a
    # window: two of them, 2 s at most. Then the difference is made up for by a twentieth of the time that passes.
    moments = [(0.04 * n + (0.02 if n >= 30 else 0.0), (n, 7.0 + 0.04 * n)) for n in range(100)]
    told = play_back(*moments, (4.0,))
    behind = [
        7.0 + moment[0] - 0.05 - (7.0 + 0.04 * (each["earlier"] + each["share"] * (each["later"] - each["earlier"])))
        for moment, each in zip([*moments, (4.0,)], told, strict=True)
    ]
    assert behind[2:50] == pytest.approx([0.0] * 48, abs=1e-9)  # what is new is late, and no news
    steps = [later - earlier for earlier, later in pairwise(behind[2:])]
    assert min(steps) >= -1e-9
    assert max(steps) <= 0.05 * 0.06 + 1e-9
    assert behind[-1] == pytest.approx(0.02, abs=1e-9)


def test_a_clock_that_is_elsewhere_is_believed_at_once(play_back):
    # 0.4 s are more than is made up for slowly
    moments = [(0.04 * n + (0.4 if n >= 10 else 0.0), (n, 7.0 + 0.04 * n)) for n in range(80)]
    told = play_back(*moments)
    assert shown(told[-1]) == (77, 78, 0.75)


def test_no_more_is_kept_than_a_moment_can_need(play_back):
    told = play_back((0.0, *((n, 7.0 + 0.0001 * n) for n in range(1000))))
    assert told[0]["waiting"] == 511


def test_the_longest_delay_is_kept_at_a_high_rate(play_back):
    # 240 frames per second with a delay of one second: shown at 2 s is what the source had at 8 s, frame 240
    moments = [(n / 240, (n, 7.0 + n / 240)) for n in range(481)]
    told = play_back(*moments, (2.0,), delay=1.0)
    assert shown(told[-1]) == (240, 241, pytest.approx(0.0, abs=1e-6))
    assert (told[-1]["waiting"], told[-1]["lost"]) == (240, 0)
