import logging
import threading
import time
from itertools import pairwise
from select import select

import numpy as np
import pytest

from capture.events import TICK, Tick
from capture.sensors import source as module
from capture.sensors.picture import Picture
from capture.sensors.source import SensorSource
from capture.skeleton import SkeletonFrame
from puppetline.errors import SourceError

from .rooms import LENS as ROOM_LENS
from .rooms import room


def _told(events):
    return [(type(event).__name__, event.user) for event in events]


class Halting:
    """A tracker that begins with a picture and goes on when it is told to."""

    name = "a halting tracker"

    def __init__(self, tracker):
        self.tracker = tracker
        self.begun, self.go_on = threading.Semaphore(0), threading.Semaphore(0)

    def track(self, picture):
        self.begun.release()
        assert self.go_on.acquire(timeout=10)
        return self.tracker.track(picture)

    def close(self):
        self.tracker.close()


def test_a_person_in_a_picture_is_a_frame_at_the_moment_of_the_picture(watch, scripted_device, scripted_tracker):
    watched = watch(scripted_device, scripted_tracker)
    before = time.monotonic()
    scripted_device.show(5.0)
    [frame] = watched.events()
    assert isinstance(frame, SkeletonFrame)
    assert frame.user == 1
    assert before <= frame.time <= time.monotonic()
    assert (frame.positions.dtype, frame.positions.shape) == (np.float64, (20, 3))
    assert (frame.positions == 5.0).all()
    assert (frame.confidence == 1.0).all()


def test_what_gives_pictures_and_what_finds_people_is_named_in_the_log(
    watch, scripted_device, scripted_tracker, caplog
):
    caplog.set_level(logging.INFO, "capture")
    scripted_device.show(0.0)
    watch(scripted_device, scripted_tracker).events()
    assert caplog.messages == ["test: a scripted device gives the pictures, a scripted tracker finds people in them"]


def test_the_two_clocks_part_and_meet_again():
    clock = module._Clock()
    assert clock.monotonic(5.0, 1005.0) == 1005.0
    assert clock.monotonic(6.0, 1006.0) == 1006.0
    assert clock.monotonic(7.0, 1006.5) == 1006.5, "a picture that is early shows that the others were late"
    assert clock.monotonic(8.0, 1008.0) == pytest.approx(1007.5 + 0.5 * module._RISE)
    for k in range(1000):
        clock.monotonic(9.0 + k, 1009.0 + k)
    assert clock.monotonic(2000.0, 3000.0) == pytest.approx(3000.0, abs=1e-4), "a lasting delay is taken for the rule"
    assert clock.monotonic(5.0, 4000.0) == 4000.0, "a clock that goes back was set anew"


def test_pictures_that_come_unevenly_are_spaced_as_the_device_says():
    clock = module._Clock()
    late = np.random.default_rng(7).uniform(0.0, 0.005, 300)
    times = np.arange(300) / 30
    moments = [clock.monotonic(taken, 1000 + taken + lag) for taken, lag in zip(times, late, strict=True)]
    assert np.abs(np.diff(moments[50:]) - 1 / 30).max() < 0.001


def test_who_is_found_and_lost_is_told_in_order(watch, scripted_device, scripted_tracker):
    watched = watch(scripted_device, scripted_tracker)
    changes = [
        ((1, 2), [("SkeletonFrame", 1), ("SkeletonFrame", 2)]),
        ((2,), [("Lost", 1), ("SkeletonFrame", 2)]),
        ((), [("Lost", 2)]),
        ((1,), [("SkeletonFrame", 1)]),
        ((7, 3), [("Lost", 1), ("SkeletonFrame", 7), ("SkeletonFrame", 3)]),
    ]
    for k, (users, told) in enumerate(changes):
        scripted_tracker.users = users
        scripted_device.show(0.01 * k)
        assert _told(watched.events(len(told))) == told


def _wait_until(what):
    give_up = time.monotonic() + 10
    while not what():
        assert time.monotonic() < give_up
        time.sleep(0.001)


@pytest.mark.usefixtures("unhurried")
def test_the_newest_picture_is_tracked_and_what_it_overtakes_is_counted(watch, scripted_device, scripted_tracker):
    halting = Halting(scripted_tracker)
    watched = watch(scripted_device, halting)
    scripted_device.show(0.0)
    assert halting.begun.acquire(timeout=10)
    scripted_device.show(0.001, 0.002, 0.003)
    _wait_until(lambda: watched.source.counts.received == 4)
    for _ in range(2):
        halting.go_on.release()
        watched.events()
    assert scripted_tracker.seen == [0.0, 0.003]
    assert watched.source.counts.dropped == 2


@pytest.mark.usefixtures("unhurried")
def test_a_frame_that_was_not_taken_makes_way_for_the_next(watch, scripted_device, scripted_tracker):
    watched = watch(scripted_device, scripted_tracker)
    for k in range(3):
        scripted_device.show(0.001 * k)
        _wait_until(lambda k=k: len(scripted_tracker.seen) == k + 1)
    scripted_tracker.users = (1, 2)
    scripted_device.show(0.003)
    _wait_until(lambda: watched.source.counts.dropped == 3)
    assert _told(watched.events(2)) == [("SkeletonFrame", 1), ("SkeletonFrame", 2)]


def test_a_picture_that_comes_too_late_is_never_tracked(watch, scripted_device, scripted_tracker):
    watched = watch(scripted_device, scripted_tracker)
    scripted_device.show(0.0)
    watched.events()
    time.sleep(2 * module.OLDEST)
    scripted_device.show(0.01)
    scripted_device.show(10.0)
    watched.events()
    assert scripted_tracker.seen == [0.0, 10.0]
    assert watched.source.counts.dropped == 1


def test_a_picture_that_grew_old_while_the_tracker_was_busy_is_never_tracked(watch, scripted_device, scripted_tracker):
    halting = Halting(scripted_tracker)
    watched = watch(scripted_device, halting)
    scripted_device.show(0.0)
    assert halting.begun.acquire(timeout=10)
    scripted_device.show(0.001)
    time.sleep(2 * module.OLDEST)
    halting.go_on.release(2)
    _wait_until(lambda: watched.source.counts.dropped == 1)
    scripted_device.show(10.0)
    watched.events(until=lambda _: 10.0 in scripted_tracker.seen)
    assert scripted_tracker.seen == [0.0, 10.0]


def test_ticks_pass_the_time_and_no_event_goes_back(watch, scripted_device, scripted_tracker):
    """Frames have the times of their pictures, which are earlier than those at which nothing came."""
    watched = watch(scripted_device, scripted_tracker)
    start = watched.source.now()
    events = []
    for k in range(4):
        scripted_device.show(0.15 * k)
        until = time.monotonic() + 0.15
        while time.monotonic() < until:
            watched.wait()
            events += watched.source.receive()
    times = [event.time for event in events]
    assert times == sorted(times)
    assert {type(event) for event in events} == {SkeletonFrame, Tick}
    gaps = np.diff([start - module.OLDEST, *times])
    assert gaps.max() < 0.15
    ticks = [
        later - earlier
        for (earlier, later), event in zip(pairwise(times), events[1:], strict=True)
        if type(event) is Tick
    ]
    assert min(ticks) >= TICK - 1e-9


def test_nobody_in_the_picture_lets_time_pass_too(watch, scripted_device, scripted_tracker):
    scripted_tracker.users = ()
    watched = watch(scripted_device, scripted_tracker, recorded=True)
    scripted_device.show(3.0)
    _wait_until(lambda: select([watched.source.fileno()], [], [], 0)[0])
    assert watched.source.receive() == [Tick(3.0)]


def test_of_a_recording_every_picture_is_tracked_at_its_own_time(watch, scripted_device, scripted_tracker):
    end = SourceError("take", found="that it has ended", expected="more", fix="No.")
    times = [10.0 + 0.001 * k for k in range(50)]
    scripted_device.show(*times)
    scripted_device.pictures.put(end)
    watched = watch(scripted_device, scripted_tracker, recorded=True, fast=True)
    frames = []
    for _ in times:
        watched.wait()
        assert watched.source.now() == (frames[-1].time if frames else 0.0)
        frames += watched.events()
        time.sleep(0.001)
    assert [frame.time for frame in frames] == scripted_tracker.seen == times
    assert watched.error() is end
    assert (watched.source.counts.received, watched.source.counts.dropped) == (50, 0)


def test_a_depth_sensor_says_how_it_stands_as_soon_as_the_floor_tells(watch, scripted_device, scripted_tracker, caplog):
    caplog.set_level(logging.INFO, "capture")
    depth = room(12, 0, 1.3)
    for k in range(8):
        scripted_device.pictures.put(Picture(0.25 * k, ROOM_LENS, None, depth))
    *before, cue, after = watch(scripted_device, scripted_tracker, recorded=True, fast=True).events(7)
    assert [frame.time for frame in before] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert (cue.time, cue.do, after.time) == (1.0, "level", 1.25)
    assert cue.arguments == pytest.approx({"tilt": 12, "roll": 0, "height": 1.3}, abs=0.1)
    assert caplog.messages[-1] == "test:: the sensor is 1.30 m above the floor, looks 12.0° down and leans by 0.0°"


def test_a_recording_takes_its_time_unless_it_is_to_be_fast(watch, scripted_device, scripted_tracker):
    scripted_device.show(10.0, 10.1, 10.3)
    watched = watch(scripted_device, scripted_tracker, recorded=True)
    [_] = watched.events()
    first = time.monotonic()
    watched.events(2)
    assert time.monotonic() - first >= 0.3 - 0.05
    watched.source.close()
    fast = watch(scripted_device, scripted_tracker, recorded=True, fast=True)
    scripted_device.show(0.0, 1000.0)
    assert [frame.time for frame in fast.events(2)] == [0.0, 1000.0]


def test_a_device_that_stops_giving_pictures_is_given_up(watch, scripted_device, scripted_tracker, monkeypatch):
    monkeypatch.setattr(module, "SILENT", 0.2)
    watched = watch(scripted_device, scripted_tracker)
    scripted_device.show(0.0)
    watched.events()
    assert "no new picture within 0.2 s" in watched.error().found


def test_a_device_that_gives_old_pictures_only_is_given_up(watch, scripted_device, scripted_tracker, monkeypatch):
    monkeypatch.setattr(module, "SILENT", 0.2)
    watched = watch(scripted_device, scripted_tracker)
    scripted_device.show(0.0)
    watched.events()
    time.sleep(0.15)
    scripted_device.show(0.001, 0.002)
    assert "no new picture within 0.2 s" in watched.error().found


def test_a_device_that_never_opens_is_given_up_and_closing_does_not_wait_for_it(watch, scripted_tracker, monkeypatch):
    monkeypatch.setattr(module, "OPENING", 0.2)
    monkeypatch.setattr(module, "_CLOSING", 0.1)
    stuck = threading.Event()
    watched = watch(stuck.wait, scripted_tracker)
    assert "nor a first one within 0.2 s" in watched.error().found
    watched.source.close()
    assert not stuck.is_set()
    stuck.set()


def test_what_hinders_opening_is_raised_and_what_was_opened_is_closed(watch, scripted_device, scripted_tracker):
    refusal = SourceError("x", found="no", expected="yes", fix="Plug it in.")

    def refuse(*_):
        raise refusal

    assert watch(refuse, scripted_tracker).error() is refusal
    assert watch(scripted_device, refuse).error() is refusal
    assert (scripted_device.closed, scripted_tracker.closed) == (1, 0)


@pytest.mark.parametrize("culprit", ["device", "tracker"])
def test_what_a_driver_throws_is_an_error_that_says_who_and_what_to_do(
    watch, scripted_device, scripted_tracker, culprit
):
    watched = watch(scripted_device, scripted_tracker)
    scripted_device.show(0.0)
    watched.events()
    if culprit == "device":
        scripted_device.pictures.put(OSError("bus reset"))
    else:
        scripted_tracker.users = OSError("bus reset")
        scripted_device.show(0.01)
    error = watched.error()
    assert isinstance(error, SourceError)
    assert error.found == f"that a scripted {culprit} failed (OSError: bus reset)"
    assert "doctor" in error.fix
    assert (scripted_device.closed, scripted_tracker.closed) == (1, 1)


def test_closing_closes_the_tracker_and_then_the_device_once_and_leaves_no_thread(scripted_device, scripted_tracker):
    order = []
    scripted_device.close = lambda: order.append("device")
    scripted_tracker.close = lambda: order.append("tracker")
    before = threading.active_count()
    source = SensorSource("test:", lambda: scripted_device, lambda _device: scripted_tracker)
    scripted_device.show(0.0)
    assert select([source.fileno()], [], [], 10)[0]
    source.close()
    source.close()
    assert order == ["tracker", "device"]
    assert threading.active_count() == before
