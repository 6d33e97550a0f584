import os
import tracemalloc
from importlib.metadata import version

import numpy as np
import pytest

from engine_bridge.service.monitoring import statistics
from engine_bridge.service.monitoring.statistics import WINDOW_FRAMES, WINDOW_SECONDS, Statistics
from engine_bridge.service.monitoring.status import LatencyStatus


class Clock:
    def __init__(self):
        self.seconds = 1000.0

    def monotonic(self):
        return self.seconds

    def monotonic_ns(self):
        return round(self.seconds * 1e9)

    def process_time(self):
        return self.seconds / 4


@pytest.fixture
def own_clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(statistics, "time", clock)
    return clock


def test_rates_counts_and_latencies_are_those_of_what_was_counted(own_clock):
    collected = Statistics()
    latencies = np.random.default_rng(0).permutation(np.arange(1, 301)) / 10  # milliseconds
    for latency in latencies:
        collected.taken("kinect")
        collected.performed("kinect", "dog", own_clock.monotonic_ns() - round(latency * 1e6))
        own_clock.seconds += 1 / 30
    service = collected.service()
    assert (service.version, service.pid) == (version("puppetline"), os.getpid())
    assert service.uptime == pytest.approx(10)
    assert service.cpu == pytest.approx(0.25)
    assert 1e6 < service.memory < 1e11
    frames, rate, latency = collected.stage("kinect")
    np.testing.assert_allclose(
        [latency.p50, latency.p95, latency.p99, latency.max], np.percentile(latencies, (50, 95, 99, 100)), rtol=1e-3
    )
    assert (frames, rate) == (300, pytest.approx(30, rel=0.01))
    assert collected.character("dog") == (300, pytest.approx(30, rel=0.01))


def test_rates_and_latencies_are_of_the_last_seconds_and_counts_of_all_time(own_clock):
    collected = Statistics()
    for second in range(60):
        for _ in range(60 if second < 30 else 15):
            latency = 1e9 if second < 30 else 1e6
            collected.performed("kinect", "dog", own_clock.monotonic_ns() - round(latency))
            own_clock.seconds += 1 / 60 if second < 30 else 1 / 15
    assert collected.character("dog") == (30 * 60 + 30 * 15, pytest.approx(15, rel=0.01))
    assert collected.stage("kinect")[2].max == pytest.approx(1)
    own_clock.seconds += 2 * WINDOW_SECONDS
    assert collected.character("dog")[1] == 0
    assert collected.stage("kinect")[2] == LatencyStatus(None, None, None, None)


def test_a_service_that_has_just_started_has_the_rate_of_its_first_seconds(own_clock):
    collected = Statistics()
    for _ in range(60):
        collected.taken("kinect")
        own_clock.seconds += 1 / 30
    assert collected.stage("kinect")[1] == pytest.approx(30, rel=0.01)


def test_rates_hold_where_the_window_is_full(own_clock):
    collected = Statistics()
    for _ in range(3 * WINDOW_FRAMES):
        collected.taken("kinect")
        own_clock.seconds += 1 / 10_000
    assert collected.stage("kinect")[:2] == (3 * WINDOW_FRAMES, pytest.approx(10_000, rel=0.01))


def test_statistics_of_names_that_are_not_kept_are_forgotten(own_clock):
    collected = Statistics()
    for name in ("dog", "cat"):
        collected.taken(name)
        collected.performed(name, name, 0)
    collected.keep({"dog"}, {"dog"})
    assert [collected.character(name)[0] for name in ("dog", "cat")] == [1, 0]
    assert [collected.stage(name)[0] for name in ("dog", "cat")] == [1, 0]
    assert collected.stage("cat")[2] == LatencyStatus()


def test_memory_stays_flat_however_long_it_runs(own_clock):
    collected = Statistics()

    def run(frames):
        for _ in range(frames):
            collected.taken("kinect")
            collected.performed("kinect", "dog", own_clock.monotonic_ns())
            own_clock.seconds += 1 / 3000

    run(50_000)
    tracemalloc.start()
    run(100_000)
    grown, _ = tracemalloc.get_traced_memory()
    run(100_000)
    later, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert later <= grown + 20_000


def test_the_share_of_a_core_is_that_since_the_last_call(own_clock, monkeypatch):
    used = 5.0
    monkeypatch.setattr(own_clock, "process_time", lambda: used)
    collected = Statistics()
    own_clock.seconds, used = own_clock.seconds + 0.2, used + 0.15
    assert collected.service().cpu == pytest.approx(0.75)
    own_clock.seconds += 0.2
    assert collected.service().cpu == 0.0
