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
from capture.sensors import clock as device_clock
from capture.sensors import source as module
from capture.sensors.clock import DeviceClock
from capture.sensors.source import SensorSource
from capture.skeleton import SkeletonFrame
from capture.trackers.picture import Picture
from puppetline.errors import SourceError

from ...waiting import wait_until
from ..conftest import LENS
from .rooms import LENS as ROOM_LENS
from .rooms import room


def _told(events):
    return [(type(event).__name__, event.user) for event in events]


class Halting:
    """A tracker that waits with each image until a test lets it continue."""

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


def test_a_performer_in_an_image_is_a_frame_at_the_images_time(watch, scripted_device, scripted_tracker):
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


def test_the_log_names_the_device_and_the_tracker(watch, scripted_device, scripted_tracker, caplog):
    caplog.set_level(logging.INFO, "capture")
    scripted_device.show(0.0)
    watch(scripted_device, scripted_tracker).events()
    assert caplog.messages == ["test: tracking images of a scripted device with a scripted tracker"]


def test_a_device_whose_clock_stands_still_works_and_is_logged_once(
    watch, scripted_device, scripted_tracker, caplog, monkeypatch, clock
):
    monkeypatch.setattr(device_clock, "SPAN_SECONDS", 0.02)
    watched = watch(scripted_device, scripted_tracker)
    said = "test: one second takes 0 s on the clock of a scripted device: using the arrival times of images instead"

    def frames(count):
        found = []
        for _ in range(count):
            before = time.monotonic()
            scripted_device.show(5.0)
            [frame] = watched.events()
            assert before <= frame.time <= time.monotonic()
            found.append(frame)
            clock.advance(0.005)
        return found

    wait_until(lambda: frames(1) and said in caplog.messages)
    assert len(frames(20)) == 20
    assert caplog.messages == [said]


def test_performers_found_and_lost_are_events_in_order(watch, scripted_device, scripted_tracker):
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


def test_the_newest_image_is_tracked_and_the_others_count_as_dropped(watch, scripted_device, scripted_tracker):
    halting = Halting(scripted_tracker)
    watched = watch(scripted_device, halting)
    scripted_device.show(0.0)
    assert halting.begun.acquire(timeout=10)
    scripted_device.show(0.001, 0.002, 0.003)
    wait_until(lambda: watched.source.counts.received == 4)
    for _ in range(2):
        halting.go_on.release()
        watched.events()
    assert scripted_tracker.seen == [0.0, 0.003]
    assert watched.source.counts.dropped == 2


def test_every_tracked_frame_is_received_however_late(watch, scripted_device, scripted_tracker):
    watched = watch(scripted_device, scripted_tracker)
    for k in range(3):
        scripted_device.show(0.001 * k)
        wait_until(lambda k=k: len(scripted_tracker.seen) == k + 1)
    assert all(one.time < other.time for one, other in pairwise(watched.events(3)))
    assert watched.source.counts.dropped == 0


@pytest.fixture
def strict(monkeypatch):
    """Images can be too old, and their age is known: the device uses this computer's clock."""
    monkeypatch.setattr(module, "MAX_AGE_SECONDS", 0.1)

    class Ours(DeviceClock):
        def moment(self, taken, _now):
            return taken

    monkeypatch.setattr(module, "DeviceClock", Ours)


def _show_until_somebody_comes(watched, device):
    """Show fresh images, of which a busy machine may drop some; return the time of the first frame."""
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
def test_a_late_image_is_never_tracked(watch, scripted_device, scripted_tracker):
    watched = watch(scripted_device, scripted_tracker)
    late = time.monotonic() - 1.01 * module.MAX_AGE_SECONDS
    scripted_device.show(late)
    assert _show_until_somebody_comes(watched, scripted_device) > late
    assert late not in scripted_tracker.seen
    assert watched.source.counts.dropped >= 1


@pytest.mark.usefixtures("strict")
def test_an_image_that_waited_too_long_is_never_tracked(watch, scripted_device, scripted_tracker, clock):
    halting = Halting(scripted_tracker)
    watched = watch(scripted_device, halting)
    first = time.monotonic()
    scripted_device.show(first)
    assert halting.begun.acquire(timeout=10)
    waiting = time.monotonic()
    scripted_device.show(waiting)
    clock.advance(2 * module.MAX_AGE_SECONDS)
    halting.go_on.release(1000)
    watched.events()
    assert scripted_tracker.seen == [first]
    assert _show_until_somebody_comes(watched, scripted_device) > waiting
    assert waiting not in scripted_tracker.seen


@pytest.mark.usefixtures("strict")
def test_a_lost_performer_is_reported_however_late(watch, scripted_device, scripted_tracker, clock):
    halting = Halting(scripted_tracker)
    watched = watch(scripted_device, halting)
    halting.go_on.release(1000)
    _show_until_somebody_comes(watched, scripted_device)
    scripted_tracker.users = ()
    wait_until(lambda: not halting.go_on.acquire(blocking=False))
    time.sleep(0.01)
    while halting.begun.acquire(blocking=False):
        pass
    while not halting.begun.acquire(timeout=2 * module.MAX_AGE_SECONDS):  # a busy machine may drop an image
        scripted_device.show(time.monotonic())
    clock.advance(1.5 * module.MAX_AGE_SECONDS)
    halting.go_on.release()
    assert ("Lost", 1) in _told(watched.events(until=lambda found: ("Lost", 1) in _told(found)))


class Slow:
    """A tracker that takes `takes` seconds, at first longer than the maximum age of an image."""

    name = "a slow tracker"

    def __init__(self, tracker, clock):
        self.tracker, self._clock = tracker, clock
        self.takes = 1.5 * module.MAX_AGE_SECONDS

    def track(self, picture):
        self._clock.advance(self.takes)
        return self.tracker.track(picture)

    def close(self):
        self.tracker.close()


@pytest.mark.usefixtures("strict")
def test_ticks_wait_for_late_frames_on_a_slow_machine_which_is_logged_once(
    watch, scripted_device, scripted_tracker, monkeypatch, caplog, clock
):
    monkeypatch.setattr(module, "MAX_LATE_COUNT", 3)
    slow = Slow(scripted_tracker, clock)
    watched = watch(scripted_device, slow)
    events = []

    def perform(count):
        """Show images until `count` more were tracked; return the times at which they were shown."""
        shown = []
        for tracked in range(len(scripted_tracker.seen), len(scripted_tracker.seen) + count):
            while len(scripted_tracker.seen) == tracked:
                if not shown or shown[-1] < time.monotonic() - 2 * module.MAX_AGE_SECONDS:
                    shown.append(time.monotonic())
                    scripted_device.show(shown[-1])
                watched.wait()
                events.extend(watched.source.receive())
        return shown

    def given():
        return [event.time for event in events if isinstance(event, SkeletonFrame)]

    shown = perform(8)
    assert len(given()) >= 4
    assert set(given()[3:]) <= set(shown), "frames have the times of their images, when ticks wait for them"
    assert [event.time for event in events] == sorted({event.time for event in events})
    [said] = caplog.messages
    assert said.startswith("test: tracking is too slow on this machine: performers are 0.")
    slow.takes = 0.0
    wait_until(lambda: perform(1) and not watched.source._slow)
    assert caplog.messages == [said]


def test_ticks_fill_silence_and_no_event_is_before_another(watch, scripted_device, scripted_tracker, monkeypatch):
    """Frames have the times of their images, which are earlier than ticks without a delay would be."""
    monkeypatch.setattr(module, "MAX_AGE_SECONDS", 0.1)
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
    assert np.diff([start - module.MAX_AGE_SECONDS, *times]).max() < 0.15
    ticks = [
        later - earlier
        for (earlier, later), event in zip(pairwise(times), events[1:], strict=True)
        if type(event) is Tick
    ]
    assert min(ticks) >= TICK_SECONDS - 1e-9


def test_an_image_without_performers_is_a_tick(watch, scripted_device, scripted_tracker):
    scripted_tracker.users = ()
    watched = watch(scripted_device, scripted_tracker, recorded=True)
    scripted_device.show(3.0)
    wait_until(lambda: select([watched.source.fileno()], [], [], 0)[0])
    assert watched.source.receive() == [Tick(3.0)]


def test_every_image_of_a_recording_is_tracked_at_its_own_time(watch, scripted_device, scripted_tracker):
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
    assert [frame.time for frame in frames] == scripted_tracker.seen == times
    assert watched.error() is end
    assert (watched.source.counts.received, watched.source.counts.dropped) == (50, 0)


def test_a_depth_sensor_reports_its_tilt_when_the_floor_shows_it(watch, scripted_device, scripted_tracker, caplog):
    caplog.set_level(logging.INFO, "capture")
    depth = room(12, 0, 1.3)
    for k in range(8):
        scripted_device.pictures.put(Picture(0.25 * k, ROOM_LENS, None, depth))
    *before, cue, after = watch(scripted_device, scripted_tracker, recorded=True, fast=True).events(7)
    assert [frame.time for frame in before] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert (cue.time, cue.do, after.time) == (1.0, "level", 1.25)
    assert cue.arguments == pytest.approx({"tilt": 12, "roll": 0, "height": 1.3}, abs=0.1)
    assert caplog.messages[-1] == "test: the sensor is 1.30 m above the floor, looks 12° down"


def test_a_recording_plays_in_real_time_or_fast(watch, scripted_device, scripted_tracker):
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


@pytest.mark.parametrize("recorded", [False, True])
def test_a_device_or_a_recording_that_stops_is_an_error(
    watch, scripted_device, scripted_tracker, monkeypatch, recorded
):
    monkeypatch.setattr(module, "SILENCE_SECONDS", 0.2)
    watched = watch(scripted_device, scripted_tracker, recorded=recorded, fast=recorded)
    scripted_device.show(0.0)
    watched.events()
    error = watched.error()
    assert "no new image for 0.2 s" in error.found
    assert (error.fix == "The recording is damaged: record it again.") == recorded


@pytest.mark.usefixtures("strict")
def test_a_device_with_old_images_only_is_an_error(watch, scripted_device, scripted_tracker, monkeypatch, clock):
    monkeypatch.setattr(module, "SILENCE_SECONDS", 0.2)
    watched = watch(scripted_device, scripted_tracker)
    _show_until_somebody_comes(watched, scripted_device)

    def read(_timeout):
        clock.advance(0.01)
        return Picture(time.monotonic() - 0.11, LENS, None, None)

    scripted_device.read = read
    assert "no new image for 0.2 s" in watched.error().found
    assert watched.source.counts.dropped > 1


def test_a_device_that_never_opens_is_an_error_and_does_not_delay_closing(watch, scripted_tracker, monkeypatch):
    monkeypatch.setattr(module, "OPENING_SECONDS", 0.2)
    monkeypatch.setattr(module, "_CLOSING_SECONDS", 0.1)
    stuck = threading.Event()
    watched = watch(stuck.wait, scripted_tracker)
    assert "no first image for 0.2 s" in watched.error().found
    watched.source.close()
    assert not stuck.is_set()
    stuck.set()


def test_an_error_while_opening_is_raised_and_an_open_device_is_closed(watch, scripted_device, scripted_tracker):
    refusal = SourceError("x", found="no", expected="yes", fix="Plug it in.")

    def refuse(*_):
        raise refusal

    assert watch(refuse, scripted_tracker).error() is refusal
    assert watch(scripted_device, refuse).error() is refusal
    assert (scripted_device.closed, scripted_tracker.closed) == (1, 0)


@pytest.mark.parametrize("culprit", ["device", "tracker"])
def test_any_exception_of_a_driver_is_an_error_that_names_it(watch, scripted_device, scripted_tracker, culprit):
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


def test_closing_closes_the_tracker_then_the_device_once(scripted_device, scripted_tracker):
    order = []
    scripted_device.close = lambda: order.append("device")
    scripted_tracker.close = lambda: order.append("tracker")
    source = SensorSource("test:", lambda: scripted_device, lambda _device: scripted_tracker)
    scripted_device.show(0.0)
    assert select([source.fileno()], [], [], 10)[0]
    source.close()
    source.close()
    assert order == ["tracker", "device"]


def test_sources_that_are_opened_in_turn_use_two_threads(watch, scripted_device, scripted_tracker):
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


def test_the_end_of_the_program_closes_a_device_that_is_being_opened():
    result = subprocess.run([sys.executable, "-c", LEFT], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (1, "tracker\ndevice\n", "left\n")
