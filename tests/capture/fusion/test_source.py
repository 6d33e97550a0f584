import socket
import time
from select import select

import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.events import Cue, Lost, Tick
from capture.fusion.source import FusedSource, Member
from capture.skeleton import SkeletonFrame
from capture.source import Counts, wait
from capture.sources.replay import RecordingSource
from puppetline.errors import SourceError

TIMEOUT_SECONDS = 20.0


class Scripted:
    """A live source whose events come from a test; exceptions are raised."""

    recorded = False

    def __init__(self, name):
        self.name, self.counts, self.news = name, Counts(), []
        self._waker, self._waiter = socket.socketpair()
        self.closed = False

    def show(self, *events):
        self.news += events
        self._waker.send(b"\0")

    def fileno(self):
        return self._waiter.fileno()

    def due(self):
        return time.monotonic() + 1000

    def now(self):
        return time.monotonic()

    def receive(self):
        news, self.news = self.news, []
        if news:
            self._waiter.recv(100)
        for event in news:
            if isinstance(event, Exception):
                raise event
        self.counts.received += len(news)
        return news

    def close(self):
        self.closed = True
        self._waker.close()
        self._waiter.close()


@pytest.fixture
def opened():
    """The opened sources by URI, the newest last."""
    return {"a": [], "b": []}


@pytest.fixture
def opener(opened):
    def open_one(uri):
        opened[uri].append(Scripted(uri))
        return opened[uri][-1]

    return open_one


@pytest.fixture
def source(opener, here, beside, until_end):
    return until_end(FusedSource("fused:two.toml", [Member("a", here), Member("b", beside, 0.04)], opener))


@pytest.fixture
def frame(walk):
    """Return a sensor's frame of a performer who stands still."""

    def make(pose, taken, user=1):
        positions = (walk.positions[0] - pose.position) @ pose.rotation
        return SkeletonFrame(taken, user, positions, np.ones(20, dtype=np.float32))

    return make


def next_events(source, ticks=False):
    give_up = time.monotonic() + TIMEOUT_SECONDS
    while time.monotonic() < give_up:
        wait(source, give_up)
        events = [event for event in source.receive() if ticks or not isinstance(event, Tick)]
        if events:
            return events
    raise AssertionError("nothing came")


def test_two_sensors_make_one_performer_in_the_coordinates_and_on_the_clock_of_the_first(
    source, opened, frame, here, beside, walk
):
    start = time.monotonic()
    opened["a"][0].show(frame(here, start))
    opened["b"][0].show(frame(beside, start + 0.04 + 0.001, user=5))
    [seen] = next_events(source)
    assert (seen.time, seen.user) == (start, 1)
    np.testing.assert_allclose(seen.positions, walk.positions[0], atol=1e-9)
    opened["b"][0].show(frame(beside, start + 0.25, user=5))  # the first is silent
    [seen] = next_events(source)
    assert (seen.time, seen.user) == (pytest.approx(start + 0.21), 1)
    np.testing.assert_allclose(seen.positions, walk.positions[0], atol=1e-9)
    assert source.counts.received == 3


def test_every_member_ends_the_wait(source, opened, frame, here, beside):
    source.receive()
    assert select([source.fileno()], [], [], 0)[0] == []
    for name, pose in (("a", here), ("b", beside)):
        opened[name][0].show(frame(pose, time.monotonic()))
        assert select([source.fileno()], [], [], TIMEOUT_SECONDS)[0] == [source.fileno()]
        source.receive()


def test_a_member_that_fails_is_opened_again_while_the_other_continues(source, opened, frame, here, beside):
    descriptor = source.fileno()
    opened["a"][0].show(RuntimeError("the cable"))
    source.receive()
    assert opened["a"][0].closed
    start = time.monotonic()
    opened["b"][0].show(frame(beside, start + 0.04))
    assert next_events(source)[0].time == pytest.approx(start)
    while len(opened["a"]) == 1:
        assert time.monotonic() < start + TIMEOUT_SECONDS
        wait(source, start + TIMEOUT_SECONDS)
        source.receive()
    assert len(opened["b"]) == 1
    again = time.monotonic()
    assert select([descriptor], [], [], 0)[0] == []
    opened["a"][1].show(frame(here, again))
    assert select([descriptor], [], [], TIMEOUT_SECONDS)[0] == [descriptor]
    assert [(event.time, event.user) for event in next_events(source)] == [(again, 1)]
    assert source.fileno() == descriptor
    assert source.counts.received == 2  # counts continue after a failure


def test_a_member_that_cannot_be_opened_again_is_tried_until_it_can(opened, opener, here, beside, caplog):
    tries = []

    def open_later(uri):
        tries.append(uri)
        if tries.count("a") in (2, 3):
            raise SourceError(uri, found="nothing there", expected="a device", fix="Plug it in.")
        return opener(uri)

    source = FusedSource("fused:", [Member("a", here), Member("b", beside)], open_later)
    opened["a"][0].show(SourceError("a", found="x", expected="y", fix="z"))
    give_up = time.monotonic() + TIMEOUT_SECONDS
    while len(opened["a"]) == 1:
        assert time.monotonic() < give_up
        wait(source, give_up)
        source.receive()
    assert tries == ["a", "b", "a", "a", "a"]
    assert len(caplog.messages) == 2  # silent, and cannot be opened; attempts are not logged again
    source.close()
    assert all(each.closed for each in (opened["a"][1], opened["b"][0]))


def test_a_member_that_cannot_be_opened_at_first_is_an_error_and_closes_the_others(opened, opener, here, beside):
    def open_a_only(uri):
        if uri == "b":
            raise SourceError("b", found="nothing there", expected="a device", fix="Plug it in.")
        return opener(uri)

    with pytest.raises(SourceError, match="nothing there"):
        FusedSource("fused:", [Member("a", here), Member("b", beside)], open_a_only)
    assert opened["a"][0].closed


def test_ticks_fill_gaps_and_a_performer_is_lost_once_all_members_have_lost_them(source, opened, frame, here, beside):
    start = time.monotonic()
    opened["a"][0].show(frame(here, start))
    opened["b"][0].show(frame(beside, start + 0.04))
    next_events(source)
    opened["a"][0].show(Lost(start + 0.01, 1))
    assert isinstance(next_events(source, ticks=True)[0], Tick)
    opened["b"][0].show(Lost(time.monotonic() + 0.04, 1))
    [lost] = next_events(source)
    assert (type(lost), lost.user) == (Lost, 1)


def test_the_tilt_of_the_first_sensor_is_reported_in_order_and_no_other(source, opened, frame, here, beside):
    start = time.monotonic()
    level = Cue(start + 0.001, "level", {"tilt": 4.0, "height": 1.2})
    opened["b"][0].show(Cue(start + 0.04, "level", {"tilt": 9.0, "height": 0.5}))
    opened["a"][0].show(frame(here, start), level, Cue(start + 0.002, "calibrate"), Lost(start + 0.003, 1))
    events = next_events(source)
    assert [type(event) for event in events] == [SkeletonFrame, Cue, Lost]
    assert events[1] == level


def test_the_tilt_in_other_coordinates_is_not_reported(opened, opener, frame, beside):
    source = FusedSource("fused:", [Member("a", beside), Member("b", beside)], opener)
    start = time.monotonic()
    opened["a"][0].show(Cue(start, "level", {"tilt": 4.0, "height": 1.2}), frame(beside, start + 0.01))
    assert [type(event) for event in next_events(source)] == [SkeletonFrame]
    source.close()


def test_every_frame_is_returned_at_its_time(source, opened, frame, here):
    times = [time.monotonic() + 0.001 * k for k in range(5)]
    opened["a"][0].show(*(frame(here, each) for each in times))
    assert [event.time for event in next_events(source)] == times


def to_the_end(source):
    """Return all events, and the error at the end."""
    events = []
    while True:
        try:
            events += next_events(source)
        except SourceError as error:
            return events, error


def part(clip, start, end):
    return SkeletonClip("", clip.user, *(each[start:end] for each in (clip.times, clip.positions, clip.confidence)))


@pytest.mark.parametrize("late", [0.0, 0.4, -0.4])
def test_recordings_play_together_by_their_clocks_every_frame_and_then_end(walk, here, beside, virtual_sensor, late):
    """The second recording begins later or earlier than the first; its clock is 100 s ahead."""
    other = virtual_sensor(beside, 100.0).record(walk)
    begin = round(abs(late) * 30)
    first = part(walk, begin if late < 0 else 0, 40)
    second = part(other, begin if late > 0 else 0, 30)
    clips = {"a": first, "b": second}
    source = FusedSource(
        "fused:",
        [Member("a", here), Member("b", beside, 100.0)],
        lambda uri: RecordingSource.of_clips(uri, [clips[uri]]),
        recorded=True,
    )
    start = time.monotonic()
    events, error = to_the_end(source)
    assert error.found == "the end of all recordings"
    source.close()
    assert np.isfinite(source.now())
    times = np.array([event.time for event in events])
    assert abs(times[0] - start) < TIMEOUT_SECONDS
    truth = part(walk, 0, 40)  # the earlier one begins at 0
    np.testing.assert_allclose(times - times[0], truth.times, atol=1e-6)
    np.testing.assert_allclose(np.stack([event.positions for event in events]), truth.positions, atol=0.02)
    assert {event.user for event in events} == {1}
