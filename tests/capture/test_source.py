import itertools
import time
from select import select

from capture.events import TICK_SECONDS, Tick
from capture.source import Counts, SilentSource


def test_a_silent_source_ticks_on_the_clock_of_the_source_that_it_replaces():
    counts = Counts(received=7)
    silence = SilentSource("osc:1", counts, 1000.0)
    assert silence.counts is counts
    assert silence.receive() == []
    ticks = []
    while len(ticks) < 5:
        select([], [], [], max(0.0, silence.due() - time.monotonic()))
        ticks += silence.receive()
    assert all(isinstance(tick, Tick) for tick in ticks)
    times = [1000.0, *(tick.time for tick in ticks)]
    assert all(later - earlier >= TICK_SECONDS - 1e-6 for earlier, later in itertools.pairwise(times))
    assert times[-1] <= silence.now()
