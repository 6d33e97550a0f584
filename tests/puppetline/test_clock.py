"""The clock that everything waits by, and the one that tests turn."""

import asyncio
import math
import threading
import time

import pytest

from puppetline import clock

from ..clock import GivenLoop


def test_the_machines_clock_is_the_monotonic_one():
    before = time.monotonic()
    assert before <= clock.now() <= time.monotonic()
    assert before <= clock.now_ns() / 1e9 <= time.monotonic()
    assert clock.wall() == pytest.approx(time.time(), abs=3600)


def test_a_wait_is_given_the_seconds_that_are_left():
    assert clock.block(math.inf, lambda seconds: seconds) == math.inf
    assert 0 < clock.block(clock.now() + 60, lambda seconds: seconds) <= 60
    assert clock.block(clock.now() - 60, lambda seconds: seconds) == 0.0


def test_a_given_clock_moves_by_waits_alone_and_does_what_is_due_on_the_way(given_clock):
    start, done = clock.now(), []
    for seconds in (3.0, 1.0, 7.0):
        given_clock.call_at(start + seconds, lambda: done.append(clock.now() - start))
    clock.sleep_until(start + 5.0)
    assert (clock.now() - start, done) == (5.0, [1.0, 3.0])
    assert clock.block(math.inf, lambda _: clock.now() > start)
    assert clock.block(start + 100.0, lambda _: len(done) == 3)
    assert clock.now() - start == 7.0
    assert clock.now_ns() == round(1e9 * clock.now())


def test_other_threads_wait_for_the_test_to_advance_the_clock(given_clock):
    woken, until = [], clock.now() + 5.0

    def sleep():
        clock.sleep_until(until)
        woken.append(clock.now())

    thread = threading.Thread(target=sleep)
    thread.start()
    given_clock.advance(4.0)
    assert not woken
    given_clock.advance(1.0)
    thread.join()
    assert woken == [until]


def test_while_the_given_clock_stands_waits_end_after_a_moment(given_clock):
    start = clock.now()
    with given_clock.standing():
        assert not clock.block(start + 5.0, lambda _: False)
    assert clock.now() == start


def test_an_event_loop_on_the_given_clock_sleeps_exactly_and_at_once(given_clock):
    async def sleep(seconds):
        await asyncio.sleep(seconds)
        return clock.now()

    async def both():
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.Event().wait(), 3600.0)
        return await asyncio.gather(sleep(20.0), sleep(10.0))

    start = clock.now()
    with asyncio.Runner(loop_factory=GivenLoop) as runner:
        assert runner.run(both()) == pytest.approx([start + 3620.0, start + 3610.0])
