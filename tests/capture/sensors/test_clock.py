"""Devices' clocks are simulated; images arrive exactly 32 times per second unless a test says otherwise."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from capture.sensors.clock import SPAN_SECONDS, DeviceClock

STEP = 1 / 32
START = 1000.0
PROVED = round(2 * SPAN_SECONDS / STEP)
"""Number of images after which a good clock is trusted."""


def arrivals(seconds=20.0):
    return START + np.arange(round(seconds / STEP)) * STEP


def moments(clock, taken, now):
    return np.array([clock.moment(*each) for each in zip(taken.tolist(), now.tolist(), strict=True)])


def proved():
    """Return a trusted clock whose device started at 0, four seconds ago."""
    clock = DeviceClock()
    now = arrivals(4.0)
    moments(clock, now - START, now)
    assert clock.trusted
    return clock


def test_images_have_their_arrival_times_until_the_clock_matched_for_two_spans():
    clock, now = DeviceClock(), arrivals()
    late = np.where(np.arange(len(now)) % 2, 0.25 * STEP, 0.0)
    found = moments(clock, now - START, now + late)
    assert_array_equal(found[:PROVED], (now + late)[:PROVED])
    assert_allclose(found[PROVED:], now[PROVED:], atol=1e-3)
    assert (clock.trusted, clock.rate) == (True, None)


@pytest.mark.parametrize("rate", [0.99, 0.995, 0.9999, 1.0001, 1.01])
def test_a_slightly_slow_clock_makes_images_slightly_old_and_a_fast_one_does_not(rate):
    clock, now = DeviceClock(), arrivals(40.0)
    found = moments(clock, (now - START) * rate, now)
    share, slow = 1 - math.exp(-STEP * rate / 2.0), max(0.0, 1 - rate)
    assert now[-1] - found[-1] == pytest.approx(STEP * slow * (1 - share) / share, rel=1e-6, abs=1e-9)
    assert (now - found).max() <= 2.5 * slow + 1e-9
    assert_allclose(np.diff(found)[-100:], STEP, rtol=1e-6)


@pytest.mark.parametrize("rate", [0.97, 1.03, 0.9, 1.1, 0.5, 1.5, 0.001, 1000.0, 0.0, -1.0])
def test_a_clock_with_a_wrong_rate_is_not_used(rate):
    clock, now = DeviceClock(), arrivals()
    assert_array_equal(moments(clock, 5.0 + (now - START) * rate, now), now)
    assert not clock.trusted
    assert clock.rate == round(rate, 2)


@pytest.mark.parametrize("rate", [0.9, 0.0, 1.1])
def test_a_clock_is_used_except_while_its_rate_is_wrong(rate):
    clock, now = DeviceClock(), arrivals(30.0)
    device = np.cumsum(np.where((now < START + 10) | (now >= START + 20), STEP, STEP * rate))
    found = moments(clock, device, now)
    for second, trusted in ((9, True), (16, False), (19, False), (29, True)):
        k = round(second / STEP)
        sure = slice(k, k + round(1 / STEP))
        assert_allclose(found[sure], now[sure], atol=0 if not trusted else 0.02)
    assert clock.trusted


def test_a_late_image_is_as_old_as_its_delay_and_an_early_one_reduces_that_of_the_next():
    clock = proved()
    assert clock.moment(4.0, START + 4.2) == pytest.approx(START + 4.0, abs=0.005)
    assert clock.moment(4.0 + STEP, START + 4.0 + STEP + 0.2) == pytest.approx(START + 4.0 + STEP, abs=0.01)
    clock = proved()
    assert clock.moment(4.0, START + 3.99) == START + 3.99
    assert clock.moment(4.0 + STEP, START + 4.0 + STEP) == pytest.approx(START + 3.99 + STEP, abs=0.001)


def test_a_lasting_delay_becomes_the_normal_one():
    clock, now = proved(), START + 4.0 + np.arange(1000) * STEP
    found = moments(clock, now - START, now + 0.09)
    assert found[0] == pytest.approx(now[0], abs=0.002)
    assert found[-1] == pytest.approx(now[-1] + 0.09, abs=1e-4)
    assert clock.trusted


@pytest.mark.parametrize("device", [0.0, 1e9])
def test_a_clock_that_is_reset_is_still_used(device):
    clock, now = proved(), START + 4.0 + np.arange(100) * STEP
    assert_allclose(moments(clock, device + now - START, now), now, atol=1e-6)
    assert clock.trusted


def test_images_that_arrive_unevenly_are_even():
    """The device's clock is 100 parts per million slow, like a bad crystal."""
    now = arrivals(600.0)
    late = np.random.default_rng(7).uniform(0.0, 0.005, len(now))
    uneven = np.abs(np.diff(moments(DeviceClock(), (now - START) * (1 - 1e-4), now + late)[PROVED:]) - STEP)
    assert np.median(uneven) < 1e-4
    assert uneven[PROVED:].max() < 0.002


@given(st.lists(st.tuples(st.floats(-1e9, 1e9), st.floats(0.0, 100.0)), max_size=200))
def test_no_time_is_before_the_last_one_or_in_the_future(pictures):
    clock, now, last = DeviceClock(), START, -math.inf
    for taken, later in pictures:
        now += later
        moment = clock.moment(taken, now)
        assert last <= moment <= now
        last = moment
