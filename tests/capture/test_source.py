import math

import numpy as np
import pytest

from capture.events import TICK_SECONDS, Tick
from capture.source import Counts, SilentSource, wait


def test_a_silent_source_ticks_on_the_clock_of_the_source_that_it_replaces(given_clock):
    counts = Counts(received=7)
    silence = SilentSource("osc:1", counts, 500.0)
    assert (silence.counts, silence.receive()) == (counts, [])
    ticks = []
    while len(ticks) < 5:
        wait(silence, math.inf)
        ticks += silence.receive()
    assert {type(tick) for tick in ticks} == {Tick}
    assert [tick.time for tick in ticks] == pytest.approx(500 + TICK_SECONDS * np.arange(1, 6), abs=1e-5)
