"""What the service knows about itself: rates and latencies of the last seconds, put together into the status.

The status is a dict of JSON's types. It is published on ``service/status`` each second, shown by ``--status``
(`engine_bridge.service.monitoring.status`) and exported to Prometheus (`engine_bridge.service.monitoring.metrics`)::

    {"service": {"version": str, "uptime": s, "pid": int, "memory": bytes resident, "cpu": share of one core},
     "stages": [{"name": str, "source": URI, "frames": skeletons taken in, "rate": 1/s, "dropped": int,
                 "refused": {reason: count}, "faults": int,
                 "latency_ms": {"p50": ms | null, "p95": …, "p99": …, "max": …},
                 "users": [{"user": int, "state": str, "character": str | null, "seen": s ago, "distance": m,
                            "height": m | null, "reach": m | null}],
                 "sensor": {"tilt": degrees, "height": m, "roll": degrees},
                 "recording": name | null}],
     "characters": [{"name": str, "performer": user | null, "state": str, "frames": performed, "rate": 1/s,
                     "residual": float | null, "limited": frames beyond the range of the morph weights}],
     "clients": {"connected": int, "refused": int, "limit": int},
     "sent": {"messages": int, "bytes": int, …},
     "osc": [{"target": str, "sent": int, "skipped": int, "failed": int}]}
"""

import os
import time
from collections import deque
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import psutil

WINDOW = 10.0
"""Seconds that rates and latencies are of."""

CAPACITY = 16_384
"""Frames that a window holds at most: ten seconds of 1600 a second."""


class Statistics:
    """Collects while the service runs; one thread calls it."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._version = version("puppetline")
        self._started = time.monotonic()
        self._taken: dict[str, _Window] = {}
        self._latencies: dict[str, _Window] = {}
        self._performed: dict[str, _Window] = {}
        self._cpu = (self._started, time.process_time())

    def taken(self, stage: str) -> None:
        """Count a skeleton frame that a stage has taken in."""
        _window(self._taken, stage).add(time.monotonic())

    def performed(self, stage: str, character: str, received: int) -> None:
        """Count a character's frame that has just gone out.

        Parameters
        ----------
        stage, character : str
            Names.
        received : int
            `time.monotonic_ns` at which what the frame comes from came in.
        """
        now = time.monotonic_ns()
        _window(self._latencies, stage).add(now * 1e-9, (now - received) * 1e-6)
        _window(self._performed, character).add(now * 1e-9)

    def snapshot(
        self,
        stages: Sequence[dict[str, Any]],
        characters: Sequence[dict[str, Any]],
        clients: dict[str, int],
        sent: dict[str, int],
        osc: Sequence[dict[str, Any]],
    ) -> dict[str, Any]:
        """Return the status: what is given here as it is, with the figures that were collected.

        Parameters
        ----------
        stages : sequence of dict
            Each with name, source, dropped, refused, users, recording.
        characters : sequence of dict
            Each with name, performer, state, residual, limited. Figures of characters and stages that are not named any
            more are forgotten.
        clients, sent : dict
        osc : sequence of dict
        """
        now = time.monotonic()
        for windows, named in (
            (self._taken, stages),
            (self._latencies, stages),
            (self._performed, characters),
        ):
            for gone in windows.keys() - {each["name"] for each in named}:
                del windows[gone]
        return {
            "service": {
                "version": self._version,
                "uptime": now - self._started,
                "pid": os.getpid(),
                "memory": self._process.memory_info().rss,
                "cpu": self._cpu_share(now),
            },
            "stages": [
                stage
                | _window(self._taken, stage["name"]).figures(now)
                | {"latency_ms": _window(self._latencies, stage["name"]).percentiles(now)}
                for stage in stages
            ],
            "characters": [
                character | _window(self._performed, character["name"]).figures(now) for character in characters
            ],
            "clients": clients,
            "sent": sent,
            "osc": list(osc),
        }

    def _cpu_share(self, now: float) -> float:
        """Return the share of one core since the last snapshot."""
        used = time.process_time()
        (then, used_then), self._cpu = self._cpu, (now, used)
        return (used - used_then) / max(now - then, 1e-3)


class _Window:
    """Moments of the last `WINDOW` seconds with a number each; how many there ever were."""

    def __init__(self, since: float) -> None:
        self._since = since
        self._count = 0
        self._moments: deque[tuple[float, float]] = deque(maxlen=CAPACITY)

    def add(self, now: float, value: float = 0.0) -> None:
        self._forget(now)
        self._moments.append((now, value))
        self._count += 1

    def figures(self, now: float) -> dict[str, float]:
        """Return how many there were and how many a second there are."""
        self._forget(now)
        full = len(self._moments) == CAPACITY
        since = self._moments[0][0] if full else max(self._since, now - WINDOW)
        return {"frames": self._count, "rate": len(self._moments) / max(now - since, 1.0)}

    def percentiles(self, now: float) -> dict[str, float | None]:
        self._forget(now)
        if not self._moments:
            return dict.fromkeys(("p50", "p95", "p99", "max"))
        values = np.percentile([value for _, value in self._moments], (50, 95, 99, 100))
        return dict(zip(("p50", "p95", "p99", "max"), values.tolist(), strict=True))

    def _forget(self, now: float) -> None:
        while self._moments and self._moments[0][0] < now - WINDOW:
            self._moments.popleft()


def _window(windows: dict[str, _Window], name: str) -> _Window:
    window = windows.get(name)
    if window is None:
        window = windows[name] = _Window(time.monotonic())
    return window
