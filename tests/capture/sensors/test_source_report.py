import math
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from capture.events import Cue, Lost, Tick
from capture.network.osc import encode
from capture.network.source import open_osc
from capture.reconnecting import RETRY_SECONDS, ReopeningSource
from capture.sensor_tilt import SensorTilt
from capture.sensors.diagnosis import STATUS_SECONDS, Problem, describe, diagnose
from capture.sensors.source import SensorSource
from capture.sensors.source_report import SourceMonitor, observe
from capture.source import Counts
from capture.sources.replay import RecordingSource
from puppetline import clock
from puppetline.errors import SourceError

from ...waiting import wait_until
from ..network.conftest import Wire
from .reports import WALK, frame, report_of

pytestmark = pytest.mark.usefixtures("given_clock")

NO_KINECT = SourceError("freenect:", found="no Kinect v1 on USB", expected="one", fix="Plug it in.")


def problems(report):
    return [problem.what for problem in diagnose(report)]


def short_take():
    """Return a source of three frames."""
    arrays = {name: getattr(WALK, name)[:3] for name in ("times", "positions")}
    clip = replace(WALK, **arrays, confidence=np.ones((3, 20), np.float32), user=1)
    return RecordingSource.of_clips("replay:short.log", [clip])


@pytest.fixture
def wire(until_end):
    return until_end(Wire(open_osc("127.0.0.1:0")))


def test_the_report_has_the_performers_in_view_and_those_who_have_left():
    report = report_of([frame(0, 2), frame(0, 1), Lost(0.1, 2), frame(5, 2), Lost(0.2, 1), Lost(0.2, 9), Tick(0.3)])
    assert (set(report.performers), report.gone) == ({2}, {1})
    assert report.performers[2].rate is None
    lost = replace(frame(0), positions=np.full((20, 3), np.nan))
    assert report_of([lost]).performers == {}


def test_without_data_observing_ends_and_packets_that_are_not_understood_are_counted(wire):
    assert problems(observe(wire.source, 1, start_seconds=0.1)) == ["No packet received for 0 s."]
    wire.send(b"nonsense")
    report = observe(wire.source, 0.1)
    assert (report.received, sum(report.refused.values()), report.listens) == (1, 1, True)
    assert problems(report)[0].startswith("Packets arrived, but none were understood: ")


def test_a_performer_without_new_frames_has_left(wire):
    wire.send(*(encode("/joint", name, 7, 0.5, 0.5, 1.0) for name in ("head", "neck", "torso")))
    report = observe(wire.source, 2.0)
    assert (set(report.performers), report.gone) == (set(), {7})


@pytest.mark.usefixtures("standing")
def test_the_last_image_of_a_sensor_is_kept_with_its_performers(watch, scripted_device):
    monitor = SourceMonitor(watch().source)
    for moment in (0.0, 0.1):
        scripted_device.show(moment, color=np.full((3, 4, 3), 5, np.uint8))
        until(monitor, lambda report, moment=moment: report.picture and report.picture.time == moment)
    report = until(monitor, lambda report: report.performers)
    assert (report.picture.time, set(report.performers), report.listens) == (0.1, {1}, False)
    assert "The image is black." in problems(report)


def until(monitor, condition):
    """Receive until a report satisfies a condition, and return it."""
    wait_until(lambda: monitor.receive(clock.now() + 0.05) or condition(monitor.report()))
    return monitor.report()


class Played:
    """A source whose monitor, which remembers two seconds, is told what it has received."""

    name = "played:"
    recorded = False

    def __init__(self):
        self.counts, self.time = Counts(), 0.0
        self.monitor = SourceMonitor(self, 2.0)

    def play(self, *events, refused=()):
        self.time = max(self.time, *(event.time for event in events))
        self.counts.received += len(events) + len(refused)
        self.counts.refused.update(refused)
        self.monitor.remember(events)
        return self.monitor.report()

    def fileno(self):
        return None

    def now(self):
        return self.time


def test_only_frames_of_the_period_count():
    source = Played()
    for number in range(60):
        report = source.play(frame(number))
    assert describe(report.performers[1]).endswith("30 frames per second")
    for _ in range(20):
        report = source.play(replace(frame(0), time=source.time + 1 / 8))
    slow = "User 1: only 8 frames per second arrive."
    assert problems(report) == ["User 1 does not move: 17 frames have exactly the same pose.", slow]
    assert problems(source.play(replace(frame(5), time=source.time + 1 / 8))) == [slow]


def test_what_happened_before_the_period_is_forgotten_except_the_sensors_tilt():
    source = Played()
    report = source.play(frame(0), Lost(0.1, 1), refused=["not OSC"])
    assert (report.gone, report.refused, report.sensor_tilt) == ({1}, {"not OSC": 1}, None)
    source.play(Cue(0.0, "level", {"tilt": 12.2, "roll": -2.6, "height": 1.304}))
    source.play(Cue(1.0, "level", {"tilt": "steep"}))  # is damaged
    report = source.play(Tick(9.0))
    assert (report.gone, report.refused, report.received) == (set(), {}, 1)
    assert report.sensor_tilt == SensorTilt(12.2, 1.304, -2.6)


def test_silence_is_counted_from_the_last_data(wire):
    monitor = SourceMonitor(wire.source, 0.1)
    wire.send(b"nonsense")
    until(monitor, lambda report: report.received)
    report = until(monitor, lambda report: not report.received)
    assert 0.1 < report.silent < 0.2
    assert problems(report) == ["No packet received for 0 s."]


def test_a_failure_of_a_sensor_is_reported_until_an_image_arrives(watch, scripted_device, scripted_tracker, standing):
    source = ReopeningSource("freenect:", lambda: watch().source)
    monitor = SourceMonitor(source, STATUS_SECONDS)
    scripted_device.show(0.0)
    assert until(monitor, lambda report: report.performers).picture is not None
    standing.advance(0.01)
    scripted_device.pictures.put(NO_KINECT)
    report = until(monitor, lambda report: report.failure)
    assert (report.performers, report.picture, monitor.ended) == ({}, None, False)
    assert diagnose(report)[0] == Problem(str(NO_KINECT), "The source is opened again twice per second.")
    for _ in range(2):  # until what happened before is forgotten
        standing.advance(RETRY_SECONDS)
        monitor.receive(math.inf)
    assert isinstance(source.inner, SensorSource)
    assert monitor.report().failure == str(NO_KINECT)  # it is open, but no image has arrived
    scripted_tracker.users = ()
    scripted_device.show(1.0)
    report = until(monitor, lambda report: report.picture and not report.failure)
    assert (report.performers, report.picture.time) == ({}, 1.0)


@pytest.mark.parametrize("reopened", [True, False])
def test_the_monitor_of_a_recording_ends_with_it(reopened):
    take = short_take()
    with closing(ReopeningSource(take.name, lambda: take) if reopened else take) as source:
        monitor = SourceMonitor(source)
        assert (monitor.started, monitor.ended) == (False, False)
        report = until(monitor, lambda _: monitor.ended)
        assert (monitor.started, report.retried, report.performers[1].frames) == (True, False, 3)
        assert problems(report) == [report.failure]
