"""Collects the status from the parts of a running service, with rates and latencies of the last seconds."""

import os
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.metadata import version

import numpy as np
import psutil

from capture.sensor_tilt import SensorTilt
from engine_bridge.service.monitoring.status import (
    CharacterStatus,
    ClientsStatus,
    ClipStatus,
    LatencyStatus,
    OutputStatus,
    SensorStatus,
    ServiceStatus,
    StageStatus,
    Status,
    TimelineStatus,
    UserStatus,
)
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.stages.stage_runner import StageRunner
from puppetline import clock

WINDOW_SECONDS = 10.0
"""Length of the time that rates and latencies cover, in seconds."""

WINDOW_FRAMES = 16_384
"""Maximum number of frames in a window: ten seconds at 1600 frames per second."""


class _Window:
    """Times of events in the last `WINDOW_SECONDS`, each with a value, and the number of all events so far."""

    def __init__(self) -> None:
        self._since = clock.now()
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


class Reporter:
    """Counts what stages receive and what characters send, and builds the status from it; one thread calls it."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._version = version("puppetline")
        self._started = clock.now()
        self._cpu = (self._started, time.process_time())
        self._received, self._latencies, self._sent = (defaultdict[str, _Window](_Window) for _ in range(3))
        self._residuals: dict[str, float] = {}
        self._limited: Counter[str] = Counter()

    def received(self, stage: str, skeletons: int) -> None:
        """Count skeletons that a stage has received."""
        for _ in range(skeletons):
            self._received[stage].add(clock.now())

    def sent(self, stage: str, frame: Frame) -> None:
        """Count a frame that has just been offered to all outputs."""
        name, now = frame.character.name, clock.now_ns()
        self._latencies[stage].add(now * 1e-9, (now - frame.received) * 1e-6)
        self._sent[name].add(now * 1e-9)
        if "morphs" in frame.__dict__ and frame.morphs is not None:  # computed for an output
            self._residuals[name] = frame.morphs.residual
            self._limited[name] += frame.morphs.limited

    def status(
        self,
        runners: Sequence[StageRunner],
        clients: ClientsStatus,
        outputs: Sequence[OutputStatus],
        count_in: Callable[[StageRunner], int] = lambda _: 0,
        timeline: TimelineStatus | None = None,
        clips: Sequence[ClipStatus] = (),
    ) -> Status:
        """Return the present status; the numbers of stages and characters that no longer exist are forgotten."""
        stages = {runner.stage.name for runner in runners}
        names = {player.character.name for runner in runners for player in runner.stage.players}
        for windows, kept in ((self._received, stages), (self._latencies, stages), (self._sent, names)):
            for name in windows.keys() - kept:
                del windows[name]
        return Status(
            service=self._service(),
            stages=[self._stage(runner, count_in(runner)) for runner in runners],
            characters=[self._character(player, runner) for runner in runners for player in runner.stage.players],
            clients=clients,
            outputs=outputs,
            timeline=timeline,
            clips=list(clips),
        )

    def _service(self) -> ServiceStatus:
        """Return the state of the process; the share of the processor is measured since the previous call."""
        now, used = clock.now(), time.process_time()
        (then, used_then), self._cpu = self._cpu, (now, used)
        memory, cpu = self._process.memory_info().rss, (used - used_then) / max(now - then, 1e-3)
        return ServiceStatus(version=self._version, uptime=now - self._started, pid=os.getpid(), memory=memory, cpu=cpu)

    def _stage(self, runner: StageRunner, count_in: int) -> StageStatus:
        stage, source = runner.stage, runner.source
        now = clock.now()
        frames, rate = self._received[stage.name].count_and_rate(now)
        sensor = next((player.sensor for player in stage.players if player.sensor != SensorTilt()), SensorTilt())
        return StageStatus(
            name=stage.name,
            source=source.name,
            frames=frames,
            rate=rate,
            dropped=source.counts.dropped,
            refused=dict(source.counts.refused),
            faults=runner.faults,
            latency_ms=self._latencies[stage.name].percentiles(now),
            users=_users(runner),
            sensor=SensorStatus(**{name: round(value, 2) for name, value in asdict(sensor).items()}),
            recording=runner.recording,
            count_in=count_in,
        )

    def _character(self, player: CharacterPlayer, runner: StageRunner) -> CharacterStatus:
        name = player.character.name
        frames, rate = self._sent[name].count_and_rate(clock.now())
        return CharacterStatus(
            name=name,
            stage=runner.stage.name,
            performer=player.user,
            state=player.state,
            frames=frames,
            rate=rate,
            residual=self._residuals.get(name),
            limited=self._limited[name],
        )


def _users(runner: StageRunner) -> list[UserStatus]:
    now, stage = runner.source.now(), runner.stage
    playing = {player.user: player for player in stage.players if player.user is not None}
    users = []
    for user, presence in stage.assignment.present.items():
        player = playing.get(user)
        calibration = None if player is None else player.calibration
        users.append(
            UserStatus(
                user=user,
                state="waiting" if player is None else player.state,
                character=None if player is None else player.character.name,
                seen=round(max(0.0, now - presence.seen), 3),
                distance=round(presence.distance, 2),
                height=None if calibration is None else round(calibration.height, 2),
                reach=None if calibration is None else round(calibration.reach, 2),
            )
        )
    return users
