import os
import time
from importlib.metadata import version
from types import SimpleNamespace

import numpy as np
import pytest

from capture.source import Counts
from engine_bridge.service import status_report
from engine_bridge.service.monitoring.status import ClientsStatus, LatencyStatus
from engine_bridge.service.status_report import WINDOW_SECONDS, Reporter
from puppetline import clock

CLIENTS = ClientsStatus(connected=1, refused=0, limit=64)


@pytest.fixture
def runner(make_stage):
    """A stage of which nobody has been seen."""
    source = SimpleNamespace(name="osc:7110", counts=Counts(), now=clock.now)
    return SimpleNamespace(stage=make_stage(), source=source, faults=0, recording=None)


@pytest.fixture
def own_clock(given_clock, monkeypatch):
    """The given clock, of a process that uses a quarter of a core for ten seconds, and then nothing."""
    end = given_clock.now() + 10
    monkeypatch.setattr(time, "process_time", lambda: min(given_clock.now(), end) / 4)
    return given_clock


def sent_by(name, received):
    """A frame of a character, of which the reporter reads no more."""
    return SimpleNamespace(character=SimpleNamespace(name=name), received=round(received))


def figures(reporter, *runners):
    """The status of the service, the first stage and its first character."""
    status = reporter.status(runners, CLIENTS, [])
    return status.service, status.stages[0], status.characters[0]


def test_counts_are_of_all_time_and_rates_and_latencies_of_the_last_seconds(own_clock, runner):
    reporter = Reporter()
    latencies = np.random.default_rng(0).permutation(np.arange(1, 301)) / 10  # milliseconds
    for number, latency in enumerate(latencies):
        if number == 60:  # two seconds, of those ten that rates are of
            assert figures(reporter, runner)[1].rate == pytest.approx(30, rel=0.01)
        reporter.received("stage", 1)
        reporter.sent("stage", sent_by("dog", clock.now_ns() - latency * 1e6))
        own_clock.advance(1 / 30)
    service, stage, dog = figures(reporter, runner)
    assert service.version == version("puppetline")
    assert service.pid == os.getpid()
    assert service.uptime == pytest.approx(10)
    assert service.cpu == pytest.approx(0.25)
    assert 1e6 < service.memory < 1e11
    latency = stage.latency_ms
    np.testing.assert_allclose(
        [latency.p50, latency.p95, latency.p99, latency.max], np.percentile(latencies, (50, 95, 99, 100)), rtol=1e-3
    )
    assert stage.frames == 300
    assert stage.rate == pytest.approx(30, rel=0.01)
    assert dog.frames == 300
    assert dog.rate == pytest.approx(30, rel=0.01)
    for _ in range(165):
        reporter.sent("stage", sent_by("dog", clock.now_ns() - 5e4))
        own_clock.advance(1 / 15)
    service, stage, dog = figures(reporter, runner)
    assert service.cpu == pytest.approx(0)
    assert dog.frames == 465
    assert dog.rate == pytest.approx(15, rel=0.01)
    assert stage.latency_ms.max == pytest.approx(0.05)
    own_clock.advance(2 * WINDOW_SECONDS)
    _, stage, dog = figures(reporter, runner)
    assert dog.rate == 0
    assert stage.latency_ms == LatencyStatus(None, None, None, None)


def test_rates_hold_and_memory_stays_flat_where_the_window_is_full(own_clock, runner, monkeypatch):
    monkeypatch.setattr(status_report, "WINDOW_FRAMES", 1000)
    reporter = Reporter()
    for _ in range(3000):
        reporter.received("stage", 1)
        own_clock.advance(1 / 500)
    stage = figures(reporter, runner)[1]
    assert stage.frames == 3000
    assert stage.rate == pytest.approx(500, rel=0.01)
    assert len(reporter._received["stage"]._moments) == 1000


def test_figures_of_what_has_been_removed_are_forgotten(own_clock, runner):
    reporter = Reporter()
    reporter.received("stage", 1)
    reporter.sent("stage", sent_by("dog", 0))
    assert figures(reporter, runner)[1].frames == 1
    assert reporter.status([], CLIENTS, []).stages == []
    _, stage, dog = figures(reporter, runner)
    assert stage.frames == 0
    assert stage.latency_ms == LatencyStatus()
    assert dog.frames == 0
