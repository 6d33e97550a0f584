import json
import os
import time
import tracemalloc
from importlib.metadata import version

import numpy as np
import pytest

from engine_bridge.service.monitoring import statistics
from engine_bridge.service.monitoring.statistics import CAPACITY, WINDOW, Statistics

STAGE = {"name": "kinect", "source": "osc:7110", "dropped": 2, "refused": {"short": 3}, "users": [], "recording": None}
DOG = {"name": "dog", "performer": 1, "state": "performing", "residual": 0.25, "limited": 0}
CLIENTS = {"connected": 1, "refused": 0, "limit": 64}
SENT = {"messages": 10, "bytes": 4000}
OSC = [{"target": "127.0.0.1:9000", "sent": 1, "skipped": 0, "failed": 0}]


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
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(statistics, "time", clock)
    return clock


def snapshot(collected, stages=(STAGE,), characters=(DOG,)):
    return collected.snapshot(stages, characters, CLIENTS, SENT, OSC)


def test_the_status_is_what_is_given_with_the_figures_that_were_collected(clock):
    collected = Statistics()
    latencies = np.random.default_rng(0).permutation(np.arange(1, 301)) / 10  # milliseconds
    for latency in latencies:
        collected.taken("kinect")
        collected.performed("kinect", "dog", clock.monotonic_ns() - round(latency * 1e6))
        clock.seconds += 1 / 30
    status = snapshot(collected)
    assert json.loads(json.dumps(status)) == status
    service = status.pop("service")
    assert (service["version"], service["pid"]) == (version("puppetline"), os.getpid())
    assert service["uptime"] == pytest.approx(10)
    assert service["cpu"] == pytest.approx(0.25)
    assert 1e6 < service["memory"] < 1e11
    stage = status["stages"][0]
    figures = stage.pop("latency_ms")
    assert list(figures) == ["p50", "p95", "p99", "max"]
    np.testing.assert_allclose(list(figures.values()), np.percentile(latencies, (50, 95, 99, 100)), rtol=1e-3)
    assert stage.pop("rate") == pytest.approx(30, rel=0.01)
    assert stage == STAGE | {"frames": 300}
    dog = status["characters"][0]
    assert dog.pop("rate") == pytest.approx(30, rel=0.01)
    assert dog == DOG | {"frames": 300}
    assert (status["clients"], status["sent"], status["osc"]) == (CLIENTS, SENT, OSC)


def test_rates_and_latencies_are_of_the_last_seconds_and_counts_of_all_time(clock):
    collected = Statistics()
    for second in range(60):
        for _ in range(60 if second < 30 else 15):
            latency = 1e9 if second < 30 else 1e6
            collected.performed("kinect", "dog", clock.monotonic_ns() - round(latency))
            clock.seconds += 1 / 60 if second < 30 else 1 / 15
    status = snapshot(collected)
    assert status["characters"][0]["rate"] == pytest.approx(15, rel=0.01)
    assert status["characters"][0]["frames"] == 30 * 60 + 30 * 15
    assert status["stages"][0]["latency_ms"]["max"] == pytest.approx(1)
    clock.seconds += 2 * WINDOW
    status = snapshot(collected)
    assert status["characters"][0]["rate"] == 0
    assert status["stages"][0]["latency_ms"] == {"p50": None, "p95": None, "p99": None, "max": None}


def test_a_service_that_has_just_started_has_the_rate_of_its_first_seconds(clock):
    collected = Statistics()
    for _ in range(60):
        collected.taken("kinect")
        clock.seconds += 1 / 30
    assert snapshot(collected)["stages"][0]["rate"] == pytest.approx(30, rel=0.01)


def test_rates_hold_where_the_window_is_full(clock):
    collected = Statistics()
    for _ in range(3 * CAPACITY):
        collected.taken("kinect")
        clock.seconds += 1 / 10_000
    status = snapshot(collected)
    assert status["stages"][0]["rate"] == pytest.approx(10_000, rel=0.01)
    assert status["stages"][0]["frames"] == 3 * CAPACITY


def test_what_is_not_named_any_more_is_forgotten(clock):
    collected = Statistics()
    for name in ("dog", "cat"):
        collected.performed("kinect", name, 0)
    status = snapshot(collected, characters=(DOG,))
    assert [each["frames"] for each in status["characters"]] == [1]
    assert [each["frames"] for each in snapshot(collected, characters=(DOG | {"name": "cat"},))["characters"]] == [0]


def test_memory_stays_flat_however_long_it_runs(clock):
    collected = Statistics()

    def run(frames):
        for _ in range(frames):
            collected.taken("kinect")
            collected.performed("kinect", "dog", clock.monotonic_ns())
            clock.seconds += 1 / 3000

    run(50_000)
    tracemalloc.start()
    run(100_000)
    grown, _ = tracemalloc.get_traced_memory()
    run(100_000)
    later, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert later <= grown + 20_000


def test_the_share_of_a_core_is_that_since_the_last_snapshot():
    collected = Statistics()
    until = time.process_time() + 0.1
    while time.process_time() < until:
        pass
    busy = snapshot(collected)["service"]["cpu"]
    time.sleep(0.2)
    assert snapshot(collected)["service"]["cpu"] < busy <= 1.1
