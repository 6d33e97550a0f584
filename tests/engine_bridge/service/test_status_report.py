import os
import time
import tracemalloc
from dataclasses import asdict
from importlib.metadata import version
from types import SimpleNamespace

import numpy as np
import pytest

from capture.sensor_tilt import SensorTilt
from capture.source import Counts
from engine_bridge.service import status_report
from engine_bridge.service.monitoring.status import ClientsStatus, LatencyStatus, OutputStatus
from engine_bridge.service.players.character_player import PlayerSettings
from engine_bridge.service.status_report import WINDOW_SECONDS, Reporter
from puppetline import clock

CLIENTS = ClientsStatus(connected=1, refused=0, limit=64)
OUTPUTS = [OutputStatus("osc", "127.0.0.1:9000", sent=1, bytes=100, skipped=0, failed=0)]


@pytest.fixture
def runner(make_stage):
    """A runner whose source is at a time that the test sets."""
    stage = make_stage(("dog", "cat"), PlayerSettings(calibrate="command"))
    source = SimpleNamespace(name="osc:7110", counts=Counts(dropped=2, refused={"short": 3}), clock=0.0)
    source.now = lambda: source.clock
    return SimpleNamespace(stage=stage, source=source, faults=1, recording="evening")


def test_the_status_is_put_together_from_the_stage_the_counts_and_what_is_given(runner, kung_fu, moved):
    reporter = Reporter()
    for frame in kung_fu[:30]:
        for shown in runner.stage.step(moved(frame, user=5), 0):
            reporter.sent("stage", shown)
    reporter.received("stage", 30)
    runner.source.clock = kung_fu[29].time + 0.25
    status = reporter.status([runner], CLIENTS, OUTPUTS)
    (stage,) = status.stages
    assert (stage.name, stage.source, stage.frames, stage.dropped) == ("stage", "osc:7110", 30, 2)
    assert (stage.refused, stage.faults, stage.recording) == ({"short": 3}, 1, "evening")
    (user,) = stage.users
    assert (user.user, user.state, user.character, user.seen) == (5, "calibrating", "dog", 0.25)
    assert (user.height, user.reach) == (None, None)
    assert user.distance == pytest.approx(np.hypot(*np.median(kung_fu[0].positions[:, ::2], axis=0)), abs=0.2)
    assert asdict(stage.sensor) == asdict(SensorTilt())
    assert stage.latency_ms != LatencyStatus()
    assert [(each.name, each.performer, each.state, each.frames) for each in status.characters] == [
        ("dog", 5, "calibrating", 30),
        ("cat", None, "waiting", status.characters[1].frames),
    ]
    assert (status.clients, status.outputs, status.performing) == (CLIENTS, OUTPUTS, 0)


def test_a_calibrated_performer_has_a_height_and_a_reach(runner, kung_fu):
    for frame in kung_fu[:30]:
        runner.stage.step(frame, 0)
    player = runner.stage.players[0]
    assert player.calibrate(kung_fu[29].time)
    player.begin(kung_fu[29].time)
    status = Reporter().status([runner], CLIENTS, OUTPUTS)
    (user,) = status.stages[0].users
    assert (user.state, user.height, user.reach) == (
        "performing",
        round(player.calibration.height, 2),
        round(player.calibration.reach, 2),
    )
    assert status.performing == 1


@pytest.fixture
def own_clock(given_clock, monkeypatch):
    """The given clock, of a process that uses a quarter of a core."""
    monkeypatch.setattr(time, "process_time", lambda: given_clock.now() / 4)
    return given_clock


def sent_by(name, received):
    """A frame of a character, of which the reporter reads no more."""
    return SimpleNamespace(character=SimpleNamespace(name=name), received=round(received))


def figures(reporter, *runners):
    """The status of the service, the first stage and its first character."""
    status = reporter.status(runners, CLIENTS, OUTPUTS)
    return status.service, status.stages[0], status.characters[0]


def test_rates_counts_and_latencies_are_those_of_what_was_counted(own_clock, runner):
    reporter = Reporter()
    latencies = np.random.default_rng(0).permutation(np.arange(1, 301)) / 10  # milliseconds
    for latency in latencies:
        reporter.received("stage", 1)
        reporter.sent("stage", sent_by("dog", clock.now_ns() - latency * 1e6))
        own_clock.advance(1 / 30)
    service, stage, dog = figures(reporter, runner)
    assert (service.version, service.pid) == (version("puppetline"), os.getpid())
    assert service.uptime == pytest.approx(10)
    assert service.cpu == pytest.approx(0.25)
    assert 1e6 < service.memory < 1e11
    latency = stage.latency_ms
    np.testing.assert_allclose(
        [latency.p50, latency.p95, latency.p99, latency.max], np.percentile(latencies, (50, 95, 99, 100)), rtol=1e-3
    )
    assert (stage.frames, stage.rate) == (300, pytest.approx(30, rel=0.01))
    assert (dog.frames, dog.rate) == (300, pytest.approx(30, rel=0.01))


def test_rates_and_latencies_are_of_the_last_seconds_and_counts_of_all_time(own_clock, runner):
    reporter = Reporter()
    for second in range(60):
        for _ in range(60 if second < 30 else 15):
            latency = 1e9 if second < 30 else 1e6
            reporter.sent("stage", sent_by("dog", clock.now_ns() - latency))
            own_clock.advance(1 / 60 if second < 30 else 1 / 15)
    _, stage, dog = figures(reporter, runner)
    assert (dog.frames, dog.rate) == (30 * 60 + 30 * 15, pytest.approx(15, rel=0.01))
    assert stage.latency_ms.max == pytest.approx(1)
    own_clock.advance(2 * WINDOW_SECONDS)
    _, stage, dog = figures(reporter, runner)
    assert dog.rate == 0
    assert stage.latency_ms == LatencyStatus(None, None, None, None)


def test_a_service_that_has_just_started_has_the_rate_of_its_first_seconds(own_clock, runner):
    reporter = Reporter()
    for _ in range(60):
        reporter.received("stage", 1)
        own_clock.advance(1 / 30)
    assert figures(reporter, runner)[1].rate == pytest.approx(30, rel=0.01)


@pytest.fixture
def few(monkeypatch):
    """A smaller number of frames in a window."""
    monkeypatch.setattr(status_report, "WINDOW_FRAMES", 1000)
    return 1000


def test_rates_hold_where_the_window_is_full(own_clock, runner, few):
    reporter = Reporter()
    for _ in range(3 * few):
        reporter.received("stage", 1)
        own_clock.advance(1 / 500)
    stage = figures(reporter, runner)[1]
    assert (stage.frames, stage.rate) == (3 * few, pytest.approx(500, rel=0.01))


def test_figures_of_what_has_been_removed_are_forgotten(own_clock, runner):
    reporter = Reporter()
    reporter.received("stage", 1)
    reporter.sent("stage", sent_by("dog", 0))
    assert figures(reporter, runner)[1].frames == 1
    assert reporter.status([], CLIENTS, OUTPUTS).stages == []
    _, stage, dog = figures(reporter, runner)
    assert (stage.frames, stage.latency_ms, dog.frames) == (0, LatencyStatus(), 0)


def test_memory_stays_flat_however_long_it_runs(own_clock, few):
    reporter = Reporter()

    def run(frames):
        for _ in range(frames):
            reporter.received("stage", 1)
            reporter.sent("stage", sent_by("dog", clock.now_ns()))
            own_clock.advance(1 / 300)

    run(2 * few)
    tracemalloc.start()
    run(2 * few)
    grown, _ = tracemalloc.get_traced_memory()
    run(2 * few)
    later, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert later <= grown + 20_000


def test_the_share_of_a_core_is_that_since_the_last_call(given_clock, monkeypatch):
    used = 5.0
    monkeypatch.setattr(time, "process_time", lambda: used)
    reporter = Reporter()
    given_clock.advance(0.2)
    used += 0.15
    assert reporter.status([], CLIENTS, OUTPUTS).service.cpu == pytest.approx(0.75)
    given_clock.advance(0.2)
    assert reporter.status([], CLIENTS, OUTPUTS).service.cpu == 0.0
