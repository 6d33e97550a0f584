"""Rooms without noise and with that of a Kinect v1, 1.5 mm at one metre."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from capture.sensor_tilt import SensorTilt
from capture.trackers.floor import FloorTracker, find_floor
from capture.trackers.picture import Lens, Picture

from ..sensors.rooms import LENS, room

STANDS = [*product((5, 12, 20, 30, 40), (0, 5), (0.6, 1.0, 1.6)), *product((-8,), (0, 5), (0.6,)), (0, -6, 1.0)]
"""Tilt, roll and height of sensors that see some of the floor."""


@pytest.mark.parametrize("stands", STANDS)
@pytest.mark.parametrize("table", [False, True])
def test_tilt_roll_and_height_follow_from_the_floor(stands, table):
    for noise in (0.0, 0.0015):
        found = find_floor(room(*stands, noise, table=table), LENS)
        assert (found.tilt, found.roll) == pytest.approx(stands[:2], abs=0.3)
        assert found.height == pytest.approx(stands[2], abs=0.02)


def cut(*nothing):
    """Return a room with floor, of which parts have no depth."""
    depth = room(20, 0, 1.0)
    for part in nothing:
        depth[part] = 0
    return depth


@pytest.mark.parametrize(
    "depth",
    [
        *(room(-8, 0, 1.6), room(0, 5, 1.6)),  # too little floor
        *(room(0, 0, 1.0, floor=False), room(30, 0, 1.0, floor=False)),  # walls, ceiling and performer
        room(10, 0, 1.4, table=True, floor=False),
        *(cut(...), cut(np.s_[20:]), cut(np.s_[:, :280], np.s_[:, 330:])),
    ],
)
def test_where_little_or_no_floor_is_seen_there_is_no_result(depth):
    assert find_floor(depth, LENS) is None


@pytest.mark.parametrize("tilt", [-3, 0, 3, 6])
@pytest.mark.parametrize("wall", [3.5, 4.0, 5.0])
def test_a_desk_under_the_sensor_does_not_join_the_floor(tilt, wall):
    found = find_floor(room(tilt, 0, 0.95, 0.0015, desk=1.3, wall=wall), LENS)
    assert found is None or found.near(SensorTilt(tilt, 0.95), 0.5, 0.03)


@settings(max_examples=60)
@given(
    depth=arrays(
        np.float32,
        st.tuples(st.integers(1, 64), st.integers(1, 64)),
        elements=st.floats(0, 65.5, width=32),
        fill=st.sampled_from([0.0, 0.75, 65.0]),
    ),
    slope=st.floats(0, 0.4),
)
def test_any_depth_gives_a_plausible_result_or_none(depth, slope):
    depth = (depth + slope * np.arange(len(depth))[:, None]).astype(np.float32)
    found = find_floor(depth, Lens(depth.shape[1], depth.shape[0], 60.0))
    assert found is None or (found.height > 0 and max(abs(found.tilt), abs(found.roll)) < 50)


def reports(depths, up=None, rate=10):
    """Return the results of a tracker for images per second, with their times."""
    tracker = FloorTracker()
    said = [(k / rate, tracker.update(k / rate, Picture(7.0, LENS, None, depth, up))) for k, depth in enumerate(depths)]
    return [(time, floor) for time, floor in said if floor is not None]


def test_the_tilt_is_reported_once_when_it_is_certain_and_again_when_the_sensor_was_moved_but_not_shaken():
    before, shaken, after = room(10, 0, 1.2), room(11, 0, 1.22), room(16, 0, 1.2)
    first, second = reports([before] * 30 + [shaken] * 60 + [after] * 60)
    assert first[0] == pytest.approx(0.8, abs=0.11)  # five measurements, a fifth of a second apart
    assert 9.0 <= second[0] <= 15.0
    for (_, floor), tilt in ((first, 10), (second, 16)):
        assert floor.near(SensorTilt(tilt, 1.2), 0.1, 0.004)


def test_a_swinging_sensor_and_images_without_depth_are_not_reported():
    assert reports([room(10 + 4 * (k // 2 % 2), 0, 1.2) for k in range(30)]) == []
    assert reports([None] * 30) == []


def test_an_accelerometer_shows_the_tilt_without_a_floor_and_refuses_a_plane_that_is_none():
    up = np.array([0.0, np.cos(np.radians(12)), -np.sin(np.radians(12))])
    for depth, height in ((room(12, 0, 1.3), 1.3), (room(12, 0, 1.3, floor=False), 0.0), (room(20, 0, 1.3), 0.0)):
        [(_, stands)] = reports([depth] * 8, up, rate=4)
        assert stands.near(SensorTilt(12, height), 0.3, 0.02)
