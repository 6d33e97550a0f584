import math

import numpy as np
import pytest

from capture.events import TICK_SECONDS, Lost, Tick
from capture.reconnecting import RETRY_SECONDS, ReopeningSource
from capture.source import SilentSource, wait
from puppetline.errors import SourceError

from .conftest import ScriptedSource, refused

pytestmark = pytest.mark.usefixtures("given_clock")

GONE = SourceError("device", found="nothing there", expected="a device", fix="Plug it in.")


def reopening(*openings):
    """Return a source that is opened as the given sources one after the other, or raises exceptions; and those left."""
    left = list(openings)

    def opener():
        found = left.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    return ReopeningSource("device:0", opener), left


def run(source, until):
    events = []
    for _ in range(1000):
        if until():
            return events
        wait(source, math.inf)
        events += source.receive()
    raise AssertionError(events)


def test_a_source_that_cannot_be_opened_at_first_is_an_error():
    assert refused(reopening, GONE) is GONE


def test_a_failed_source_is_closed_and_replaced_by_ticks_until_it_is_open_again():
    first, second = (
        ScriptedSource(RuntimeError("the cable"), ahead=100.0, received=5),
        ScriptedSource([Lost(0.0, 3)], received=2),
    )
    source, _ = reopening(first, GONE, OSError("in its own way"), second)
    start = source.now()
    assert source.receive() == []
    assert (first.closed, type(source.inner), source.inner.counts.received) == (True, SilentSource, 5)
    assert source.now() == pytest.approx(start)  # the clock continues
    *ticks, last = run(source, lambda: source.inner is second and not second.script)
    assert (last, source.counts.received) == (Lost(0.0, 3), 7)
    assert {type(tick) for tick in ticks} == {Tick}
    spaces = np.diff([start, *(tick.time for tick in ticks)])
    assert TICK_SECONDS - 1e-6 <= spaces.min() <= spaces.max() <= 1.1 * TICK_SECONDS
    assert sum(spaces) == pytest.approx(3 * RETRY_SECONDS, abs=1.1 * TICK_SECONDS)
    source.close()
    assert second.closed


def test_a_failure_is_logged_once_and_its_end_with_the_first_event_except_ticks(caplog):
    caplog.set_level("INFO")
    tick, lost = Tick(0.0), Lost(0.0, 1)
    source, left = reopening(
        ScriptedSource(GONE),
        ScriptedSource([tick], GONE),
        GONE,
        ScriptedSource([tick], [lost], [lost], GONE),
        ScriptedSource(),
    )
    run(source, lambda: not left)
    silent = f"the source is silent: {GONE}"
    assert caplog.messages == [silent, "the source is back", silent]
    assert {record.fields["source"] for record in caplog.records} == {"device:0"}


def test_images_without_a_performer_end_a_failure():
    second = ScriptedSource([Tick(0.0)], [Tick(1.0)])
    source, _ = reopening(ScriptedSource(GONE), second)
    run(source, lambda: source.inner is second)
    assert source.failure == str(GONE)
    second.counts.received += 1
    run(source, lambda: not second.script)
    assert source.failure == ""


def test_a_recording_that_has_ended_is_not_opened_again(given_clock):
    source, left = reopening(ScriptedSource(GONE, recorded=True), ScriptedSource())
    assert source.receive() == []
    end = given_clock.now() + 3 * RETRY_SECONDS
    run(source, lambda: given_clock.now() > end)
    assert (type(source.inner), len(left)) == (SilentSource, 1)
