from dataclasses import replace
from heapq import merge
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from puppetline.examples.performances import PERFORMANCES, clean

from capture.events import Lost
from capture.fusion.performers import FORGET_SECONDS, LEADER_TIMEOUT_SECONDS, MAX_OBSERVATION_SECONDS, Performers
from capture.skeleton import OPPOSITE, SkeletonFrame

from .virtual_sensors import ACROSS, BEHIND, BESIDE, HERE, TURN, WALK, VirtualSensor, truth, turning

BODY = WALK.positions[0]


def body(time, user=1, x=0.0, confidence=1.0, swapped=False):
    """Return a frame of a performer who stands at x."""
    positions = BODY + np.array([x, 0, 0])
    sure = np.full(20, confidence, dtype=np.float32)
    return SkeletonFrame(time, user, positions[OPPOSITE] if swapped else positions, sure)


def x_of(frame):
    return (frame.positions - BODY)[:, 0].mean()


def together(*recordings):
    """Pass recordings to `Performers` in the order of time; return the frames."""
    performers = Performers()
    streams = [[(frame.time, k, frame) for frame in each] for k, each in enumerate(recordings)]
    seen = [performers.observe(sensor, frame) for _, sensor, frame in merge(*streams, key=lambda each: each[:2])]
    return [frame for frame in seen if frame is not None]


def fused(clip, *poses, seed=None, phase=0.013):
    """Return what sensors see together: times, joints (T, 20, 3) and true joints."""
    sensors = [VirtualSensor(pose, seed=None if seed is None else seed + k) for k, pose in enumerate(poses)]
    recorded = [sensor.record(clip, phase=phase * k) for k, sensor in enumerate(sensors)]
    frames = together(
        *(
            [replace(frame, positions=pose.apply(frame.positions)) for frame in each.frames()]
            for pose, each in zip(poses, recorded, strict=True)
        )
    )
    times = np.array([frame.time for frame in frames])
    return times, np.stack([frame.positions for frame in frames]), truth(clip, times)


@pytest.mark.parametrize("pose", [BESIDE, BEHIND])
def test_without_noise_a_turn_is_exact_though_both_exchange_left_and_right(pose):
    times, found, true = fused(TURN, HERE, pose, phase=0)
    assert_array_equal(times, TURN.times[:-1])
    assert np.abs(found - true).max() < 0.05  # the other one is a frame behind
    assert np.abs(found - true).mean() < 1e-3


def test_the_first_sensor_determines_the_times_and_the_next_one_replaces_it():
    frames = together([body(k / 30) for k in range(30)], [body(k / 30 + 0.01, user=7) for k in range(60)])
    times = np.array([frame.time for frame in frames])
    assert times[:30].tolist() == [k / 30 for k in range(30)]
    assert LEADER_TIMEOUT_SECONDS < times[30] - times[29] < LEADER_TIMEOUT_SECONDS + 1.1 / 30
    assert_allclose(np.diff(times[30:]), 1 / 30)
    assert {frame.user for frame in frames} == {1}


def test_a_tracker_that_confuses_two_performers_is_corrected():
    a = [body(k / 30, user=1 + (j if k < 15 else 1 - j), x=1.0 * j) for k in range(30) for j in range(2)]
    b = [body(k / 30 + 0.01, user=1 + j, x=1.0 * j) for k in range(30) for j in range(2)]
    frames = together(a, b)
    assert {frame.user for frame in frames} == {1, 2}
    assert [x_of(frame) for frame in frames] == pytest.approx([frame.user - 1 for frame in frames], abs=1e-6)


def test_a_performer_is_lost_when_all_sensors_have_lost_them_or_after_a_long_absence():
    performers = Performers()
    assert performers.observe(0, body(0.0, confidence=0.0)) is None  # without a known joint it is no performer
    performers.observe(0, body(0.0, user=3))
    performers.observe(1, body(0.01, user=4))
    assert performers.lose(0, 3, 0.1) == []
    assert performers.observe(1, body(0.2, user=4)).user == 1
    assert performers.lose(1, 4, 0.3) == [Lost(0.3, 1)]
    assert performers.lose(1, 4, 0.4) == []
    assert performers.observe(0, body(1.0)).user == 2
    assert performers.forget(FORGET_SECONDS) == []
    assert performers.observe(0, body(1 + FORGET_SECONDS)).user == 2  # the sensor's own user number suffices
    assert performers.forget(2 * FORGET_SECONDS + 2) == [Lost(2 * FORGET_SECONDS + 2, 2)]


def test_the_sides_are_those_of_the_most_confident_sensor_and_then_of_the_frames_before():
    first, *frames = together(
        [body(k / 30, swapped=True, confidence=0.8) for k in range(60)], [body(k / 30 + 0.01) for k in range(60)]
    )
    assert first.time == 0
    for frame in frames:
        assert_allclose(frame.positions, BODY)
    late = 3.0 + MAX_OBSERVATION_SECONDS
    *frames, later = together([*(body(k / 30, swapped=k >= 60) for k in range(90)), body(late, swapped=True)])
    for frame in frames:
        assert_allclose(frame.positions, BODY)
    assert_allclose(later.positions, BODY[OPPOSITE])


def exchanged_sides(clip, *poses, seed):
    """Return which frames of a clip have left and right swapped."""
    _, found, true = fused(clip, *poses, seed=seed)
    as_it_is, exchanged = (np.linalg.norm(each - true, axis=2).mean(axis=1) for each in (found, found[:, OPPOSITE]))
    return exchanged < as_it_is


def moved(distance, start, facing):
    """Return a clip of the walk whose performer faces the sensor (1) or away (−1) and moves away from it."""
    middle = WALK.positions[:, :1] * [1, 0, 1]
    place = distance[:, None, None] * [0, 0, 1] + [0.3, 0, start]
    return replace(WALK, positions=(WALK.positions - middle) * [facing, 1, facing] + place)


@pytest.mark.parametrize("seed", [1, 5, 9])
def test_a_performer_who_enters_backwards_is_corrected_once_by_walking_and_stepping_back_swaps_nothing(seed):
    """The performer walks three metres away from the sensors, and then turns on the spot."""
    entering = turning(moved(np.minimum(WALK.times, 3.0), 1.5, -1), 4.0, 8.0)
    exchanged = exchanged_sides(entering, HERE, BESIDE, seed=seed)
    assert exchanged[0]
    assert np.flatnonzero(np.diff(exchanged)).size == 1
    assert np.flatnonzero(exchanged)[-1] < 3.0 * 30
    stepping_back = moved(np.clip(WALK.times - 2.0, 0, 1.5), 1.8, 1)
    assert not exchanged_sides(stepping_back, HERE, BESIDE, seed=seed).any()


TURNS = list(product(PERFORMANCES, (1.2, 2.0), ([BESIDE], [BEHIND], [BESIDE, ACROSS])))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "begin", "others"),
    [pytest.param(*each, marks=pytest.mark.exhaustive if k % 4 else []) for k, each in enumerate(TURNS)],
)
def test_no_turn_exchanges_the_sides(name, begin, others):
    assert not exchanged_sides(turning(clean(name), begin, begin + 2.0), HERE, *others, seed=3).any()
