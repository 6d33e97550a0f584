"""Collects the status from the parts of a running service."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict

from capture.sensor_tilt import SensorTilt
from engine_bridge.service.monitoring.statistics import Statistics
from engine_bridge.service.monitoring.status import (
    CharacterStatus,
    ClientsStatus,
    OutputStatus,
    SensorStatus,
    StageStatus,
    Status,
    TimelineStatus,
    UserStatus,
)
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.stages.stage_runner import StageRunner


class Reporter:
    """Counts what stages receive and what characters send, and builds the status from it; one thread calls it."""

    def __init__(self) -> None:
        self._statistics = Statistics()
        self._residuals: dict[str, float] = {}
        self._limited: Counter[str] = Counter()

    def received(self, stage: str, skeletons: int) -> None:
        """Count skeletons that a stage has received."""
        for _ in range(skeletons):
            self._statistics.taken(stage)

    def sent(self, stage: str, frame: Frame) -> None:
        """Count a frame that has been offered to all outputs."""
        name = frame.character.name
        self._statistics.performed(stage, name, frame.received)
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
    ) -> Status:
        """Return the present status; the numbers of stages and characters that no longer exist are forgotten."""
        names = {player.character.name for runner in runners for player in runner.stage.players}
        self._statistics.keep({runner.stage.name for runner in runners}, names)
        return Status(
            service=self._statistics.service(),
            stages=[self._stage(runner, count_in(runner)) for runner in runners],
            characters=[self._character(player, runner) for runner in runners for player in runner.stage.players],
            clients=clients,
            outputs=outputs,
            timeline=timeline,
        )

    def _stage(self, runner: StageRunner, count_in: int) -> StageStatus:
        stage, source = runner.stage, runner.source
        frames, rate, latency = self._statistics.stage(stage.name)
        sensor = next((player.sensor for player in stage.players if player.sensor != SensorTilt()), SensorTilt())
        return StageStatus(
            name=stage.name,
            source=source.name,
            frames=frames,
            rate=rate,
            dropped=source.counts.dropped,
            refused=dict(source.counts.refused),
            faults=runner.faults,
            latency_ms=latency,
            users=_users(runner),
            sensor=SensorStatus(**{name: round(value, 2) for name, value in asdict(sensor).items()}),
            recording=runner.recording,
            count_in=count_in,
        )

    def _character(self, player: CharacterPlayer, runner: StageRunner) -> CharacterStatus:
        name = player.character.name
        frames, rate = self._statistics.character(name)
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
