import logging
import subprocess
import sys
import threading
import time
from itertools import pairwise
from select import select

import numpy as np
import pytest

from capture.events import TICK_SECONDS, Tick
from capture.sensors import clock
from capture.sensors import source as module
from capture.sensors.clock import DeviceClock
from capture.sensors.source import SensorSource
from capture.skeleton import SkeletonFrame
from capture.trackers.picture import Picture
from puppetline.errors import SourceError

from ..devices import LENS
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


def test_a_device_whose_clock_stands_still_goes_on_and_it_is_said_once(
    watch, scripted_device, scripted_tracker, caplog, monkeypatch
):
    monkeypatch.setattr(clock, "SPAN", 0.02)
    watched = watch(scripted_device, scripted_tracker)
    said = "test: a second is 0 s on the clock of a scripted device: frames have the moments at which pictures come"

    def frames(count):
        found = []
        for _ in range(count):
            before = time.monotonic()
            scripted_device.show(5.0)
            [frame] = watched.events()
            assert before <= frame.time <= time.monotonic()
            found.append(frame)
            time.sleep(0.005)
        return found

    give_up = time.monotonic() + 10
    while said not in caplog.messages:
        assert time.monotonic() < give_up
        frames(1)
    assert len(frames(20)) == 20
    assert caplog.messages == [said]


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


def test_a_frame_that_was_not_taken_makes_way_for_the_next(watch, scripted_device, scripted_tracker):
    watched = watch(scripted_device, scripted_tracker)
    for k in range(3):
        scripted_device.show(0.001 * k)
        _wait_until(lambda k=k: len(scripted_tracker.seen) == k + 1)
    scripted_tracker.users = (1, 2)
    scripted_device.show(0.003)
    _wait_until(lambda: watched.source.counts.dropped == 3)
    assert _told(watched.events(2)) == [("SkeletonFrame", 1), ("SkeletonFrame", 2)]


@pytest.fixture
def strict(monkeypatch):
    """Pictures can be too old, and how old they are is known: the device's clock is ours."""
    monkeypatch.setattr(module, "OLDEST", 0.1)

    class Ours(DeviceClock):
        def moment(self, taken, _now):
            return taken

    monkeypatch.setattr(module, "DeviceClock", Ours)


def _show_until_somebody_comes(watched, device):
    """Show fresh pictures, of which a busy machine may leave out some; return the time of the one that came."""
    shown = []

    def came(found):
        if not found:
            shown.append(time.monotonic())
            device.show(shown[-1])
        return found

    [frame, *_] = watched.events(until=came)
    assert frame.time in shown
    return frame.time


@pytest.mark.usefixtures("strict")
def test_a_picture_that_comes_too_late_is_never_tracked(watch, scripted_device, scripted_tracker):
    watched = watch(scripted_device, scripted_tracker)
    late = time.monotonic() - 1.01 * module.OLDEST
    scripted_device.show(late)
    assert _show_until_somebody_comes(watched, scripted_device) > late
    assert late not in scripted_tracker.seen
    assert watched.source.counts.dropped >= 1


@pytest.mark.usefixtures("strict")
def test_a_picture_that_grew_old_while_the_tracker_was_busy_is_never_tracked(watch, scripted_device, scripted_tracker):
    halting = Halting(scripted_tracker)
    watched = watch(scripted_device, halting)
    first = time.monotonic()
    scripted_device.show(first)
    assert halting.begun.acquire(timeout=10)
    waiting = time.monotonic()
    scripted_device.show(waiting)
    time.sleep(2 * module.OLDEST)
    halting.go_on.release(1000)
    assert _show_until_somebody_comes(watched, scripted_device) > waiting
    assert first in scripted_tracker.seen
    assert waiting not in scripted_tracker.seen


@pytest.mark.usefixtures("strict")
@pytest.mark.parametrize("who", ["tracker", "caller"])
def test_who_was_found_in_a_picture_that_has_become_too_old_is_not_given(watch, scripted_device, scripted_tracker, who):
    halting = Halting(scripted_tracker)
    watched = watch(scripted_device, halting)
    late = time.monotonic()
    scripted_device.show(late)
    assert halting.begun.acquire(timeout=10)
    if who == "caller":
        halting.go_on.release()
        _wait_until(lambda: select([watched.source.fileno()], [], [], 0)[0])
    time.sleep(1.5 * module.OLDEST)
    halting.go_on.release(1000)
    assert _show_until_somebody_comes(watched, scripted_device) > late
    assert late in scripted_tracker.seen
    assert watched.source.counts.dropped >= 1


@pytest.mark.usefixtures("strict")
def test_who_is_lost_is_told_however_late(watch, scripted_device, scripted_tracker):
    halting = Halting(scripted_tracker)
    watched = watch(scripted_device, halting)
    halting.go_on.release(1000)
    _show_until_somebody_comes(watched, scripted_device)
    scripted_tracker.users = ()
    _wait_until(lambda: not halting.go_on.acquire(blocking=False))
    time.sleep(0.01)
    while halting.begun.acquire(blocking=False):
        pass
    scripted_device.show(time.monotonic())
    assert halting.begun.acquire(timeout=10)
    time.sleep(1.5 * module.OLDEST)
    halting.go_on.release()
    assert ("Lost", 1) in _told(watched.events(until=lambda found: ("Lost", 1) in _told(found)))


class Slow:
    """A tracker that takes longer than a picture may be old, or not."""

    name = "a slow tracker"

    def __init__(self, tracker):
        self.tracker = tracker
        self.takes = 1.5 * module.OLDEST

    def track(self, picture):
        time.sleep(self.takes)
        return self.tracker.track(picture)

    def close(self):
        self.tracker.close()


@pytest.mark.usefixtures("strict")
def test_where_a_machine_is_always_late_people_are_given_late_and_it_is_said_once(
    watch, scripted_device, scripted_tracker, monkeypatch, caplog
):
    monkeypatch.setattr(module, "SLOW", 3)
    slow = Slow(scripted_tracker)
    watched = watch(scripted_device, slow)
    events = []

    def perform(count):
        """Show picture after picture until so many more were tracked; return when they were shown."""
        shown = []
        for tracked in range(len(scripted_tracker.seen), len(scripted_tracker.seen) + count):
            while len(scripted_tracker.seen) == tracked:
                if not shown or shown[-1] < time.monotonic() - 2 * module.OLDEST:
                    shown.append(time.monotonic())
                    scripted_device.show(shown[-1])
                watched.wait()
                events.extend(watched.source.receive())
        return shown

    def given():
        return [event.time for event in events if isinstance(event, SkeletonFrame)]

    perform(2)
    assert not given()
    shown = perform(6)
    assert len(given()) >= 4
    assert set(given()[1:]) <= set(shown), "at the moments of their pictures"
    assert [event.time for event in events] == sorted({event.time for event in events})
    [said] = caplog.messages
    assert said.startswith("test: finding people takes so long here that they are 0.")
    slow.takes = 0.0
    _wait_until(lambda: perform(1) and not watched.source._slow)
    slow.takes = 1.5 * module.OLDEST
    late = perform(1)
    slow.takes = 0.0
    perform(3)
    assert not set(late) & set(given()), "in time again, it is strict again"
    assert caplog.messages == [said]


def test_ticks_pass_the_time_and_no_event_goes_back(watch, scripted_device, scripted_tracker, monkeypatch):
    """Frames have the times of their pictures, which are earlier than those at which nothing came."""
    monkeypatch.setattr(module, "OLDEST", 0.1)
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
    assert min(ticks) >= TICK_SECONDS - 1e-9


def test_nobody_in_the_picture_lets_time_pass_too(watch, scripted_device, scripted_tracker):
    scripted_tracker.users = ()
    watched = watch(scripted_device, scripted_tracker, recorded=True)
    scripted_device.show(3.0)
    _wait_until(lambda: select([watched.source.fileno()], [], [], 0)[0])
    assert watched.source.receive() == [Tick(3.0)]


def test_of_a_recording_every_picture_is_tracked_at_its_own_time(watch, scripted_device, scripted_tracker):
    end = SourceError("take", found="the end", expected="more", fix="No.")
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
    assert caplog.messages[-1] == "test: the sensor is 1.30 m above the floor, looks 12° down"


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


def test_a_recording_that_stops_before_its_end_is_damaged(watch, scripted_device, scripted_tracker, monkeypatch):
    monkeypatch.setattr(module, "SILENT", 0.2)
    watched = watch(scripted_device, scripted_tracker, recorded=True, fast=True)
    scripted_device.show(0.0)
    watched.events()
    assert watched.error().fix == "It is damaged: record it again."


@pytest.mark.usefixtures("strict")
def test_a_device_that_gives_old_pictures_only_is_given_up(watch, scripted_device, scripted_tracker, monkeypatch):
    monkeypatch.setattr(module, "SILENT", 0.2)
    watched = watch(scripted_device, scripted_tracker)
    _show_until_somebody_comes(watched, scripted_device)

    def read(_timeout):
        time.sleep(0.01)
        return Picture(time.monotonic() - 0.11, LENS, None, None)

    scripted_device.read = read
    assert "no new picture within 0.2 s" in watched.error().found
    assert watched.source.counts.dropped > 1


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
    assert error.found == f"a failure of a scripted {culprit} (OSError: bus reset)"
    assert "doctor" in error.fix
    assert (scripted_device.closed, scripted_tracker.closed) == (1, 1)


def test_closing_closes_the_tracker_and_then_the_device_once(scripted_device, scripted_tracker):
    order = []
    scripted_device.close = lambda: order.append("device")
    scripted_tracker.close = lambda: order.append("tracker")
    source = SensorSource("test:", lambda: scripted_device, lambda _device: scripted_tracker)
    scripted_device.show(0.0)
    assert select([source.fileno()], [], [], 10)[0]
    source.close()
    source.close()
    assert order == ["tracker", "device"]


def test_a_source_that_is_opened_again_and_again_needs_two_threads(watch, scripted_device, scripted_tracker):
    used = set()
    for _ in range(5):
        watched = watch(scripted_device, scripted_tracker)
        scripted_device.show(0.0)
        watched.events()
        threads = {thread.name: thread for thread in threading.enumerate()}
        used |= {threads["test: reader"], threads["test: tracker"]}
        watched.source.close()
    assert len(used) == 2


LEFT = """
import sys, threading, time
from capture.sensors.source import SensorSource

class Device:
    name = "a device"
    read = lambda self, timeout: time.sleep(timeout)
    close = lambda self: print("device", flush=True)

class Tracker:
    name = "a tracker"
    close = lambda self: print("tracker", flush=True)

def opened():
    time.sleep(0.3)
    return Device()

source = SensorSource("test:", opened, lambda _: Tracker())
sys.exit("left")
"""


def test_the_end_of_the_program_closes_what_is_open_or_being_opened():
    result = subprocess.run([sys.executable, "-c", LEFT], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (1, "tracker\ndevice\n", "left\n")
