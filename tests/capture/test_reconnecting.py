import itertools
import time

import pytest

from capture.events import TICK_SECONDS, Lost, Tick
from capture.reconnecting import RETRY_SECONDS, ReopeningSource
from capture.source import Counts, SilentSource, wait
from puppetline.errors import SourceError

GONE = SourceError("device", found="nothing there", expected="a device", fix="Plug it in.")
TIMEOUT_SECONDS = 20.0


class Scripted:
    """A source that returns one list of a script per call, or raises its exception; nothing at the end."""

    name = "scripted"

    def __init__(self, *script, received=0, clock=0.0, recorded=False):
        self.recorded = recorded
        self.script, self.counts, self.ahead, self.closed = list(script), Counts(received), clock, False

    def fileno(self):
        return None

    def due(self):
        return time.monotonic() if self.script else time.monotonic() + 1000

    def now(self):
        return time.monotonic() + self.ahead

    def receive(self):
        found = self.script.pop(0) if self.script else []
        if isinstance(found, Exception):
            raise found
        return found

    def close(self):
        self.closed = True


@pytest.fixture
def reopening():
    """Return a source whose opener returns the given sources one after the other, or raises an exception."""

    def make(*openings):
        left = list(openings)

        def opener():
            found = left.pop(0)
            if isinstance(found, Exception):
                raise found
            return found

        source = ReopeningSource("device:0", opener)
        source.left = left
        return source

    return make


def run(source, until):
    events, give_up = [], time.monotonic() + TIMEOUT_SECONDS
    while not until():
        assert time.monotonic() < give_up
        wait(source, give_up)
        events += source.receive()
    return events


def test_a_source_that_cannot_be_opened_at_first_is_an_error(reopening):
    with pytest.raises(SourceError, match="nothing there"):
        reopening(GONE)


def test_a_failed_source_is_closed_and_replaced_by_ticks_until_it_is_open_again(reopening):
    first, second = Scripted(RuntimeError("the cable"), clock=100.0), Scripted([Lost(0.0, 3)])
    source = reopening(first, second)
    assert source.receive() == []
    assert (first.closed, type(source.inner), source.name) == (True, SilentSource, "device:0")
    assert 0 < source.now() - time.monotonic() - 100.0 + 1e-3 < 1e-2  # the clock continues
    events = run(source, lambda: source.inner is second and not second.script)
    assert events[-1] == Lost(0.0, 3)
    ticks = events[:-1]
    assert len(ticks) > 3
    assert all(isinstance(tick, Tick) for tick in ticks)
    assert all(earlier.time < later.time for earlier, later in itertools.pairwise(ticks))


def test_a_source_is_retried_after_any_error_until_it_opens(reopening):
    last = Scripted()
    source = reopening(Scripted(GONE), GONE, OSError("in its own way"), last)
    run(source, lambda: source.inner is last)
    source.close()
    assert last.closed


def test_counts_continue(reopening):
    source = reopening(Scripted(GONE, received=5), Scripted(received=2))
    source.receive()
    assert source.counts.received == 5
    run(source, lambda: not source.left)
    assert source.counts.received == 7


def test_a_failure_is_logged_once_and_its_end_with_the_first_event_except_ticks(reopening, caplog):
    caplog.set_level("INFO")
    tick, lost = Tick(0.0), Lost(0.0, 1)
    source = reopening(Scripted(GONE), Scripted([tick], GONE), GONE, Scripted([tick], [lost], [lost], GONE), Scripted())
    run(source, lambda: not source.left)
    silent = f"the source is silent: {GONE}"
    assert caplog.messages == [silent, "the source is back", silent]
    assert {record.fields["source"] for record in caplog.records} == {"device:0"}


def test_images_without_a_performer_end_a_failure(reopening):
    second = Scripted([Tick(0.0)], [Tick(1.0)])
    source = reopening(Scripted(GONE), second)
    run(source, lambda: source.inner is second)
    assert source.failure == str(GONE)
    second.counts.received += 1
    run(source, lambda: not second.script)
    assert source.failure == ""


def test_a_recording_that_has_ended_is_not_opened_again(reopening):
    source = reopening(Scripted(GONE, recorded=True), Scripted())
    assert source.receive() == []
    silence = source.inner
    ticks = []
    while len(ticks) * TICK_SECONDS < 1.5 * RETRY_SECONDS:
        wait(source, time.monotonic() + TIMEOUT_SECONDS)
        ticks += source.receive()
    assert source.inner is silence
    assert len(source.left) == 1
