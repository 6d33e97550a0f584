"""Begins takes, after a count-in if one is wished, and stores in them which other takes played."""

import logging
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from engine_bridge.service.monitoring.logs import fields
from engine_bridge.service.stages.stage_runner import StageRunner
from engine_bridge.service.takes.take_playback import TakePlayback
from puppetline import clock
from puppetline.errors import OutputError, ServiceError
from puppetline.files import append_error

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Counted:
    """A take that begins at a moment of `puppetline.clock`."""

    path: Path
    zero: float


class CountIn:
    """Begins takes of stages.

    Parameters
    ----------
    playback : TakePlayback
        Its takes begin together with the count-in's zero.
    """

    def __init__(self, playback: TakePlayback) -> None:
        self._playback = playback
        self._counted: dict[StageRunner, _Counted] = {}

    def start(self, runner: StageRunner, path: Path, seconds: int) -> None:
        """Begin a take after some seconds; takes that play then begin with it, otherwise they go on.

        Raises
        ------
        OutputError
            The file cannot be written.
        ServiceError
            Takes play at another speed.
        """
        timeline, now = self._playback.timeline, clock.now()
        if self._playback.takes and timeline.speed != 1.0:
            raise ServiceError(
                "the takes that play",
                found=f"the speed {timeline.speed:g}",
                expected="the speed 1, at which another take can be recorded",
                fix='Set the speed first: {"do": "speed", "factor": 1}',
            )
        if not seconds:
            timeline.pause(False, now)
            self._begin(runner, path)
            return
        _keep(path)
        self._counted[runner] = _Counted(path, now + seconds)
        timeline.pause(False, now)
        self._playback.seek(timeline.start, now + seconds)

    def left(self, runner: StageRunner) -> int:
        """Return the seconds until a stage's take begins, rounded up; 0 if there is no count-in."""
        counted = self._counted.get(runner)
        return 0 if counted is None else max(1, math.ceil(counted.zero - clock.now()))

    def take(self, runner: StageRunner) -> str | None:
        """Return the name of the take that begins after the count-in."""
        counted = self._counted.get(runner)
        return None if counted is None else counted.path.stem

    def cancel(self, runner: StageRunner) -> str | None:
        """End a count-in without a take, and return the name that the take would have had; None without a count-in."""
        counted = self._counted.pop(runner, None)
        if counted is None:
            return None
        counted.path.unlink(missing_ok=True)
        return counted.path.stem

    def due(self) -> float:
        """Return the moment at which to call `advance`: that of the next count."""
        now = clock.now()
        return min((each.zero - math.ceil(each.zero - now) + 1 for each in self._counted.values()), default=math.inf)

    def advance(self) -> None:
        """Begin the takes that are due."""
        for runner, counted in [*self._counted.items()]:
            if clock.now() < counted.zero:
                continue
            del self._counted[runner]
            try:
                self._begin(runner, counted.path)
            except OutputError as error:
                log.error("the take cannot begin: %s", error, extra=fields(stage=runner.stage.name))

    def _begin(self, runner: StageRunner, path: Path) -> None:
        runner.start_recording(path, lambda moment: self._mark(runner, moment))

    def _mark(self, runner: StageRunner, moment: float) -> dict[str, Any] | None:
        """Return the timeline's position at a moment of a stage's clock, and the takes that play."""
        if not self._playback.takes:
            return None
        ago = runner.source.now() - moment
        return {"at": self._playback.timeline.position(clock.now()) - ago, "takes": self._playback.takes}


def _keep(path: Path) -> None:
    """Create a take's file, so that no other take gets its name during the count-in."""
    try:
        path.touch(exist_ok=False)
    except OSError as error:
        raise append_error(path, error) from error
