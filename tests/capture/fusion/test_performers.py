from dataclasses import replace
from heapq import merge

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES, clean

from capture.events import Lost
from capture.fusion.performers import FORGET_SECONDS, LEADER_TIMEOUT_SECONDS, MAX_OBSERVATION_SECONDS, Performers
from capture.skeleton import OPPOSITE, SkeletonFrame

SURE = np.ones(20, dtype=np.float32)


@pytest.fixture
def performers():
    return Performers()


@pytest.fixture
def body(walk):
    """Return a frame of a performer who stands at x."""

    def make(time, user=1, x=0.0, confidence=1.0, swapped=False):
        positions = walk.positions[0] + [x, 0, 0]
        sure = np.full(20, confidence, dtype=np.float32)
        return SkeletonFrame(time, user, positions[OPPOSITE] if swapped else positions, sure)

    return make


def together(performers, *recordings):
    """Pass recordings to `Performers` in the order of time; return the frames."""
    streams = [[(frame.time, k, frame) for frame in each] for k, each in enumerate(recordings)]
    seen = [performers.observe(sensor, frame) for _, sensor, frame in merge(*streams, key=lambda each: each[:2])]
    return [frame for frame in seen if frame is not None]


def placed(sensor, clip):
    return [replace(frame, positions=sensor.pose.apply(frame.positions)) for frame in clip.frames()]


@pytest.mark.parametrize("from_where", ["beside", "behind"])
def test_without_noise_a_turn_is_exact_though_both_exchange_left_and_right(
    turn, from_where, request, virtual_sensor, here, performers, true_positions
):
    sensors = [virtual_sensor(here), virtual_sensor(request.getfixturevalue(from_where))]
    frames = together(performers, *(placed(sensor, sensor.record(turn)) for sensor in sensors))
    assert [frame.time for frame in frames] == turn.times[:-1].tolist()
    positions = np.stack([frame.positions for frame in frames])
    assert np.abs(positions - true_positions(turn, turn.times[:-1])).max() < 0.05  # the other one is a frame behind
    assert np.abs(positions - true_positions(turn, turn.times[:-1])).mean() < 1e-3


@pytest.mark.parametrize("seed", [1, 5, 9])
@pytest.mark.parametrize("from_where", ["beside", "behind"])
def test_two_sensors_beat_the_better_one_alone_in_the_turn(
    turn, seed, from_where, request, virtual_sensor, here, performers, true_positions
):
    """The single sensor even knows which side is left."""
    poses = [here, request.getfixturevalue(from_where)]
    sensors = [virtual_sensor(pose, seed=seed + k) for k, pose in enumerate(poses)]
    frames = together(performers, *(placed(s, s.record(turn, phase=0.013 * k)) for k, s in enumerate(sensors)))
    assert {frame.user for frame in frames} == {1}
    assert all((frame.confidence > 0).all() and np.isfinite(frame.positions).all() for frame in frames)

    def error(times, positions):
        during = (times > 2.0) & (times < 7.0)
        return np.linalg.norm(positions - true_positions(turn, times), axis=2)[during]

    fused = error(np.array([frame.time for frame in frames]), np.stack([frame.positions for frame in frames]))
    alone = []
    for k, pose in enumerate(poses):
        clip = virtual_sensor(pose, seed=seed + k, swaps=False).record(turn)
        alone.append(error(clip.times, pose.apply(clip.positions)))
    assert fused.mean() < 0.65 * min(each.mean() for each in alone)
    assert np.percentile(fused, 95) < 0.65 * min(np.percentile(each, 95) for each in alone)
    assert fused.mean() < 0.025


@pytest.mark.parametrize(("count", "most"), [(2, 0.05), (3, 0.025)])
def test_a_tenth_of_the_joints_grossly_wrong_does_little_harm(
    turn, count, most, virtual_sensor, here, beside, opposite, performers, true_positions
):
    """The mean of all would be 8 cm off. A joint that only one of two sensors sees has that sensor's position."""
    sensors = [virtual_sensor(pose, seed=1 + k, wrong=0.1) for k, pose in enumerate([here, beside, opposite][:count])]
    frames = together(performers, *(placed(s, s.record(turn, phase=0.01 * k)) for k, s in enumerate(sensors)))
    true = true_positions(turn, np.array([frame.time for frame in frames]))
    apart = np.linalg.norm(np.stack([frame.positions for frame in frames]) - true, axis=2)
    assert apart.mean() < most


def test_the_first_sensor_determines_the_times_and_the_next_one_replaces_it(performers, body):
    frames = together(performers, [body(k / 30) for k in range(30)], [body(k / 30 + 0.01, user=7) for k in range(60)])
    times = np.array([frame.time for frame in frames])
    assert times[:30].tolist() == [k / 30 for k in range(30)]
    assert LEADER_TIMEOUT_SECONDS < times[30] - times[29] < LEADER_TIMEOUT_SECONDS + 1.1 / 30
    np.testing.assert_allclose(np.diff(times[30:]), 1 / 30)
    assert {frame.user for frame in frames} == {1}


def test_performers_apart_keep_their_user_numbers(performers, body):
    a = [body(k / 30, user=1 + j, x=float(j)) for k in range(20) for j in range(2)]
    b = [body(k / 30 + 0.01, user=8 - j, x=j + 0.1) for k in range(20) for j in range(2)]
    frames = together(performers, a, b)
    for user, x in ((1, 0.0), (2, 1.0)):
        own = [frame for frame in frames if frame.user == user]
        assert len(own) == 20
        assert all(x - 1e-9 <= (frame.positions - body(0).positions)[:, 0].mean() < x + 0.1 for frame in own)


def test_a_tracker_that_confuses_two_performers_is_corrected(performers, body):
    a = [body(k / 30, user=1 + (j if k < 15 else 1 - j), x=1.0 * j) for k in range(30) for j in range(2)]
    b = [body(k / 30 + 0.01, user=1 + j, x=1.0 * j) for k in range(30) for j in range(2)]
    frames = together(performers, a, b)
    assert {frame.user for frame in frames} == {1, 2}
    for frame in frames:
        assert (frame.positions - body(0).positions)[:, 0].mean() == pytest.approx(frame.user - 1, abs=1e-6)


def test_a_performer_is_lost_when_all_sensors_have_lost_them(performers, body):
    together(performers, [body(0.0, user=3)], [body(0.01, user=4)])
    assert performers.lose(0, 3, 0.1) == []
    assert performers.observe(1, body(0.2, user=4)).user == 1
    assert performers.lose(1, 4, 0.3) == [Lost(0.3, 1)]
    assert performers.lose(1, 4, 0.4) == []
    assert performers.observe(0, body(0.5)).user == 2


def test_a_performer_is_removed_after_a_long_absence(performers, body):
    assert performers.observe(0, body(0.0)).user == 1
    assert performers.forget(FORGET_SECONDS - 1) == []
    assert performers.observe(0, body(FORGET_SECONDS, user=1)).user == 1  # the sensor's own user number suffices
    assert performers.forget(2 * FORGET_SECONDS + 1) == [Lost(2 * FORGET_SECONDS + 1, 1)]


def test_at_the_beginning_the_most_confident_sensor_determines_the_sides(performers, body):
    frames = together(
        performers,
        [body(k / 30, swapped=True, confidence=0.8) for k in range(60)],
        [body(k / 30 + 0.01) for k in range(60)],
    )
    for frame in frames[1:]:
        np.testing.assert_allclose(frame.positions, body(0).positions)


def test_afterwards_the_sides_are_those_of_the_frames_before(performers, body):
    for k in range(60):
        performers.observe(0, body(k / 30))
    for k in range(60, 90):
        np.testing.assert_allclose(performers.observe(0, body(k / 30, swapped=True)).positions, body(0).positions)
    later = performers.observe(0, body(3.0 + MAX_OBSERVATION_SECONDS, swapped=True))
    np.testing.assert_allclose(later.positions, body(0, swapped=True).positions)


def sides_exchanged(performers, sensors, clip, truth):
    """Return which frames of a clip have left and right swapped."""
    frames = together(performers, *(placed(s, s.record(clip, phase=0.013 * k)) for k, s in enumerate(sensors)))
    true = truth(clip, np.array([frame.time for frame in frames]))
    found = np.stack([frame.positions for frame in frames])
    as_it_is, exchanged = (np.linalg.norm(each - true, axis=2).mean(axis=1) for each in (found, found[:, OPPOSITE]))
    return exchanged < as_it_is


@pytest.mark.parametrize("seed", [1, 5, 9])
def test_a_performer_who_enters_backwards_is_corrected_once_by_walking(
    walk, seed, virtual_sensor, here, beside, performers, true_positions, turned
):
    """The performer walks three metres away from the sensors, and then turns on the spot."""
    middle = walk.positions[:, :1] * [1, 0, 1]
    place = np.minimum(1.0 * walk.times, 3.0)[:, None, None] * [0, 0, 1] + [0.3, 0, 1.5]
    clip = replace(walk, positions=(walk.positions - middle) * [-1, 1, -1] + place)
    sensors = [virtual_sensor(pose, seed=seed + k) for k, pose in enumerate((here, beside))]
    exchanged = sides_exchanged(performers, sensors, turned(clip, 4.0, 8.0), true_positions)
    assert exchanged[0]
    assert np.flatnonzero(np.diff(exchanged)).size == 1
    assert np.flatnonzero(exchanged)[-1] < 3.0 * 30


@pytest.mark.parametrize("seed", [1, 5, 9])
def test_stepping_back_a_metre_and_a_half_swaps_nothing(
    walk, seed, virtual_sensor, here, beside, performers, true_positions
):
    middle = walk.positions[:, :1] * [1, 0, 1]
    place = np.clip(1.0 * (walk.times - 2.0), 0, 1.5)[:, None, None] * [0, 0, 1] + [0.3, 0, 1.8]
    clip = replace(walk, positions=walk.positions - middle + place)
    sensors = [virtual_sensor(pose, seed=seed + k) for k, pose in enumerate((here, beside))]
    assert not sides_exchanged(performers, sensors, clip, true_positions).any()


@pytest.mark.slow
@pytest.mark.parametrize("start", range(8))
@pytest.mark.parametrize("other", ["beside", "behind"])
def test_walking_in_circles_corrects_the_sides_once(
    walk, start, other, request, virtual_sensor, here, performers, true_positions, circled
):
    poses = here, request.getfixturevalue(other)
    sensors = [virtual_sensor(pose, seed=start + k) for k, pose in enumerate(poses)]
    exchanged = sides_exchanged(performers, sensors, circled(walk, start * np.pi / 4), true_positions)
    assert not exchanged[3 * 30 :].any()
    assert (np.diff(exchanged[30:].astype(int)) <= 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", list(PERFORMANCES))
@pytest.mark.parametrize("begin", [1.2, 2.0])
@pytest.mark.parametrize("others", [["beside"], ["behind"], ["beside", "opposite"]])
def test_no_turn_exchanges_the_sides(
    name, begin, others, request, virtual_sensor, here, performers, true_positions, turned
):
    poses = [here, *(request.getfixturevalue(each) for each in others)]
    sensors = [virtual_sensor(pose, seed=3 + k) for k, pose in enumerate(poses)]
    assert not sides_exchanged(performers, sensors, turned(clean(name), begin, begin + 2.0), true_positions).any()


def test_a_frame_without_a_known_joint_is_not_a_performer(performers, body):
    assert performers.observe(0, body(0.0, confidence=0.0)) is None
    assert performers.observe(0, body(0.1)).user == 1
