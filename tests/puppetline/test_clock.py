"""The clock that everything waits by."""

import math
import time

import pytest

from puppetline import clock


def test_the_machines_clock_is_the_monotonic_one():
    before = time.monotonic()
    assert before <= clock.now() <= time.monotonic()
    assert before <= clock.now_ns() / 1e9 <= time.monotonic()
    assert clock.wall() == pytest.approx(time.time(), abs=3600)


def test_a_wait_is_given_the_seconds_that_are_left():
    assert clock.block(math.inf, lambda seconds: seconds) == math.inf
    assert 0 < clock.block(clock.now() + 60, lambda seconds: seconds) <= 60
    assert clock.block(clock.now() - 60, lambda seconds: seconds) == 0.0
