"""Rates and latencies of the last seconds, collected while the service runs."""

import os
import time
from collections import defaultdict, deque
from collections.abc import Collection
from importlib.metadata import version

import numpy as np
import psutil

from engine_bridge.service.monitoring.status import LatencyStatus, ServiceStatus

WINDOW_SECONDS = 10.0
"""Length of the time that rates and latencies cover, in seconds."""

WINDOW_FRAMES = 16_384
"""Maximum number of frames in a window: ten seconds at 1600 frames per second."""


class Statistics:
    """Counts skeletons and frames; one thread calls it."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._version = version("puppetline")
        self._started = time.monotonic()
        self._taken, self._latencies, self._performed = (defaultdict[str, _Window](_Window) for _ in range(3))
        self._cpu = (self._started, time.process_time())

    def taken(self, stage: str) -> None:
        """Count a skeleton that a stage has received."""
        self._taken[stage].add(time.monotonic())

    def performed(self, stage: str, character: str, received: int) -> None:
        """Count a character's frame that has just been sent.

        Parameters
        ----------
        stage, character : str
            Names.
        received : int
            `time.monotonic_ns` at which the skeleton that moved it arrived.
        """
        now = time.monotonic_ns()
        self._latencies[stage].add(now * 1e-9, (now - received) * 1e-6)
        self._performed[character].add(now * 1e-9)

    def service(self) -> ServiceStatus:
        """Return the state of the process; the share of the processor is measured since the previous call."""
        now = time.monotonic()
        return ServiceStatus(
            version=self._version,
            uptime=now - self._started,
            pid=os.getpid(),
            memory=self._process.memory_info().rss,
            cpu=self._cpu_share(now),
        )

    def stage(self, name: str) -> tuple[int, float, LatencyStatus]:
        """Return the number of skeletons of a stage, their rate per second, and its latency."""
        now = time.monotonic()
        return *self._taken[name].count_and_rate(now), self._latencies[name].percentiles(now)

    def character(self, name: str) -> tuple[int, float]:
        """Return the number of frames of a character and their rate per second."""
        return self._performed[name].count_and_rate(time.monotonic())

    def keep(self, stages: Collection[str], characters: Collection[str]) -> None:
        """Forget all stages and characters but these."""
        for windows, named in ((self._taken, stages), (self._latencies, stages), (self._performed, characters)):
            for name in windows.keys() - set(named):
                del windows[name]

    def _cpu_share(self, now: float) -> float:
        """Return the share of one core since the previous call."""
        used = time.process_time()
        (then, used_then), self._cpu = self._cpu, (now, used)
        return (used - used_then) / max(now - then, 1e-3)


class _Window:
    """Times of events in the last `WINDOW_SECONDS`, each with a value, and the number of all events so far."""

    def __init__(self) -> None:
        self._since = time.monotonic()
        self._count = 0
        self._moments: deque[tuple[float, float]] = deque(maxlen=WINDOW_FRAMES)

    def add(self, now: float, value: float = 0.0) -> None:
        self._forget(now)
        self._moments.append((now, value))
        self._count += 1

    def count_and_rate(self, now: float) -> tuple[int, float]:
        """Return the number of events so far and their present rate per second."""
        self._forget(now)
        full = len(self._moments) == WINDOW_FRAMES
        since = self._moments[0][0] if full else max(self._since, now - WINDOW_SECONDS)
        return self._count, len(self._moments) / max(now - since, 1.0)

    def percentiles(self, now: float) -> LatencyStatus:
        """Return the percentiles of the values."""
        self._forget(now)
        if not self._moments:
            return LatencyStatus()
        return LatencyStatus(*np.percentile([value for _, value in self._moments], (50, 95, 99, 100)).tolist())

    def _forget(self, now: float) -> None:
        while self._moments and self._moments[0][0] < now - WINDOW_SECONDS:
            self._moments.popleft()
