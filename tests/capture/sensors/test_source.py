import logging
import math
import subprocess
import sys
import threading
from select import select

import numpy as np
import pytest

from capture.events import TICK_SECONDS, Lost, Tick
from capture.sensors import source as module
from capture.sensors.clock import DeviceClock
from capture.sensors.source import MAX_AGE_SECONDS, OPENING_SECONDS, SILENCE_SECONDS
from capture.skeleton import SkeletonFrame
from capture.source import wait
from capture.trackers.picture import Picture
from puppetline.errors import SourceError

from ...waiting import wait_until
from ..conftest import LENS, ScriptedTracker
from .rooms import LENS as ROOM_LENS
from .rooms import room

pytestmark = pytest.mark.usefixtures("standing")


def _told(events):
    return [(type(event).__name__, event.user) for event in events]


class Halting(ScriptedTracker):
    """Waits with each image until a test lets it continue."""

    def __init__(self):
        super().__init__(1)
        self.begun, self.go_on = threading.Semaphore(0), threading.Semaphore(0)

    def track(self, picture):
        self.begun.release()
        assert self.go_on.acquire()
        return super().track(picture)


@pytest.fixture
def halting():
    return Halting()


def test_a_performer_in_an_image_is_a_frame_at_the_images_time(watch, scripted_device, standing, caplog):
    caplog.set_level(logging.INFO, "capture")
    watched = watch()
    scripted_device.show(5.0)
    [frame] = watched.events()
    assert (type(frame), frame.user, frame.time) == (SkeletonFrame, 1, standing.now())
    assert (frame.positions.dtype, frame.positions.shape) == (np.float64, (20, 3))
    assert (frame.positions == 5.0).all()
    assert (frame.confidence == 1.0).all()
    assert caplog.messages == ["test: tracking images of a scripted device with a scripted tracker"]


def test_a_device_whose_clock_stands_still_works_and_is_logged_once(watch, scripted_device, caplog, standing):
    watched = watch()
    for _ in range(100):
        scripted_device.show(5.0)
        [frame] = watched.events()
        assert frame.time == standing.now()
        standing.advance(0.1)
    assert caplog.messages == [
        "test: one second takes 0 s on the clock of a scripted device: using the arrival times of images instead"
    ]


def test_performers_found_and_lost_are_events_in_order(watch, scripted_device, scripted_tracker):
    watched = watch()
    changes = [
        ((1, 2), [("SkeletonFrame", 1), ("SkeletonFrame", 2)]),
        ((2,), [("Lost", 1), ("SkeletonFrame", 2)]),
        ((), [("Lost", 2)]),
        ((7, 3), [("SkeletonFrame", 7), ("SkeletonFrame", 3)]),
    ]
    for k, (users, told) in enumerate(changes):
        scripted_tracker.users = users
        scripted_device.show(0.01 * k)
        assert _told(watched.events(len(told))) == told


def test_the_newest_image_is_tracked_and_the_others_count_as_dropped_and_every_frame_is_received(
    watch, scripted_device, halting
):
    watched = watch(tracker=halting)
    scripted_device.show(0.0)
    assert halting.begun.acquire()
    scripted_device.show(0.001, 0.002, 0.003)
    wait_until(lambda: watched.source.counts.received == 4)
    halting.go_on.release(2)
    wait_until(lambda: len(halting.seen) == 2)
    first, second = watched.events(2)
    assert first.time < second.time
    assert (halting.seen, watched.source.counts.dropped) == ([0.0, 0.003], 2)


@pytest.fixture
def dated(monkeypatch):
    """The age of images is known: the device uses this computer's clock."""
    monkeypatch.setattr(DeviceClock, "moment", lambda _self, taken, _now: taken)


@pytest.mark.usefixtures("dated")
def test_an_image_that_is_or_becomes_too_old_is_never_tracked(watch, scripted_device, halting, standing):
    watched, start = watch(tracker=halting), standing.now()
    halting.go_on.release(2)
    scripted_device.show(start - 1.01 * MAX_AGE_SECONDS, start)
    assert watched.events()[0].time == start
    assert halting.begun.acquire()
    halting.go_on.acquire()
    scripted_device.show(start + 0.001)
    assert halting.begun.acquire()
    scripted_device.show(start + 0.002)
    wait_until(lambda: watched.source.counts.received == 4)
    standing.advance(2 * MAX_AGE_SECONDS)
    halting.go_on.release(2)
    assert watched.events()[0].time >= start + 0.001
    scripted_device.show(standing.now())
    assert watched.events()[0].time == standing.now()
    assert halting.seen == [start, start + 0.001, standing.now()]
    assert watched.source.counts.dropped >= 1


@pytest.mark.usefixtures("dated")
def test_a_lost_performer_is_reported_however_late(watch, scripted_device, halting, standing):
    watched = watch(tracker=halting)
    halting.go_on.release()
    scripted_device.show(standing.now())
    watched.events()
    halting.users = ()
    standing.advance(0.01)
    scripted_device.show(standing.now())
    for _ in range(2):
        assert halting.begun.acquire()
    standing.advance(1.5 * MAX_AGE_SECONDS)
    halting.go_on.release()
    assert _told(watched.events()) == [("Lost", 1)]


class Slow(ScriptedTracker):
    """Takes `takes` seconds, at first longer than the maximum age of an image."""

    def __init__(self, clock):
        super().__init__(1)
        self._clock, self.takes = clock, 1.5 * MAX_AGE_SECONDS

    def track(self, picture):
        self._clock.advance(self.takes)
        return super().track(picture)


@pytest.mark.usefixtures("dated")
def test_ticks_wait_for_late_frames_on_a_slow_machine_which_is_logged_once(watch, scripted_device, caplog, standing):
    slow = Slow(standing)
    watched, events, shown = watch(tracker=slow), [], []

    def perform():
        """Show an image, and receive until its frame has come."""
        shown.append(standing.now())
        scripted_device.show(shown[-1])
        before = len(given())
        wait_until(
            lambda: wait(watched.source, math.inf) or events.extend(watched.source.receive()) or len(given()) > before
        )

    def given():
        return [event.time for event in events if isinstance(event, SkeletonFrame)]

    for _ in range(2 * module.MAX_LATE_COUNT):
        perform()
    late = module.MAX_LATE_COUNT + 1
    assert given()[late:] == pytest.approx(shown[late:]), (
        "they have the times of their images, when ticks wait for them"
    )
    assert [event.time for event in events] == sorted(event.time for event in events)
    slow.takes = 0.0
    for _ in range(module.MAX_LATE_COUNT):
        assert watched.source._slow
        standing.advance(0.01)
        perform()
    assert not watched.source._slow
    [said] = caplog.messages
    assert said.startswith("test: tracking is too slow on this machine: performers are 0.15 s late")


def test_ticks_fill_silence_and_no_event_is_before_another(watch, scripted_device, standing):
    """Frames have the times of their images, which are earlier than ticks without a delay would be."""
    watched = watch()
    start, events = standing.now(), []
    for k in range(40):
        if k % 10 == 0:
            scripted_device.show(0.015 * k)
            wait_until(lambda: select([watched.source.fileno()], [], [], 0)[0])
        events += watched.source.receive()
        standing.advance(0.015)
    times = np.array([event.time for event in events])
    spaces, is_tick = np.diff(times), np.array([type(event) is Tick for event in events])
    assert (spaces >= 0).all()
    assert times[~is_tick].tolist() == pytest.approx([start + 0.15 * k for k in range(4)])
    assert np.diff([start - MAX_AGE_SECONDS, *times]).max() < 0.15
    assert spaces[is_tick[1:]].min() >= TICK_SECONDS - 1e-9


def test_every_image_of_a_recording_is_tracked_at_its_own_time_and_one_without_performers_is_a_tick(
    watch, scripted_device, scripted_tracker
):
    end = SourceError("take", found="the end", expected="more", fix="No.")
    times = [*(10.0 + 0.001 * k for k in range(50)), 1000.0]
    scripted_device.show(*times)
    watched = watch(recorded=True, fast=True)
    frames = []
    for _ in times:
        assert watched.source.now() == (frames[-1].time if frames else 0.0)
        frames += watched.events()
    assert [frame.time for frame in frames] == scripted_tracker.seen == times
    scripted_tracker.users = ()
    for time in (1001.0, 1002.0):
        scripted_device.show(time)
        wait_until(lambda: select([watched.source.fileno()], [], [], 0)[0])
        assert watched.source.receive() == [Lost(time, 1) if time == 1001 else Tick(time)]
    scripted_device.pictures.put(end)
    assert watched.error() is end
    assert (watched.source.counts.received, watched.source.counts.dropped) == (53, 0)


def test_a_depth_sensor_reports_its_tilt_when_the_floor_shows_it(watch, scripted_device, caplog):
    caplog.set_level(logging.INFO, "capture")
    depth = room(12, 0, 1.3)
    for k in range(8):
        scripted_device.pictures.put(Picture(0.25 * k, ROOM_LENS, None, depth))
    *before, cue, after = watch(recorded=True, fast=True).events(7)
    assert [frame.time for frame in before] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert (cue.time, cue.do, after.time) == (1.0, "level", 1.25)
    assert cue.arguments == pytest.approx({"tilt": 12, "roll": 0, "height": 1.3}, abs=0.1)
    assert caplog.messages[-1] == "test: the sensor is 1.30 m above the floor, looks 12° down"


def test_a_recording_plays_in_real_time(watch, scripted_device, scripted_tracker, standing):
    scripted_device.show(10.0, 10.1, 10.3)
    watched = watch(recorded=True)
    frames = []
    for step, count in ((0.0, 1), (0.11, 1), (0.18, 0), (0.02, 1)):
        standing.advance(step)
        frames.extend(watched.events(count))
        wait_until(lambda: watched.source.counts.received == min(3, len(frames) + 1))
        assert [frame.time for frame in frames] == scripted_tracker.seen
    assert scripted_tracker.seen == [10.0, 10.1, 10.3]


@pytest.mark.parametrize("recorded", [False, True])
def test_a_device_or_a_recording_that_stops_is_an_error(watch, scripted_device, standing, recorded):
    watched = watch(recorded=recorded, fast=recorded)
    scripted_device.show(0.0)
    watched.events()
    standing.advance(SILENCE_SECONDS)
    assert (watched.error().fix == "The recording is damaged: record it again.") == recorded


@pytest.mark.usefixtures("dated")
def test_a_device_with_old_images_only_is_an_error(watch, scripted_device, standing):
    watched = watch()
    scripted_device.show(standing.now())
    watched.events()

    def read(_timeout):
        standing.advance(0.01)
        return Picture(standing.now() - 1.1 * MAX_AGE_SECONDS, LENS, None, None)

    scripted_device.read = read
    assert "no new image" in watched.error().found
    assert watched.source.counts.dropped > 1


def test_a_device_that_never_opens_is_an_error_and_does_not_delay_closing(watch, monkeypatch, standing):
    monkeypatch.setattr(module, "_CLOSING_SECONDS", 0.1)
    stuck = threading.Event()
    watched = watch(stuck.wait)
    standing.advance(OPENING_SECONDS)
    assert "no first image" in watched.error().found
    watched.source.close()
    assert not stuck.is_set()
    stuck.set()


@pytest.mark.parametrize("recorded", [False, True])
def test_a_tracker_may_take_any_time_to_open(watch, scripted_device, scripted_tracker, standing, recorded):
    begun, ready = threading.Event(), threading.Event()

    def open_tracker(_device):
        begun.set()
        assert ready.wait(60)
        return scripted_tracker

    watched = watch(tracker=open_tracker, recorded=recorded)
    assert begun.wait(60)
    standing.advance(10 * OPENING_SECONDS)
    assert all(isinstance(event, Tick) for event in watched.source.receive())
    ready.set()
    scripted_device.show(1.0)
    wait_until(lambda: scripted_tracker.seen == [1.0])


def test_an_error_while_opening_is_raised_and_an_open_device_is_closed(watch, scripted_device, scripted_tracker):
    refusal = SourceError("x", found="no", expected="yes", fix="Plug it in.")

    def refuse(*_):
        raise refusal

    assert watch(refuse).error() is refusal
    assert watch(tracker=refuse).error() is refusal
    assert (scripted_device.closed, scripted_tracker.closed) == (1, 0)


@pytest.mark.parametrize("culprit", ["device", "tracker"])
def test_any_exception_of_a_driver_is_an_error_that_names_it(watch, scripted_device, scripted_tracker, culprit):
    watched = watch()
    scripted_device.show(0.0)
    watched.events()
    if culprit == "device":
        scripted_device.pictures.put(OSError("bus reset"))
    else:
        scripted_tracker.users = OSError("bus reset")
        scripted_device.show(0.01)
    error = watched.error()
    assert type(error) is SourceError
    assert error.found == f"a failure of a scripted {culprit} (OSError: bus reset)"
    assert (scripted_device.closed, scripted_tracker.closed) == (1, 1)


def test_closing_closes_the_tracker_then_the_device_once_and_the_next_source_uses_the_same_threads(
    watch, scripted_device, scripted_tracker
):
    used, order = set(), []
    scripted_device.close = lambda: order.append("device")
    scripted_tracker.close = lambda: order.append("tracker")
    for _ in range(5):
        watched = watch()
        scripted_device.show(0.0)
        watched.events()
        threads = {thread.name: thread for thread in threading.enumerate()}
        used |= {threads["test: reader"], threads["test: tracker"]}
        for _ in range(2):
            watched.source.close()
        wait_until(watched.source._done.is_set)
    assert order == 5 * ["tracker", "device"]
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
