import math
import socket
from select import select

import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.events import Cue, Lost, Tick
from capture.fusion.source import FusedSource, Member
from capture.skeleton import SkeletonFrame
from capture.source import wait
from capture.sources.replay import RecordingSource
from puppetline import clock
from puppetline.errors import RecordingEndError, SourceError

from ...recordings import tracked_frame
from ..conftest import ScriptedSource, refused
from .virtual_sensors import BESIDE, HERE, WALK, VirtualSensor, part

pytestmark = pytest.mark.usefixtures("given_clock")

GONE = SourceError("a", found="nothing there", expected="a device", fix="Plug it in.")


class Scripted(ScriptedSource):
    """A live source whose events come from a test; exceptions are raised."""

    def __init__(self, name):
        super().__init__(name=name)
        self._waker, self._waiter = socket.socketpair()

    def show(self, *events):
        self.script += [event if isinstance(event, Exception) else [event] for event in events]
        self._waker.send(b"\0" * len(events))

    def fileno(self):
        return self._waiter.fileno()

    def due(self):
        return math.inf

    def receive(self):
        news = []
        while self.script:
            self._waiter.recv(1)
            news += super().receive()
            self.counts.received += 1
        return news

    def close(self):
        super().close()
        self._waker.close()
        self._waiter.close()


class Opener:
    """Opens a source by its URI unless a test refuses it; remembers all, the newest last."""

    def __init__(self):
        self.opened, self.tries, self.refused = {"a": [], "b": []}, [], ()

    def __call__(self, uri):
        self.tries.append(uri)
        if (uri, self.tries.count(uri)) in self.refused:
            raise GONE
        self.opened[uri].append(Scripted(uri))
        return self.opened[uri][-1]

    def show(self, uri, *events):
        self.opened[uri][-1].show(*events)


@pytest.fixture
def opener():
    return Opener()


@pytest.fixture
def open_source(opener, until_end):
    """Open two sensors, the second one's clock 0.04 s ahead."""
    return lambda first=HERE: until_end(FusedSource("fused:", [Member("a", first), Member("b", BESIDE, 0.04)], opener))


@pytest.fixture
def source(open_source):
    return open_source()


def frame(pose, taken, user=1):
    """Return a sensor's frame of a performer who stands still."""
    positions = (WALK.positions[0] - pose.position) @ pose.rotation
    return tracked_frame(taken, positions, user)


def next_events(source, until=None, ticks=False):
    """Return the next events, or receive until something is true."""
    for _ in range(1000):
        wait(source, math.inf)
        events = [event for event in source.receive() if ticks or not isinstance(event, Tick)]
        if until() if until else events:
            return events
    raise AssertionError("nothing came")


def test_two_sensors_make_one_performer_in_the_coordinates_and_on_the_clock_of_the_first(source, opener):
    start = clock.now()
    opener.show("a", frame(HERE, start))
    opener.show("b", frame(BESIDE, start + 0.041, user=5))
    [seen] = next_events(source)
    assert (seen.time, seen.user) == (start, 1)
    assert_allclose(seen.positions, WALK.positions[0], atol=1e-9)
    opener.show("b", frame(BESIDE, start + 0.25, user=5))  # the first is silent
    [seen] = next_events(source)
    assert (seen.time, seen.user) == (pytest.approx(start + 0.21), 1)
    assert_allclose(seen.positions, WALK.positions[0], atol=1e-9)
    assert source.counts.received == 3
    times = [start + 0.3 + 0.001 * k for k in range(5)]
    opener.show("a", *(frame(HERE, each) for each in times))
    assert [event.time for event in next_events(source)] == times


def readable(source):
    return bool(select([source.fileno()], [], [], 0)[0])


def test_a_member_that_fails_is_opened_again_while_the_other_continues(source, opener):
    opener.refused = (("a", 2),)
    descriptor, start = source.fileno(), clock.now()
    opener.show("a", RuntimeError("the cable"))
    assert readable(source)
    source.receive()
    assert (opener.opened["a"][0].closed, readable(source)) == (True, False)
    opener.show("b", frame(BESIDE, start + 0.04))
    assert readable(source)
    assert next_events(source)[0].time == pytest.approx(start)
    next_events(source, until=lambda: len(opener.opened["a"]) == 2)
    again = clock.now()
    opener.show("a", frame(HERE, again))
    assert (readable(source), source.fileno()) == (True, descriptor)
    assert [(event.time, event.user) for event in next_events(source)] == [(again, 1)]
    assert source.counts.received == 2  # counts continue after a failure
    source.close()
    assert all(opener.opened[name][-1].closed for name in "ab")


def test_a_member_that_cannot_be_opened_at_first_is_an_error_and_closes_the_others(open_source, opener):
    opener.refused = (("b", 1),)
    refused(open_source)
    assert opener.opened["a"][0].closed


def test_ticks_fill_gaps_and_a_performer_is_lost_once_all_members_have_lost_them(source, opener):
    start = clock.now()
    opener.show("a", frame(HERE, start))
    opener.show("b", frame(BESIDE, start + 0.04))
    next_events(source)
    opener.show("a", Lost(start + 0.01, 1))
    assert isinstance(next_events(source, ticks=True)[0], Tick)
    opener.show("b", Lost(clock.now() + 0.04, 1))
    [lost] = next_events(source)
    assert (type(lost), lost.user) == (Lost, 1)


@pytest.mark.parametrize(("pose", "kinds"), [(HERE, [SkeletonFrame, Cue, Lost]), (BESIDE, [SkeletonFrame, Lost])])
def test_the_tilt_of_the_first_sensor_in_the_common_coordinates_is_reported_in_order_and_no_other(
    open_source, opener, pose, kinds
):
    source, start = open_source(pose), clock.now()
    level = Cue(start + 0.001, "level", {"tilt": 4.0, "height": 1.2})
    opener.show("b", Cue(start + 0.04, "level", {"tilt": 9.0, "height": 0.5}))
    opener.show("a", frame(pose, start), level, Cue(start + 0.002, "calibrate"), Lost(start + 0.003, 1))
    events = next_events(source)
    assert [type(event) for event in events] == kinds
    assert level in events or Cue not in kinds


@pytest.mark.parametrize("late", [0, 12, -12])
def test_recordings_play_together_by_their_clocks_every_frame_and_then_end(until_end, late):
    """The second recording begins some frames later or earlier than the first; its clock is 100 s ahead."""
    other = VirtualSensor(BESIDE, 100.0).record(WALK)
    clips = {"a": part(WALK, max(-late, 0), 40), "b": part(other, max(late, 0), 30)}
    members = [Member("a", HERE), Member("b", BESIDE, 100.0)]
    source = until_end(
        FusedSource("fused:", members, lambda uri: RecordingSource.of_clips(uri, [clips[uri]]), recorded=True)
    )
    start, events = clock.now(), []
    with pytest.raises(RecordingEndError) as ended:  # noqa: PT012
        while True:
            events += next_events(source)
    assert ended.value.where == "fused:"
    times = np.array([event.time for event in events])
    true = part(WALK, 0, 40)  # the earlier one begins at 0
    assert times[0] == pytest.approx(start, abs=1e-3)
    assert_allclose(times - times[0], true.times, atol=1e-6)
    assert_allclose(np.stack([event.positions for event in events]), true.positions, atol=0.02)
    assert {event.user for event in events} == {1}
